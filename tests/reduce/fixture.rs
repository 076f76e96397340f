//! A made-up run, written in exactly the format of docs/file-formats.md.

use std::path::Path;

use gshear_dem::state::{ContactSample, Disks, Frame, SeriesRow};
use hdf5::types::VarLenUnicode;
use hdf5::{File, Group, H5Type, SimpleExtents};
use ndarray::{Array1, Array2, Array3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

pub const TIME_STEP: f64 = 5e-10;
pub const WALL_SPEED: f64 = 1e-2;
pub const STEPS_PER_ROW: u64 = 100;

/// What the file will hold; change it before writing.
pub struct Fixture {
    pub grains: Disks,
    pub height: f64,
    pub frames: Vec<Frame>,
    pub series_step: Vec<u64>,
    /// As `SeriesRow::COLUMNS`, [columns][L].
    pub series: Vec<Vec<f64>>,
    /// μ_s in the scene.
    pub friction: f64,
    /// The scene's.
    pub seed: u64,
    /// k (N/m) of a spring that pulls the top wall.
    pub spring: Option<f64>,
    /// `None`: the run was stopped early.
    pub digest: Option<String>,
}

impl Fixture {
    /// Disks on a disturbed lattice of `columns` × `rows`, the lowest and the highest row walls, sheared for
    /// `frames` frames and 10 rows of the time series for each; one region rearranges in each drop of τ.
    pub fn sheared(columns: usize, rows: usize, frames: usize) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(11);
        let mut uniform = move || random.random::<f64>();
        let spacing = 1.5e-6;
        let length = spacing * columns as f64;
        let mut grains = Disks {
            radius: vec![],
            body: vec![],
            mass: vec![],
            length,
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
                    let d = grains.separation(centre, *r);
                    let near = (-(d[0] * d[0] + d[1] * d[1]) / (3.0 * spacing).powi(2)).exp();
                    r[0] += 4.0 * drop * near * spacing * (uniform() - 0.5);
                    r[1] += 4.0 * drop * near * spacing * (uniform() - 0.5);
                }
            }
            made.push(frame_of(&grains, step, &points));
        }
        let series_step = (0..series_rows as u64)
            .map(|row| row * STEPS_PER_ROW)
            .collect();
        Fixture {
            grains,
            height,
            frames: made,
            series_step,
            series,
            friction: 0.7,
            seed: 1,
            spring: None,
            digest: Some("00c0ffee00c0ffee".into()),
        }
    }

    /// A run of 48 grains, 6 frames and 51 rows.
    pub fn small() -> Self {
        Self::sheared(8, 6, 6)
    }

    /// Writes `run.h5`.
    pub fn write(&self, path: &Path) {
        self.try_write(path).expect("the fixture is written");
    }

    fn try_write(&self, path: &Path) -> hdf5::Result<()> {
        let file = File::create(path)?;
        let (frames, n) = (self.frames.len(), self.grains.count());
        let h5md = file.create_group("h5md")?;
        h5md.new_attr_builder()
            .with_data(&[1i32, 1])
            .create("version")?;
        for part in ["author", "creator"] {
            text(&h5md.create_group(part)?, "name", "gshear-mpi")?;
        }

        let particles = file.create_group("particles/trajectory")?;
        let cell = particles.create_group("box")?;
        cell.new_attr::<i32>()
            .create("dimension")?
            .write_scalar(&3)?;
        let boundary: Array1<VarLenUnicode> = ["periodic", "none", "none"]
            .iter()
            .map(|b| unicode(b))
            .collect();
        cell.new_attr_builder()
            .with_data(&boundary)
            .create("boundary")?;
        fixed(&cell, "edges", &[self.grains.length, self.height, 0.0])?;
        fixed(&particles, "id", &(0..n as u32).collect::<Vec<_>>())?;
        fixed(&particles, "radius", &self.grains.radius)?;
        fixed(&particles, "body", &self.grains.body)?;
        fixed(&particles, "mass", &self.grains.mass)?;

        let position = particles.create_group("position")?;
        growing(
            &position,
            "step",
            &self.frames.iter().map(|f| f.step).collect::<Vec<_>>(),
        )?;
        growing(
            &position,
            "time",
            &self.frames.iter().map(|f| f.time).collect::<Vec<_>>(),
        )?;
        let planar = |of: fn(&Frame) -> &[[f64; 2]]| {
            Array3::from_shape_fn((frames, n, 3), |(t, i, k)| {
                if k < 2 {
                    of(&self.frames[t])[i][k]
                } else {
                    0.0
                }
            })
        };
        let chunked = |group: &Group, values: &Array3<f64>| {
            let extents = SimpleExtents::resizable(values.shape());
            let dataset = group
                .new_dataset::<f64>()
                .chunk((4, n, 3))
                .shape(extents)
                .create("value")?;
            dataset.write(values)
        };
        chunked(&position, &planar(|f| &f.position))?;
        let image = particles.create_group("image")?;
        let along_x =
            |(t, i, k): (usize, usize, usize)| i32::from(k == 0) * self.frames[t].image[i] as i32;
        let values = Array3::from_shape_fn((frames, n, 3), along_x);
        image
            .new_dataset::<i32>()
            .chunk((4, n, 3))
            .shape(SimpleExtents::resizable(values.shape()))
            .create("value")?
            .write(&values)?;
        let velocity = particles.create_group("velocity")?;
        chunked(&velocity, &planar(|f| &f.velocity))?;
        let spin = particles.create_group("angular_velocity")?;
        let values =
            Array2::from_shape_fn((frames, n), |(t, i)| self.frames[t].angular_velocity[i]);
        let shape = SimpleExtents::resizable(values.shape());
        spin.new_dataset::<f64>()
            .chunk((4, n))
            .shape(shape)
            .create("value")?
            .write(&values)?;

        let contacts = file.create_group("connectivity/contacts")?;
        for group in [
            "particles/trajectory/velocity",
            "particles/trajectory/angular_velocity",
            "connectivity/contacts",
        ] {
            for name in ["step", "time"] {
                file.link_hard(
                    &format!("particles/trajectory/position/{name}"),
                    &format!("{group}/{name}"),
                )?;
            }
        }
        let all: Vec<&ContactSample> = self.frames.iter().flat_map(|f| &f.contacts).collect();
        let mut offset = vec![0u64];
        self.frames
            .iter()
            .for_each(|f| offset.push(offset[offset.len() - 1] + f.contacts.len() as u64));
        growing(&contacts, "offset", &offset)?;
        growing(&contacts, "i", &all.iter().map(|c| c.i).collect::<Vec<_>>())?;
        growing(&contacts, "j", &all.iter().map(|c| c.j).collect::<Vec<_>>())?;
        let column = |name: &str, of: fn(&ContactSample) -> f64| {
            growing(
                &contacts,
                name,
                &all.iter().map(|c| of(c)).collect::<Vec<_>>(),
            )
        };
        column("normal_force", |c| c.normal_force)?;
        column("tangential_force", |c| c.tangential_force[0])?;
        column("tangential_history", |c| c.tangential_history[0])?;
        column("rolling_history", |c| c.rolling_history)?;
        column("overlap", |c| c.overlap)?;
        growing(
            &contacts,
            "sliding",
            &all.iter().map(|c| c.sliding as u8).collect::<Vec<_>>(),
        )?;

        let observables = file.create_group("observables")?;
        let columns = SeriesRow::COLUMNS.iter().zip(&self.series);
        for (name, values) in columns {
            let group = observables.create_group(name.name)?;
            if *name == SeriesRow::COLUMNS[0] {
                growing(&group, "step", &self.series_step)?;
                let time = self.series_step.iter().map(|step| *step as f64 * TIME_STEP);
                growing(&group, "time", &time.collect::<Vec<_>>())?;
            } else {
                for link in ["step", "time"] {
                    file.link_hard(
                        &format!("observables/{}/{link}", SeriesRow::COLUMNS[0]),
                        &format!("observables/{name}/{link}"),
                    )?;
                }
            }
            growing(&group, "value", values)?;
        }

        let parameters = file.create_group("parameters")?;
        let title = "Made up <for> tests & nothing else";
        let scene = format!(
            "title = \"{title}\"\nseed = {}\n\
             material = {{ young_modulus = 1e9, poisson_ratio = 0.2, density = 2500 }}\n\
             contact = {{ friction = {:?}, damping_ratio = 0.1 }}\n\
             sample = {{ grains = 1000, radius_min = 0.5e-6, radius_max = 1e-6, length = 48e-6 }}\n\
             load.stiffness_number = 10_000\nshear = {{ velocity = 1e-4, strain = 0.1 }}\n",
            self.seed, self.friction
        );
        text(&parameters, "scene", &scene)?;
        if let Some(stiffness) = self.spring {
            parameters
                .new_attr::<f64>()
                .create("spring_stiffness")?
                .write_scalar(&stiffness)?;
        }
        text(&parameters, "version", "0.1.0")?;
        text(&parameters, "git_commit", "0000000")?;
        text(&parameters, "processor", "none")?;
        text(&parameters, "started", "2026-01-01T00:00:00Z")?;
        if let Some(digest) = &self.digest {
            text(&parameters, "digest", digest)?;
            parameters
                .new_attr::<f64>()
                .create("speed")?
                .write_scalar(&1.25e7)?;
            parameters
                .new_attr_builder()
                .with_data(&[0.0, self.grains.length])
                .create("rank_map")?;
        }
        for (name, value) in [("ranks", 1u64), ("steps_per_frame", 10 * STEPS_PER_ROW)] {
            parameters
                .new_attr::<u64>()
                .create(name)?
                .write_scalar(&value)?;
        }
        let numbers = [
            ("time_step", TIME_STEP),
            ("frame_strain", strain_of(10 * STEPS_PER_ROW, self.height)),
            ("inertial_number", 2e-4),
            ("stiffness_number", 1e4),
            ("wall_speed", WALL_SPEED),
            ("normal_force", 0.6),
            ("pressure", 13e3),
            ("height_start", self.height),
        ];
        for (name, value) in numbers {
            parameters
                .new_attr::<f64>()
                .create(name)?
                .write_scalar(&value)?;
        }
        file.close()
    }
}

/// γ at a step.
pub fn strain_of(step: u64, height: f64) -> f64 {
    step as f64 * TIME_STEP * WALL_SPEED / height
}

/// A frame of grains at the given places, not wrapped, with a contact wherever two of them overlap.
fn frame_of(grains: &Disks, step: u64, points: &[[f64; 2]]) -> Frame {
    let position: Vec<[f64; 2]> = points
        .iter()
        .map(|r| [r[0].rem_euclid(grains.length), r[1]])
        .collect();
    let mut contacts = Vec::new();
    for i in 0..points.len() {
        for j in i + 1..points.len() {
            let d = grains.separation(position[j], position[i]);
            let overlap = grains.radius[i] + grains.radius[j] - d[0].hypot(d[1]);
            if overlap > 0.0 && (grains.body[i] == 0 || grains.body[i] != grains.body[j]) {
                let normal_force = 1.4e8 * overlap * overlap / grains.length * 40.0;
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
                });
            }
        }
    }
    let n = points.len();
    let velocity = (0..n)
        .map(|i| [WALL_SPEED * points[i][1], 1e-9 * i as f64])
        .collect();
    let angular_velocity = (0..n).map(|i| 1e-3 * (i as f64 - 7.0)).collect();
    Frame {
        step,
        time: step as f64 * TIME_STEP,
        position,
        image: (points.iter())
            .map(|r| r[0].div_euclid(grains.length) as i64)
            .collect(),
        velocity,
        angular_velocity,
        contacts,
    }
}

fn unicode(value: &str) -> VarLenUnicode {
    value.parse().expect("no zero character")
}

fn text(group: &Group, name: &str, value: &str) -> hdf5::Result<()> {
    group
        .new_attr::<VarLenUnicode>()
        .create(name)?
        .write_scalar(&unicode(value))
}

fn fixed<T: H5Type>(group: &Group, name: &str, values: &[T]) -> hdf5::Result<()> {
    group
        .new_dataset_builder()
        .with_data(values)
        .create(name)
        .map(|_| ())
}

/// A dataset with an unlimited first dimension.
fn growing<T: H5Type>(group: &Group, name: &str, values: &[T]) -> hdf5::Result<()> {
    let extents = SimpleExtents::resizable([values.len()]);
    group
        .new_dataset::<T>()
        .chunk(256)
        .shape(extents)
        .create(name)?
        .write_raw(values)
}
