//! The differences between two and three dimensions: records of grains and operations on vectors.
//!
//! The walls' normals are along the last axis; along the others the cell is periodic. Vectors of
//! lanes have three components, of which only the first [`Dimension::AXES`] or [`Dimension::SPINS`]
//! are used.

use std::fmt::Debug;
use std::ops::DerefMut;

use bytemuck::Pod;

use crate::simd::{CacheLine, Force2, Lanes, Lanes16, PairBlock};

/// A vector of lanes.
pub type Vector<L> = [L; 3];

/// Static dispatch on the number of dimensions.
pub trait Dimension: Debug + Default + Clone + Copy + Send + Sync + 'static {
    /// Components of a position.
    const AXES: usize;
    /// The axis of the walls' normals.
    const UP: usize = Self::AXES - 1;
    /// Components of an angular velocity: one about z, or three. A tangential vector has as many:
    /// one along t̂ = ẑ × n, or the three of a vector in the tangent plane.
    const SPINS: usize;
    /// I/(m R²).
    const INERTIA: f64;

    // Indices in a grain's record.
    /// Wrapped position (m).
    const POSITION: usize = 0;
    /// Velocity of the full step (m/s); predicted while the forces are computed.
    const VELOCITY: usize = Self::AXES;
    /// Velocity of the half step (m/s).
    const HALF_VELOCITY: usize = 2 * Self::AXES;
    /// Angular velocity of the half step (rad/s).
    const HALF_SPIN: usize = 3 * Self::AXES;
    /// Angular velocity of the full step (rad/s); predicted while the forces are computed.
    const SPIN: usize = 3 * Self::AXES + Self::SPINS;
    /// Radius (m), if a record has room for it; then where [`Dimension::load`] gives that of the
    /// second grain. That of the first is at its place in the differences.
    const RADIUS: Option<[usize; 2]> = None;
    /// Index of the angular velocities of the second grain in what [`Dimension::load`] gives of it:
    /// of the half step, then of the full step.
    const SPINS_OF_J: usize;
    /// Index of the torques in [`Dimension::Force`]; forces begin at 0.
    const TORQUE: usize = Self::AXES;

    /// The fields of a grain that the kernel reads, in one cache line or two.
    type Record: Pod + Debug + Default + PartialEq + Send + Sync;
    /// Force and torque on a grain.
    type Force: Pod + Debug + Default + PartialEq + Send + Sync + DerefMut<Target = [f64]>;
    /// Each field of the records of sixteen grains.
    type Fields: Copy + Debug + Default + AsRef<[Lanes16]> + AsMut<[Lanes16]> + Send + Sync;

    /// The numbers of a record.
    fn fields(record: &Self::Record) -> &[f64];
    /// The numbers of a record, to change them.
    fn fields_mut(record: &mut Self::Record) -> &mut [f64];

    /// πR² or (4/3)πR³ (m² or m³).
    fn volume(radius: f64) -> f64;
    /// R² or R³: the volume over π or (4/3)π.
    fn power<L: Lanes>(radius: L) -> L;

    /// Loads the records of a block of pairs, and transposes their differences i - j into lanes;
    /// with `FRICTION` also the angular velocities of the grains j, from
    /// [`Dimension::SPINS_OF_J`] on.
    fn load<L: Lanes, const FRICTION: bool>(
        token: L::Token,
        records: &[Self::Record],
        pairs: PairBlock<'_>,
        differences: &mut Self::Fields,
        of_j: &mut [Lanes16; 8],
    );
    /// Adds forces and torques to the grains of a block of pairs.
    fn add_forces<L: Lanes>(forces: &PairForces<L>, sums: &mut [Self::Force], pairs: PairBlock<'_>);

    /// a·b.
    fn dot<L: Lanes>(a: &Vector<L>, b: &Vector<L>) -> L;
    /// v - v_n n, given v_n = v·n.
    fn tangential_part<L: Lanes>(n: &Vector<L>, v: &Vector<L>, v_n: L) -> Vector<L>;
    /// n × s: the relative surface velocity that the spins give, with s = R_i ω_i + R_j ω_j.
    fn surface_velocity<L: Lanes>(n: &Vector<L>, s: &Vector<L>) -> Vector<L>;
    /// n × F of a tangential force F: the torque per lever arm.
    fn moment<L: Lanes>(n: &Vector<L>, f: &Vector<L>) -> Vector<L>;
    /// F_n n + F_t.
    fn force<L: Lanes>(n: &Vector<L>, normal: L, tangential: &Vector<L>) -> Vector<L>;
}

/// What sixteen contacts do to their grains; zeros where none acts.
pub struct PairForces<L> {
    /// The force on i; that on j is its opposite (N; N/m in 2D).
    pub force: Vector<L>,
    /// The torque on i (N m; N in 2D).
    pub torque_i: Vector<L>,
    /// The torque on j.
    pub torque_j: Vector<L>,
}

/// x a + b.
#[inline(always)]
pub(crate) fn scaled_sum<L: Lanes>(x: L, a: &Vector<L>, b: &Vector<L>) -> Vector<L> {
    [
        x.mul_add(a[0], b[0]),
        x.mul_add(a[1], b[1]),
        x.mul_add(a[2], b[2]),
    ]
}

#[inline(always)]
fn cross<L: Lanes>(a: &Vector<L>, b: &Vector<L>) -> Vector<L> {
    [
        a[1].mul_add(b[2], -(a[2] * b[1])),
        a[2].mul_add(b[0], -(a[0] * b[2])),
        a[0].mul_add(b[1], -(a[1] * b[0])),
    ]
}

/// Disks in the plane of x and y, per unit depth.
#[derive(Debug, Default, Clone, Copy)]
pub struct Two;

impl Dimension for Two {
    const AXES: usize = 2;
    const SPINS: usize = 1;
    const INERTIA: f64 = 0.5;
    const SPINS_OF_J: usize = 0;
    type Record = [CacheLine; 1];
    type Force = Force2;
    type Fields = [Lanes16; 8];

    #[inline(always)]
    fn fields(record: &[CacheLine; 1]) -> &[f64] {
        &record[0].0
    }

    #[inline(always)]
    fn fields_mut(record: &mut [CacheLine; 1]) -> &mut [f64] {
        &mut record[0].0
    }

    fn volume(radius: f64) -> f64 {
        std::f64::consts::PI * radius * radius
    }

    #[inline(always)]
    fn power<L: Lanes>(radius: L) -> L {
        radius * radius
    }

    #[inline(always)]
    fn load<L: Lanes, const FRICTION: bool>(
        token: L::Token,
        records: &[[CacheLine; 1]],
        pairs: PairBlock<'_>,
        differences: &mut [Lanes16; 8],
        of_j: &mut [Lanes16; 8],
    ) {
        L::differences::<0, 1>(token, records, pairs, differences, None);
        if FRICTION {
            let [half, full] = L::last_two_of_j::<0, 1>(token, records, pairs);
            half.store(&mut of_j[0]);
            full.store(&mut of_j[1]);
        }
    }

    #[inline(always)]
    fn add_forces<L: Lanes>(forces: &PairForces<L>, sums: &mut [Force2], pairs: PairBlock<'_>) {
        let [x, y, _] = forces.force;
        let terms = [x, y, forces.torque_i[0], forces.torque_j[0]];
        L::add_forces_2d(terms, sums, pairs);
    }

    #[inline(always)]
    fn dot<L: Lanes>(a: &Vector<L>, b: &Vector<L>) -> L {
        a[0].mul_add(b[0], a[1] * b[1])
    }

    #[inline(always)]
    fn tangential_part<L: Lanes>(n: &Vector<L>, v: &Vector<L>, _: L) -> Vector<L> {
        [v[1].mul_add(n[0], -(v[0] * n[1])); 3]
    }

    #[inline(always)]
    fn surface_velocity<L: Lanes>(_: &Vector<L>, s: &Vector<L>) -> Vector<L> {
        [-s[0]; 3]
    }

    #[inline(always)]
    fn moment<L: Lanes>(_: &Vector<L>, f: &Vector<L>) -> Vector<L> {
        *f
    }

    #[inline(always)]
    fn force<L: Lanes>(n: &Vector<L>, normal: L, tangential: &Vector<L>) -> Vector<L> {
        let t = tangential[0];
        [
            normal.mul_add(n[0], -(t * n[1])),
            normal.mul_add(n[1], t * n[0]),
            t,
        ]
    }
}

/// Spheres.
#[derive(Debug, Default, Clone, Copy)]
pub struct Three;

impl Dimension for Three {
    const AXES: usize = 3;
    const SPINS: usize = 3;
    const INERTIA: f64 = 0.4;
    const SPINS_OF_J: usize = Self::HALF_SPIN - 8;
    const RADIUS: Option<[usize; 2]> = Some([15, 7]);
    type Record = [CacheLine; 2];
    type Force = CacheLine;
    type Fields = [Lanes16; 16];

    #[inline(always)]
    fn fields(record: &[CacheLine; 2]) -> &[f64] {
        bytemuck::cast_slice(record)
    }

    #[inline(always)]
    fn fields_mut(record: &mut [CacheLine; 2]) -> &mut [f64] {
        bytemuck::cast_slice_mut(record)
    }

    fn volume(radius: f64) -> f64 {
        4.0 / 3.0 * std::f64::consts::PI * radius * radius * radius
    }

    #[inline(always)]
    fn power<L: Lanes>(radius: L) -> L {
        radius * radius * radius
    }

    #[inline(always)]
    fn load<L: Lanes, const FRICTION: bool>(
        token: L::Token,
        records: &[[CacheLine; 2]],
        pairs: PairBlock<'_>,
        differences: &mut [Lanes16; 16],
        of_j: &mut [Lanes16; 8],
    ) {
        let (lines, _) = differences.as_chunks_mut();
        L::differences::<0, 2>(token, records, pairs, &mut lines[0], None);
        L::differences::<1, 2>(token, records, pairs, &mut lines[1], Some(of_j));
    }

    #[inline(always)]
    fn add_forces<L: Lanes>(forces: &PairForces<L>, sums: &mut [CacheLine], pairs: PairBlock<'_>) {
        let terms = [forces.force, forces.torque_i, forces.torque_j];
        L::add_forces_3d(terms, sums, pairs);
    }

    #[inline(always)]
    fn dot<L: Lanes>(a: &Vector<L>, b: &Vector<L>) -> L {
        a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
    }

    #[inline(always)]
    fn tangential_part<L: Lanes>(n: &Vector<L>, v: &Vector<L>, v_n: L) -> Vector<L> {
        scaled_sum(-v_n, n, v)
    }

    #[inline(always)]
    fn surface_velocity<L: Lanes>(n: &Vector<L>, s: &Vector<L>) -> Vector<L> {
        cross(n, s)
    }

    #[inline(always)]
    fn moment<L: Lanes>(n: &Vector<L>, f: &Vector<L>) -> Vector<L> {
        cross(n, f)
    }

    #[inline(always)]
    fn force<L: Lanes>(n: &Vector<L>, normal: L, tangential: &Vector<L>) -> Vector<L> {
        scaled_sum(normal, n, tangential)
    }
}

/// The number of dimensions, at run time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dimensions {
    /// Disks.
    Two,
    /// Spheres.
    Three,
}

impl Dimensions {
    /// Components of a position.
    pub fn axes(self) -> usize {
        match self {
            Dimensions::Two => Two::AXES,
            Dimensions::Three => Three::AXES,
        }
    }

    /// πR² or (4/3)πR³ (m² or m³).
    pub fn volume(self, radius: f64) -> f64 {
        match self {
            Dimensions::Two => Two::volume(radius),
            Dimensions::Three => Three::volume(radius),
        }
    }
}
