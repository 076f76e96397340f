//! What bounds a sample along its last axis, and what follows from it. Along the others every
//! sample is periodic.
//!
//! A [`Boundary`] says what is at each [`End`] of the sample, and the words for it. The scene
//! chooses one of [`KINDS`], [`crate::drive::MovingBoundary`] moves it, `run.h5` stores its name,
//! and analysis and reports ask it.

use std::sync::LazyLock;

use crate::columns::Column;
use crate::protocol::Protocol;
use crate::state::{
    BottomRow, FlowRow, ImposedRow, LateralRow, SeriesRow, StressRow, TemperatureRow, body,
};

/// What is at one end of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// A rigid wall of frozen grains.
    Grains,
    /// A rigid plane.
    Plane,
    /// Nothing: a free surface.
    Nothing,
    /// The sample's own images.
    Images,
}

impl End {
    fn is_wall(self) -> bool {
        matches!(self, End::Grains | End::Plane)
    }
}

/// A kind of boundary.
#[derive(Debug, PartialEq, Eq)]
pub struct Boundary {
    /// The name, as `run.h5` stores it.
    pub name: &'static str,
    /// The value of the key `sample.boundary`.
    pub key: &'static str,
    /// The values of the key `sample.walls` with it.
    pub walls_keys: &'static [&'static str],
    /// What is below the sample.
    pub bottom: End,
    /// What is above it.
    pub top: End,
    /// What a run with it is called.
    pub title: &'static str,
    /// What a packed sample is, where `{height}` stands for its height in metres.
    pub packed: &'static str,
    /// What the drive moves.
    pub driven: &'static str,
    /// Where the stresses of the time series act.
    pub place: &'static str,
    /// Columns of the time series that hold something else than between walls of grains, and what.
    meanings: &'static [Meaning],
    /// What the mass of the top is, unless a scene gives it.
    pub top_mass: TopMass,
}

/// What a column holds.
#[derive(Debug, PartialEq, Eq)]
struct Meaning {
    column: &'static str,
    doc: &'static str,
}

/// The mass of the top of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TopMass {
    /// That of its grains.
    OfItsGrains,
    /// About that of a layer of grains: a plane has none.
    OfALayer,
    /// All grains times (d̄/h)² in a cell of height h: as the cell is stretched through all layers,
    /// its frequency is then about that of a contact, which the time step resolves and the dampers
    /// of the contacts damp.
    OfTheCell,
}

/// Two walls of frozen grains.
pub static ROUGH_WALLS: Boundary = Boundary {
    name: "rough walls",
    key: "walls",
    walls_keys: &["layers", "types"],
    bottom: End::Grains,
    top: End::Grains,
    title: "Shear between walls",
    packed: "walls frozen, {height} m between them",
    driven: "top wall",
    place: "on the top wall",
    meanings: &[],
    top_mass: TopMass::OfItsGrains,
};

/// Two rigid planes.
pub static FLAT_WALLS: Boundary = Boundary {
    name: "flat walls",
    walls_keys: &["flat"],
    bottom: End::Plane,
    top: End::Plane,
    packed: "{height} m between flat walls",
    meanings: &[Meaning {
        column: "wall_height",
        doc: "h, distance between the walls",
    }],
    top_mass: TopMass::OfALayer,
    ..ROUGH_WALLS
};

/// A bottom of frozen grains, and a rigid plane above.
pub static FLAT_TOP: Boundary = Boundary {
    name: "flat top",
    walls_keys: &["flat-top"],
    top: End::Plane,
    packed: "bottom frozen, {height} m between it and the flat top",
    meanings: &[Meaning {
        column: "wall_height",
        doc: "h, distance of the top wall from the plane at which the bottom wall was cut",
    }],
    top_mass: TopMass::OfALayer,
    ..ROUGH_WALLS
};

/// A bottom of frozen grains, and nothing above.
pub static FREE_SURFACE: Boundary = Boundary {
    name: "free surface",
    key: "free",
    walls_keys: &["layers", "types"],
    bottom: End::Grains,
    top: End::Nothing,
    title: "Flow below a free surface",
    packed: "bottom frozen, {height} m above it",
    driven: "bottom wall",
    place: "on the bottom wall",
    meanings: &[
        Meaning {
            column: "strain",
            doc: "0: nothing above the sample moves",
        },
        Meaning {
            column: "stress_ratio",
            doc: "τ = S/N; NaN while nothing touches the bottom wall",
        },
        Meaning {
            column: "normal_force",
            doc: "N, normal force of the free grains on the bottom wall",
        },
        Meaning {
            column: "shear_force",
            doc: "S, force of the free grains on the bottom wall along x",
        },
        Meaning {
            column: "wall_height",
            doc: "h, twice the height of the centre of mass of the free grains above the bottom wall",
        },
        Meaning {
            column: "wall_velocity",
            doc: "velocity at which that height grows",
        },
        Meaning {
            column: "slip",
            doc: "0: nothing above the sample moves",
        },
        Meaning {
            column: "slip_rate",
            doc: "0: nothing above the sample moves",
        },
        Meaning {
            column: "drive_displacement",
            doc: "0: nothing above the sample moves",
        },
        Meaning {
            column: "drive_velocity",
            doc: "0: nothing above the sample moves",
        },
        Meaning {
            column: "work_drive",
            doc: "work of a bottom wall that vibrates along x on the sample",
        },
        Meaning {
            column: "work_load",
            doc: "work of gravity, and of a bottom wall that vibrates along its normal, on the sample",
        },
        Meaning {
            column: "imposed_normal_force",
            doc: "NaN: nothing is above the sample",
        },
        Meaning {
            column: "imposed_shear_force",
            doc: "NaN: nothing is above the sample",
        },
        Meaning {
            column: "bottom_displacement",
            doc: "displacement of the bottom wall upwards",
        },
    ],
    ..ROUGH_WALLS
};

/// A flat bottom, and nothing above.
pub static FREE_SURFACE_ABOVE_PLANE: Boundary = Boundary {
    name: "free surface above a plane",
    walls_keys: &["flat"],
    bottom: End::Plane,
    packed: "{height} m above a flat bottom",
    top_mass: TopMass::OfALayer,
    ..FREE_SURFACE
};

/// A cell that is periodic along its last axis, too; sheared, or strained.
pub static PERIODIC: Boundary = Boundary {
    name: "periodic",
    key: "periodic",
    walls_keys: &[],
    bottom: End::Images,
    top: End::Images,
    title: "Shear without walls",
    packed: "{height} m high, without walls",
    driven: "image above the cell",
    place: "of the cell",
    meanings: &[
        Meaning {
            column: "strain",
            doc: "γ, displacement of the images above over the height at the start",
        },
        Meaning {
            column: "stress_ratio",
            doc: "τ = S/N",
        },
        Meaning {
            column: "normal_force",
            doc: "N, normal stress of the cell along its height, times its base at the start",
        },
        Meaning {
            column: "shear_force",
            doc: "S, shear stress of the cell against the motion of the images, times its base at the start",
        },
        Meaning {
            column: "wall_height",
            doc: "h, height of the cell",
        },
        Meaning {
            column: "wall_velocity",
            doc: "velocity at which the height of the cell grows",
        },
        Meaning {
            column: "slip",
            doc: "displacement of the images above along x",
        },
        Meaning {
            column: "slip_rate",
            doc: "velocity of the images above along x",
        },
        Meaning {
            column: "drive_displacement",
            doc: "displacement of the far end of the spring, or of the images themselves",
        },
        Meaning {
            column: "drive_velocity",
            doc: "velocity of the far end of the spring, or of the images themselves",
        },
        Meaning {
            column: "work_drive",
            doc: "work of the drive on the sample",
        },
        Meaning {
            column: "work_load",
            doc: "work of the stresses that change the lengths of the cell on the sample",
        },
        Meaning {
            column: "imposed_normal_force",
            doc: "N imposed on the cell; NaN while the velocity of its height or the mean stress is imposed",
        },
        Meaning {
            column: "imposed_shear_force",
            doc: "S imposed on the cell along x; NaN while the images move with the drive",
        },
        Meaning {
            column: "bottom_displacement",
            doc: "0: there is no wall",
        },
        Meaning {
            column: "bottom_displacement_x",
            doc: "0: there is no wall",
        },
    ],
    top_mass: TopMass::OfTheCell,
};

/// All kinds. The first with a value of `sample.boundary` is its default.
pub static KINDS: [&Boundary; 6] = [
    &ROUGH_WALLS,
    &FLAT_WALLS,
    &FLAT_TOP,
    &PERIODIC,
    &FREE_SURFACE,
    &FREE_SURFACE_ABOVE_PLANE,
];

/// The values of the key `sample.boundary`.
pub const KEYS: [&str; 3] = ["walls", "periodic", "free"];
/// Those of the key `sample.walls`.
pub const WALLS_KEYS: [&str; 4] = ["layers", "types", "flat", "flat-top"];

/// Columns of the time series that not every scene with a boundary has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "each says whether some columns are there"
)]
pub struct FurtherColumns {
    /// Those of [`ImposedRow`] ([`Boundary::shows_imposed`]).
    pub imposed: bool,
    /// Those of [`LateralRow`] ([`Protocol::has_lateral`]).
    pub lateral: bool,
    /// Those of [`BottomRow`]: the bottom vibrates along x.
    pub bottom: bool,
    /// Those of [`TemperatureRow`] (`output.temperatures`).
    pub temperatures: bool,
}

impl FurtherColumns {
    /// All of them.
    pub const ALL: Self = Self {
        imposed: true,
        lateral: true,
        bottom: true,
        temperatures: true,
    };

    /// All combinations.
    fn combinations() -> impl Iterator<Item = Self> {
        (0..16).map(|bits| Self {
            imposed: bits & 1 != 0,
            lateral: bits & 2 != 0,
            bottom: bits & 8 != 0,
            temperatures: bits & 4 != 0,
        })
    }
}

impl Boundary {
    /// The kind of this name.
    pub fn named(name: &str) -> Option<&'static Self> {
        KINDS.into_iter().find(|kind| kind.name == name)
    }

    /// The kind of these values of `sample.boundary` and `sample.walls`.
    pub fn of_keys(boundary: &str, walls: Option<&str>) -> Option<&'static Self> {
        let kinds = KINDS.into_iter().filter(|kind| kind.key == boundary);
        let kinds: Vec<_> = kinds.collect();
        let chosen = walls.and_then(|walls| {
            let mut kinds = kinds.iter();
            kinds.find(|kind| kind.walls_keys.contains(&walls))
        });
        chosen.or(kinds.first()).copied()
    }

    /// The number of walls.
    pub fn walls(&self) -> usize {
        [self.bottom, self.top]
            .into_iter()
            .filter(|end| end.is_wall())
            .count()
    }

    /// Whether there is a wall.
    pub fn has_walls(&self) -> bool {
        self.walls() > 0
    }

    /// Whether a wall is of grains.
    pub fn has_grains(&self) -> bool {
        [self.bottom, self.top].contains(&End::Grains)
    }

    /// Whether a wall is a plane.
    pub fn has_planes(&self) -> bool {
        [self.bottom, self.top].contains(&End::Plane)
    }

    /// Whether the sample is periodic along its last axis, too.
    pub fn is_periodic(&self) -> bool {
        self.top == End::Images
    }

    /// Whether something is above the sample, which a load presses and a drive moves.
    pub fn has_top(&self) -> bool {
        self.top != End::Nothing
    }

    /// The bodies of the walls of grains.
    pub fn bodies(&self) -> impl Iterator<Item = u32> {
        [(self.bottom, body::BOTTOM), (self.top, body::TOP)]
            .into_iter()
            .filter(|(end, _)| *end == End::Grains)
            .map(|(_, body)| body)
    }

    /// The heights (m) of the ends of which `is_there` holds, of `heights` below and above;
    /// infinite where it does not.
    fn heights_where(&self, is_there: impl Fn(End) -> bool, heights: [f64; 2]) -> [f64; 2] {
        let [mut low, mut high] = heights;
        if !is_there(self.bottom) {
            low = f64::NEG_INFINITY;
        }
        if !is_there(self.top) {
            high = f64::INFINITY;
        }
        [low, high]
    }

    /// The heights (m) of the ends, of `heights` below and above; infinite where nothing is.
    pub fn ends(&self, heights: [f64; 2]) -> [f64; 2] {
        self.heights_where(|end| end != End::Nothing, heights)
    }

    /// The heights (m) at which walls of grains are cut from the sample, of `heights` below and
    /// above; infinite where no wall is of grains.
    pub fn cuts(&self, heights: [f64; 2]) -> [f64; 2] {
        self.heights_where(|end| end == End::Grains, heights)
    }

    /// The heights (m) of the planes, of `heights` below and above, infinite where there is none;
    /// `None` without planes.
    pub fn planes(&self, heights: [f64; 2]) -> Option<[f64; 2]> {
        if !self.has_planes() {
            return None;
        }
        Some(self.heights_where(|end| end == End::Plane, heights))
    }

    /// The heights (m) of the edges of a packing: of its box where there are planes, else of its
    /// grains.
    pub fn edges(&self, box_edges: [f64; 2], grain_edges: [f64; 2]) -> [f64; 2] {
        let [mut low, mut high] = grain_edges;
        if self.bottom == End::Plane {
            low = box_edges[0];
        }
        if self.top == End::Plane {
            high = box_edges[1];
        }
        [low, high]
    }

    /// The body of the wall whose forces are in the time series: the top, or the bottom where
    /// nothing is above.
    pub(crate) fn measured_body(&self) -> u32 {
        if self.has_top() {
            body::TOP
        } else {
            body::BOTTOM
        }
    }

    /// Whether rows of the time series have the columns of what a protocol imposes: of a top, if
    /// that is more than its velocity along x, and of a bottom that vibrates.
    pub fn shows_imposed(&self, protocol: &Protocol) -> bool {
        if self.has_top() {
            protocol.is_more_than_velocities()
        } else {
            protocol.has_bottom()
        }
    }

    /// A column of the time series, as what it holds with this boundary.
    fn meant(&self, column: Column) -> Column {
        let meaning = self
            .meanings
            .iter()
            .find(|known| known.column == column.name);
        match meaning {
            Some(meaning) => Column {
                doc: meaning.doc,
                ..column
            },
            None => column,
        }
    }

    /// The further columns of the time series: of the stress of a cell without walls, and of the
    /// flow below a free surface.
    fn further_columns(&self) -> &'static [Column] {
        if self.is_periodic() {
            &StressRow::COLUMNS
        } else if self.has_top() {
            &[]
        } else {
            &FlowRow::COLUMNS
        }
    }

    /// Columns of the time series: those of [`SeriesRow`], of [`ImposedRow`] and [`BottomRow`] if
    /// there are some, of [`StressRow`] if there are no walls, of [`FlowRow`] below a free surface,
    /// and of [`LateralRow`] and [`TemperatureRow`] if there are some.
    pub fn series_columns(&self, further: FurtherColumns) -> &'static [Column] {
        type OfKind = Vec<(FurtherColumns, Vec<Column>)>;
        static ALL: LazyLock<Vec<OfKind>> = LazyLock::new(|| {
            let kinds = KINDS.into_iter();
            let of_kind = |kind: &Boundary| {
                let all = FurtherColumns::combinations();
                all.map(|further| (further, kind.columns_with(further)))
                    .collect()
            };
            kinds.map(of_kind).collect()
        });
        let kind = KINDS.iter().position(|kind| *kind == self);
        let mut combinations = ALL[kind.unwrap_or_default()].iter();
        let columns = combinations.find(|(combination, _)| *combination == further);
        columns.map_or(&[], |(_, columns)| columns)
    }

    /// [`Boundary::series_columns`], made anew.
    fn columns_with(&self, further: FurtherColumns) -> Vec<Column> {
        let mut columns = SeriesRow::COLUMNS.to_vec();
        if further.imposed {
            columns.extend(ImposedRow::COLUMNS);
        }
        if further.bottom {
            columns.extend(BottomRow::COLUMNS);
        }
        columns.extend(self.further_columns());
        if further.lateral {
            columns.extend(LateralRow::COLUMNS);
        }
        if further.temperatures {
            columns.extend(TemperatureRow::COLUMNS);
        }
        columns.iter().map(|column| self.meant(*column)).collect()
    }

    /// The columns of the time series of all kinds.
    pub fn all_series_columns() -> Vec<Column> {
        let mut columns = ROUGH_WALLS.series_columns(FurtherColumns::ALL).to_vec();
        for kind in KINDS {
            for column in kind.further_columns() {
                if !columns.contains(column) {
                    columns.push(*column);
                }
            }
        }
        columns
    }
}

/// That of a scene that names none.
impl Default for &Boundary {
    fn default() -> Self {
        &ROUGH_WALLS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kind_is_found_by_its_name_and_by_its_keys() {
        for kind in KINDS {
            assert!(KEYS.contains(&kind.key));
            assert_eq!(Boundary::named(kind.name), Some(kind));
            for walls in kind.walls_keys {
                assert!(WALLS_KEYS.contains(walls));
                assert_eq!(Boundary::of_keys(kind.key, Some(walls)), Some(kind));
            }
        }
        assert_eq!(Boundary::of_keys("walls", None), Some(&ROUGH_WALLS));
        assert_eq!(Boundary::of_keys("free", None), Some(&FREE_SURFACE));
        // Nothing is flat in a periodic cell.
        assert_eq!(Boundary::of_keys("periodic", Some("flat")), Some(&PERIODIC));
        assert_eq!(Boundary::of_keys("walls of glass", None), None);
    }

    /// No column is said to be of a wall that is not there, and no meaning is of a column that is
    /// not.
    #[test]
    fn columns_are_of_what_is_there() {
        for kind in KINDS {
            let columns = kind.series_columns(FurtherColumns::ALL);
            for meaning in kind.meanings {
                assert!(columns.iter().any(|column| column.name == meaning.column));
            }
            for Column { name, doc, .. } in columns {
                for (end, wall) in [(kind.top, "top wall"), (kind.bottom, "bottom wall")] {
                    assert!(
                        end.is_wall() || !doc.contains(wall),
                        "{}: {name}",
                        kind.name
                    );
                }
                assert!(kind.has_walls() || !doc.contains("walls"), "{name}");
            }
        }
    }

    #[test]
    fn ends_are_where_something_is() {
        let heights = [1.0, 2.0];
        assert_eq!(ROUGH_WALLS.ends(heights), heights);
        assert_eq!(FREE_SURFACE.ends(heights), [1.0, f64::INFINITY]);
        assert_eq!(FREE_SURFACE.cuts(heights), [1.0, f64::INFINITY]);
        assert_eq!(FLAT_WALLS.cuts(heights), [f64::NEG_INFINITY, f64::INFINITY]);
        assert_eq!(ROUGH_WALLS.planes(heights), None);
        assert_eq!(FLAT_WALLS.planes(heights), Some(heights));
        let below = FREE_SURFACE_ABOVE_PLANE.planes(heights);
        assert_eq!(below, Some([1.0, f64::INFINITY]));
        let bodies: Vec<u32> = KINDS.into_iter().flat_map(Boundary::bodies).collect();
        assert_eq!(
            bodies,
            [body::BOTTOM, body::TOP, body::BOTTOM, body::BOTTOM]
        );
        assert_eq!(FLAT_TOP.cuts(heights), [1.0, f64::INFINITY]);
        assert_eq!(FLAT_TOP.planes(heights), Some([f64::NEG_INFINITY, 2.0]));
        // A plane is where the box ends, which is not where its grains do.
        let grains = [1.25, 1.75];
        assert_eq!(ROUGH_WALLS.edges(heights, grains), grains);
        assert_eq!(FLAT_WALLS.edges(heights, grains), heights);
        assert_eq!(FLAT_TOP.edges(heights, grains), [1.25, 2.0]);
        assert_eq!(FREE_SURFACE_ABOVE_PLANE.edges(heights, grains), [1.0, 1.75]);
    }
}
