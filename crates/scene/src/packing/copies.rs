//! Copies of a packing beside each other, and how a periodic one streams.

use gshear_dem::failure::Result;

use super::GrainLimit;
use super::file::wrong;
use crate::lammps_data::{AXES, Atom, DataFile};

/// The axis along which a cell is sheared: y of disks, which are in the plane z = 0, z of spheres.
pub(super) fn gradient(atoms: &[Atom]) -> usize {
    1 + usize::from(atoms.iter().any(|atom| atom.position[2] != 0.0))
}

/// An atom in a stream.
struct StreamPoint {
    /// Volume over that of a sphere (a disk in 2D) of diameter 1.
    weight: f64,
    height: f64,
    velocity: f64,
}

/// Finds with what velocity along x (m/s) of the image above the grains stream: by the straight
/// line of least squares, weighed by volume, through their velocities over the height. Takes from
/// them the velocity of that line at the lower edge, at which images of the bottom rest.
pub(super) fn find_stream(data: &mut DataFile) {
    let up = gradient(&data.atoms);
    let [low, high] = data.bounds[up];
    // In the order of their ids, which a file need not have.
    let mut atoms: Vec<&Atom> = data.atoms.iter().collect();
    atoms.sort_by_key(|atom| atom.id);
    let points: Vec<StreamPoint> = atoms
        .into_iter()
        .map(|atom| StreamPoint {
            weight: atom.diameter.powi(1 + up as i32),
            height: atom.position[up] - low,
            velocity: atom.velocity[0],
        })
        .collect();
    let mut sums = [0.0; 3];
    for point in &points {
        sums[0] += point.weight;
        sums[1] += point.weight * point.height;
        sums[2] += point.weight * point.velocity;
    }
    let [height, velocity] = [sums[1], sums[2]].map(|sum| sum / sums[0]);
    let (mut covariance, mut variance) = (0.0, 0.0);
    for point in &points {
        let above = point.height - height;
        covariance += point.weight * above * (point.velocity - velocity);
        variance += point.weight * above * above;
    }
    let rate = if variance > 0.0 {
        covariance / variance
    } else {
        0.0
    };
    let drift = velocity - rate * height;
    for atom in &mut data.atoms {
        atom.velocity[0] -= drift;
    }
    data.stream = Some(rate * (high - low));
}

/// So many copies beside each other along the axes, in a box as many times as long. Those above
/// each other stream as images do.
pub(super) fn replicated(
    name: &str,
    mut data: DataFile,
    copies: [u32; 3],
    limit: &GrainLimit,
) -> Result<DataFile> {
    check_number(name, data.atoms.len(), copies, limit)?;
    check_lengths(name, &data, copies)?;
    let up = gradient(&data.atoms);
    for (axis, copies) in copies.into_iter().enumerate() {
        replicate_along(&mut data, axis, copies, up);
    }
    Ok(data)
}

/// Refuses more grains than the limit.
fn check_number(name: &str, atoms: usize, copies: [u32; 3], limit: &GrainLimit) -> Result<()> {
    let number: u128 = copies.map(u128::from).iter().product();
    let grains = atoms as u128 * number;
    if grains <= limit.most.into() {
        return Ok(());
    }
    let in_copies = match number {
        1 => String::new(),
        _ => {
            let copies = copies.map(|n| n.to_string()).join(" × ");
            format!(" in {copies} copies (sample.replicate)")
        }
    };
    let GrainLimit { most, reason } = limit;
    let what = format!(
        "has {atoms} atoms{in_copies}: {grains} grains are more than the {most} that {reason}; give fewer"
    );
    Err(wrong(name, 0, what))
}

/// Refuses copies whose box is longer than a number can be.
fn check_lengths(name: &str, data: &DataFile, copies: [u32; 3]) -> Result<()> {
    for axis in 0..3 {
        let [low, high] = data.bounds[axis];
        let end = low + (high - low) * f64::from(copies[axis]);
        if !end.is_finite() {
            let (copies, axis) = (copies[axis], AXES[axis]);
            let what = format!(
                "{copies} copies of the box along {axis} (sample.replicate) are longer than a number can say; give fewer"
            );
            return Err(wrong(name, 0, what));
        }
    }
    Ok(())
}

/// Copies along one axis; `up`: that along which the grains stream.
fn replicate_along(data: &mut DataFile, axis: usize, copies: u32, up: usize) {
    let stream = match data.stream {
        Some(stream) if axis == up => stream,
        _ => 0.0,
    };
    let [low, high] = data.bounds[axis];
    let [xy, xz, yz] = data.tilt;
    let mut edge = [[0.0; 3], [xy, 0.0, 0.0], [xz, yz, 0.0]][axis];
    edge[axis] = high - low;
    let once = data.atoms.clone();
    let last = once.iter().map(|atom| atom.id).max().unwrap_or(0);
    for copy in 1..copies {
        data.atoms.extend(once.iter().map(|atom| {
            let mut atom = *atom;
            for (x, edge) in atom.position.iter_mut().zip(edge) {
                *x += edge * f64::from(copy);
            }
            atom.velocity[0] += stream * f64::from(copy);
            // As LAMMPS numbers copies.
            let before = last.saturating_mul(u64::from(copy));
            atom.id = atom.id.saturating_add(before);
            atom
        }));
    }
    data.bounds[axis][1] = low + (high - low) * f64::from(copies);
    if axis == up {
        data.stream = data.stream.map(|stream| stream * f64::from(copies));
    }
    for tilt in [&[][..], &[0], &[1, 2]][axis] {
        data.tilt[*tilt] *= f64::from(copies);
    }
}
