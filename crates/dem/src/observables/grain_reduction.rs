//! A quantity of the grains of a region, reduced to a number.

use super::{Expression, Grain, Needs, Observable, SampleView, Total};
use crate::columns::Column;
use crate::dimension::Dimensions;
use crate::state::body;

/// A quantity of a grain that a scene can name.
#[derive(Debug, Clone, Copy)]
pub struct GrainQuantity {
    /// Name, unit and meaning.
    pub column: Column,
    /// Whether it follows from the contacts of the grain.
    of_contacts: bool,
    /// Whether disks lack it.
    of_spheres: bool,
    value: fn(&SampleView, &Grain) -> f64,
}

impl PartialEq for GrainQuantity {
    fn eq(&self, other: &Self) -> bool {
        self.column == other.column
    }
}

impl GrainQuantity {
    const fn new(
        name: &'static str,
        unit: &'static str,
        doc: &'static str,
        value: fn(&SampleView, &Grain) -> f64,
    ) -> Self {
        Self {
            column: Column::new(name, unit, doc),
            of_contacts: false,
            of_spheres: false,
            value,
        }
    }

    const fn of_contacts(self) -> Self {
        Self {
            of_contacts: true,
            ..self
        }
    }

    const fn of_spheres(self) -> Self {
        Self {
            of_spheres: true,
            ..self
        }
    }
}

/// Σ v².
fn square(v: &[f64; 3]) -> f64 {
    v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
}

fn kinetic_energy(grain: &Grain) -> f64 {
    let translation = grain.mass * square(&grain.peculiar_velocity);
    let rotation = grain.inertia * square(&grain.angular_velocity);
    0.5 * (translation + rotation)
}

const QUANTITIES: [GrainQuantity; 20] = [
    GrainQuantity::new("x", "m", "wrapped position", |_, g| g.position[0]),
    GrainQuantity::new("y", "m", "likewise", |_, g| g.position[1]),
    GrainQuantity::new("z", "m", "likewise", |_, g| g.position[2]).of_spheres(),
    GrainQuantity::new("height", "m", "height above the bottom", |sample, g| {
        g.position[sample.up()] - sample.bottom
    }),
    GrainQuantity::new("v_x", "m s-1", "velocity", |_, g| g.velocity[0]),
    GrainQuantity::new("v_y", "m s-1", "likewise", |_, g| g.velocity[1]),
    GrainQuantity::new("v_z", "m s-1", "likewise", |_, g| g.velocity[2]).of_spheres(),
    GrainQuantity::new("speed", "m s-1", "magnitude of the velocity", |_, g| {
        square(&g.velocity).sqrt()
    }),
    GrainQuantity::new(
        "spin",
        "rad s-1",
        "angular velocity; of spheres its magnitude",
        |sample, g| match sample.dimension {
            Dimensions::Two => g.angular_velocity[2],
            Dimensions::Three => square(&g.angular_velocity).sqrt(),
        },
    ),
    GrainQuantity::new("spin_x", "rad s-1", "angular velocity", |_, g| {
        g.angular_velocity[0]
    })
    .of_spheres(),
    GrainQuantity::new("spin_y", "rad s-1", "likewise", |_, g| {
        g.angular_velocity[1]
    })
    .of_spheres(),
    GrainQuantity::new("spin_z", "rad s-1", "likewise", |_, g| {
        g.angular_velocity[2]
    })
    .of_spheres(),
    GrainQuantity::new("radius", "m", "R", |_, g| g.radius),
    GrainQuantity::new("mass", "kg", "m", |_, g| g.mass),
    GrainQuantity::new(
        "kinetic_energy",
        "J",
        "translation and rotation; in a cell without walls of the velocity less that of streaming",
        |_, g| kinetic_energy(g),
    ),
    GrainQuantity::new(
        "material",
        "1",
        "number of the material in the order of `[[material]]`, from 0",
        |_, g| g.material as f64,
    ),
    GrainQuantity::new("coordination", "1", "number of contacts", |_, g| {
        f64::from(g.contacts)
    })
    .of_contacts(),
    GrainQuantity::new(
        "normal_force",
        "N",
        "sum of F_n over the contacts",
        |_, g| g.normal_force,
    )
    .of_contacts(),
    GrainQuantity::new(
        "bottom_contacts",
        "1",
        "number of contacts with the bottom wall, of grains or flat",
        |_, g| f64::from(g.wall_contacts[0]),
    )
    .of_contacts(),
    GrainQuantity::new("top_contacts", "1", "likewise of the top wall", |_, g| {
        f64::from(g.wall_contacts[1])
    })
    .of_contacts(),
];

/// The quantities of a grain in a dimension.
pub fn quantities(dimension: Dimensions) -> impl Iterator<Item = GrainQuantity> {
    let is_there =
        move |quantity: &GrainQuantity| dimension == Dimensions::Three || !quantity.of_spheres;
    QUANTITIES.into_iter().filter(is_there)
}

/// A number of a grain.
#[derive(Debug, Clone, PartialEq)]
pub struct Quantity {
    expression: Expression,
    /// Those that it names.
    named: Vec<GrainQuantity>,
}

impl Quantity {
    /// A formula of quantities of a grain in a dimension.
    ///
    /// # Panics
    /// If it has other names.
    pub fn new(expression: Expression, dimension: Dimensions) -> Self {
        let named = expression.names().iter().map(|name| {
            let known = quantities(dimension).find(|known| known.column.name == name);
            known.unwrap_or_else(|| panic!("{name} is no quantity of a grain"))
        });
        Self {
            named: named.collect(),
            expression,
        }
    }

    fn value(&self, sample: &SampleView, grain: &Grain) -> f64 {
        let value = |name: usize| (self.named[name].value)(sample, grain);
        self.expression.evaluate(value)
    }

    fn is_of_contacts(&self) -> bool {
        self.named.iter().any(|quantity| quantity.of_contacts)
    }
}

/// What becomes of the numbers of several grains.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reduction {
    /// NaN without a grain.
    Mean,
    /// 0 without a grain.
    Sum,
    /// NaN without a grain.
    Least,
    /// NaN without a grain.
    Greatest,
    /// The number of grains.
    Count,
}

/// The grains that count.
#[derive(Debug, Clone, PartialEq)]
pub struct Selection {
    /// Their bodies; see [`body`].
    pub bodies: Vec<u32>,
    /// Along each axis from ≤ s < to, where s is the position of the centre over the length of the
    /// sample, along the last axis from the bottom on.
    pub places: [Option<[f64; 2]>; 3],
    /// From ≤ R ≤ to (m).
    pub radii: Option<[f64; 2]>,
    /// Not 0.
    pub condition: Option<Quantity>,
}

impl Selection {
    /// The free grains.
    pub fn free() -> Self {
        Self {
            bodies: vec![body::FREE],
            places: [None; 3],
            radii: None,
            condition: None,
        }
    }

    fn has(&self, sample: &SampleView, grain: &Grain) -> bool {
        if !self.bodies.contains(&grain.body) {
            return false;
        }
        if let Some([from, to]) = self.radii
            && !(from..=to).contains(&grain.radius)
        {
            return false;
        }
        for (axis, place) in self.places.iter().enumerate() {
            let Some([from, to]) = place else { continue };
            let origin = if axis == sample.up() {
                sample.bottom
            } else {
                0.0
            };
            let s = (grain.position[axis] - origin) / sample.lengths[axis];
            if !(*from..*to).contains(&s) {
                return false;
            }
        }
        let condition = self.condition.as_ref();
        condition.is_none_or(|condition| condition.value(sample, grain) != 0.0)
    }
}

/// A quantity of some grains, reduced to a number.
#[derive(Debug, Clone, PartialEq)]
pub struct GrainReduction {
    /// The grains.
    pub selection: Selection,
    /// What is reduced; `None` counts.
    pub quantity: Option<Quantity>,
    /// How.
    pub reduction: Reduction,
}

impl Observable for GrainReduction {
    fn needs(&self) -> Needs {
        let quantities = self.quantity.iter().chain(&self.selection.condition);
        Needs {
            contacts_of_grains: quantities.into_iter().any(Quantity::is_of_contacts),
            contacts: false,
            extremes: matches!(self.reduction, Reduction::Least | Reduction::Greatest),
        }
    }

    fn grain(&self, sample: &SampleView, grain: &Grain, totals: &mut [Total]) {
        if !self.selection.has(sample, grain) {
            return;
        }
        match &self.quantity {
            Some(quantity) => totals[0].add(quantity.value(sample, grain)),
            None => totals[0].count(),
        }
    }

    fn value(&self, _: &SampleView, totals: &[Total]) -> f64 {
        let total = &totals[0];
        match self.reduction {
            Reduction::Mean => total.mean(),
            Reduction::Sum => total.sum(),
            Reduction::Least => total.least(),
            Reduction::Greatest => total.greatest(),
            Reduction::Count => total.terms() as f64,
        }
    }
}
