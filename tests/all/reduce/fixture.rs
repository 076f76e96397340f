//! A made-up run, written as the program writes one.

use std::path::Path;

use gshear_analysis::frame_scalars::FrameScalars;
use gshear_dem::boundary::ROUGH_WALLS;
use gshear_dem::dimension::Dimensions;
use gshear_dem::domain::Solo;
use gshear_dem::failure::Result;
use gshear_dem::state::{
    Cell, ContactSample, Frame, GrainConstants, GrainSample, SeriesRow, nearest_image,
};
use gshear_store::h5::Attribute;
use gshear_store::trajectory::{FrameFormat, GrainShape, RunHeader, TrajectoryWriter};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

pub const TIME_STEP: f64 = 5e-10;
pub const WALL_SPEED: f64 = 1e-2;
pub const STEPS_PER_ROW: u64 = 100;

/// What the file will hold; change it before writing.
pub struct Fixture {
    pub grains: GrainConstants,
    /// L_x (m).
    pub length: f64,
    pub height: f64,
    pub frames: Vec<Frame>,
    pub series_step: Vec<u64>,
    /// As `SeriesRow::COLUMNS`, [columns][L].
    pub series: Vec<Vec<f64>>,
    /// μ_s in the scene.
    pub friction: f64,
    /// The scene's.
    pub seed: u64,
    /// Further lines of the scene.
    pub further: String,
    /// k (N/m) of a spring that pulls the top wall.
    pub spring: Option<f64>,
    /// Scalars of the frames at these steps, as if the run had computed them.
    pub scalars: Vec<(u64, FrameScalars)>,
    /// `None`: the run was stopped early.
    pub digest: Option<String>,
}

impl Fixture {
    /// Disks on a disturbed lattice of `columns` × `rows`, the lowest and the highest row walls,
    /// sheared for `frames` frames and 10 rows of the time series for each; one region rearranges
    /// in each drop of τ.
    pub fn sheared(columns: usize, rows: usize, frames: usize) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(11);
        let mut uniform = move || random.random::<f64>();
        let spacing = 1.5e-6;
        let length = spacing * columns as f64;
        let mut grains = GrainConstants {
            radius: vec![],
            body: vec![],
            mass: vec![],
        };
        let mut points: Vec<[f64; 2]> = Vec::new();
        for row in 0..rows {
            for column in 0..columns {
                let shift = if row % 2 == 0 { 0.25 } else { 0.75 };
                let jitter = |u: f64| 0.1 * spacing * (u - 0.5);
                let x = (column as f64 + shift) * spacing + jitter(uniform());
                let y = row as f64 * 0.87 * spacing + jitter(uniform());
                points.push([x, y]);
                let radius = 0.78e-6 * (0.85 + 0.3 * uniform());
                grains.radius.push(radius);
                grains
                    .mass
                    .push(2500.0 * std::f64::consts::PI * radius * radius);
                grains.body.push(if row == 0 {
                    1
                } else {
                    2 * u8::from(row + 1 == rows)
                });
            }
        }
        let height = (rows - 1) as f64 * 0.87 * spacing;

        let series_rows = 10 * (frames - 1) + 1;
        let (mut series, mut taus) = (vec![Vec::new(); SeriesRow::COLUMNS.len()], Vec::new());
        let mut tau: f64 = 0.0;
        for row in 0..series_rows {
            let strain = strain_of(row as u64 * STEPS_PER_ROW, height);
            // Loading towards 0.4; one time in seven a drop, rarely a great one.
            if row > 0 {
                let event = uniform() < 0.15;
                tau += if event {
                    -0.01 * uniform().powi(-2).sqrt().min(12.0)
                } else {
                    0.03 * (0.4 - tau)
                };
            }
            taus.push(tau);
            let row = SeriesRow {
                strain,
                stress_ratio: tau,
                normal_force: 0.6,
                shear_force: 0.6 * tau,
                wall_height: height * (1.0 + 0.1 * strain),
                drive_velocity: 0.5,
                solid_fraction: 0.84,
                coordination: 3.1,
                kinetic_energy: 1e-15,
                sliding_fraction: 0.02,
                ..SeriesRow::from_columns([0.0; SeriesRow::COLUMNS.len()])
            };
            for (column, value) in series.iter_mut().zip(row.columns()) {
                column.push(value);
            }
        }

        let mut made = Vec::new();
        for t in 0..frames {
            let step = 10 * STEPS_PER_ROW * t as u64;
            if t > 0 {
                let advance =
                    strain_of(step, height) - strain_of(step - 10 * STEPS_PER_ROW, height);
                let drop = f64::max(taus[10 * t - 10] - taus[10 * t], 0.0);
                let centre = [uniform() * length, uniform() * height];
                for r in &mut points {
                    r[0] += advance * r[1];
                    let d = separation(length, centre, *r);
                    let near = (-(d[0] * d[0] + d[1] * d[1]) / (3.0 * spacing).powi(2)).exp();
                    r[0] += 4.0 * drop * near * spacing * (uniform() - 0.5);
                    r[1] += 4.0 * drop * near * spacing * (uniform() - 0.5);
                }
            }
            made.push(frame_of(&grains, length, step, &points));
        }
        let series_step = (0..series_rows as u64)
            .map(|row| row * STEPS_PER_ROW)
            .collect();
        Fixture {
            grains,
            length,
            height,
            frames: made,
            series_step,
            series,
            friction: 0.7,
            seed: 1,
            further: String::new(),
            spring: None,
            scalars: Vec::new(),
            digest: Some("00c0ffee00c0ffee".into()),
        }
    }

    /// A run of 48 grains, 6 frames and 51 rows.
    pub fn small() -> Self {
        Self::sheared(8, 6, 6)
    }

    /// Gives the rows these τ, under the normal force that they have.
    pub fn set_stress_ratio(&mut self, tau: Vec<f64>) {
        let [ratio, normal, shear] = ["stress_ratio", "normal_force", "shear_force"].map(column);
        let forces = tau.iter().zip(&self.series[normal]);
        self.series[shear] = forces.map(|(tau, force)| tau * force).collect();
        self.series[ratio] = tau;
    }

    /// Writes `run.h5`.
    pub fn write(&self, path: &Path) {
        self.try_write(path).expect("the fixture is written");
    }

    fn try_write(&self, path: &Path) -> Result<()> {
        let grains: Vec<GrainShape> = (0..self.grains.count())
            .map(|n| GrainShape {
                id: n as u32,
                body: self.grains.body[n].into(),
                radius: self.grains.radius[n],
                mass: self.grains.mass[n],
                material: 0,
            })
            .collect();
        let scene = format!(
            "title = \"Made up <for> tests & nothing else\"\nseed = {}\n\
             material = {{ young_modulus = 1e9, poisson_ratio = 0.2, density = 2500 }}\n\
             contact = {{ friction = {:?}, damping_ratio = 0.1 }}\n\
             sample = {{ grains = 1000, radius_min = 0.5e-6, radius_max = 1e-6, length = 48e-6 }}\n\
             load.stiffness_number = 10_000\nshear = {{ velocity = 1e-4, strain = 0.1 }}\n{}",
            self.seed, self.friction, self.further
        );
        let mut attributes: Vec<(&str, Attribute)> = vec![
            ("scene", scene.into()),
            ("version", "0.1.0".into()),
            ("git_commit", "0000000".into()),
            ("processor", "none".into()),
            ("started", "2026-01-01T00:00:00Z".into()),
            ("ranks", 1.into()),
            ("steps_per_frame", (10 * STEPS_PER_ROW).into()),
            ("time_step", TIME_STEP.into()),
            (
                "frame_strain",
                strain_of(10 * STEPS_PER_ROW, self.height).into(),
            ),
            ("inertial_number", 2e-4.into()),
            ("stiffness_number", 1e4.into()),
            ("wall_speed", WALL_SPEED.into()),
            ("normal_force", 0.6.into()),
            ("pressure", 13e3.into()),
            ("height_start", self.height.into()),
        ];
        attributes.extend(self.spring.map(|k| ("spring_stiffness", k.into())));
        let edges = [self.length, self.height, 0.0];
        let header = RunHeader {
            form: FrameFormat::new(2, false),
            boundary: &ROUGH_WALLS,
            units: true,
            series: &SeriesRow::COLUMNS,
            edges,
            author: "gshear-mpi",
            history_unit: "N",
            grains: &grains,
            ids: None,
            attributes: &attributes,
        };
        let mut writer = TrajectoryWriter::create(&Solo, path, &header)?;
        let edges = std::array::from_fn(|row| {
            std::array::from_fn(|column| if row == column { edges[row] } else { 0.0 })
        });
        for frame in &self.frames {
            let at = (frame.step, frame.time);
            writer.frame(&Solo, at, &edges, &frame.grains, &frame.contacts)?;
        }
        for (k, &step) in self.series_step.iter().enumerate() {
            let row: Vec<f64> = self.series.iter().map(|values| values[k]).collect();
            writer.series(&Solo, step, step as f64 * TIME_STEP, &row)?;
        }
        if !self.scalars.is_empty() {
            writer.begin_scalars(&Solo, 0)?;
            writer.scalars(&Solo, &self.scalars)?;
        }
        let at_the_end = self.digest.as_ref().map_or(Vec::new(), |digest| {
            vec![
                ("digest", digest.clone().into()),
                ("speed", 1.25e7.into()),
                ("rank_map", vec![0.0, self.length].into()),
            ]
        });
        writer.finish(&Solo, &at_the_end)
    }
}

/// The number of a column of the time series.
pub fn column(name: &str) -> usize {
    let mut columns = SeriesRow::COLUMNS.iter();
    let found = columns.position(|column| column.name == name);
    found.unwrap_or_else(|| panic!("{name} is no column"))
}

/// γ at a step.
pub fn strain_of(step: u64, height: f64) -> f64 {
    step as f64 * TIME_STEP * WALL_SPEED / height
}

/// A frame of grains at the given places, not wrapped, with a contact wherever two of them overlap.
fn frame_of(grains: &GrainConstants, length: f64, step: u64, points: &[[f64; 2]]) -> Frame {
    let position: Vec<[f64; 2]> = points
        .iter()
        .map(|r| [r[0].rem_euclid(length), r[1]])
        .collect();
    let mut contacts = Vec::new();
    for i in 0..points.len() {
        for j in i + 1..points.len() {
            let d = separation(length, position[j], position[i]);
            let overlap = grains.radius[i] + grains.radius[j] - d[0].hypot(d[1]);
            if overlap > 0.0 && (grains.body[i] == 0 || grains.body[i] != grains.body[j]) {
                let normal_force = 1.4e8 * overlap * overlap / length * 40.0;
                contacts.push(ContactSample {
                    i: i as u32,
                    j: j as u32,
                    normal_force,
                    tangential_force: [0.1 * normal_force * (d[0] / d[1].hypot(d[0])), 0.0, 0.0],
                    tangential_history: [0.1 * normal_force, 0.0, 0.0],
                    rolling_history: 1e-9 * normal_force,
                    overlap,
                    sliding: u64::from((i + j) % 20 == 0),
                    rolling: 0,
                    torques: [0.0; 4],
                    twisting: 0,
                    idle: 0,
                    age: 0.0,
                });
            }
        }
    }
    let grain = |(n, r): (usize, &[f64; 2])| GrainSample {
        id: n as u32,
        removed: 0,
        position: [position[n][0], position[n][1], 0.0],
        velocity: [WALL_SPEED * r[1], 1e-9 * n as f64, 0.0],
        angular_velocity: [0.0, 0.0, 1e-3 * (n as f64 - 7.0)],
        image: [r[0].div_euclid(length) as i64, 0, 0],
    };
    Frame {
        dimension: Dimensions::Two,
        cell: Cell::between_walls([length, f64::INFINITY]),
        step,
        time: step as f64 * TIME_STEP,
        grains: points.iter().enumerate().map(grain).collect(),
        contacts,
        wall_contacts: Vec::new(),
    }
}

/// r_to - r_from (m), nearest image along x.
fn separation(length: f64, from: [f64; 2], to: [f64; 2]) -> [f64; 2] {
    [nearest_image(to[0] - from[0], length), to[1] - from[1]]
}
