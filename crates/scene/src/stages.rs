//! What is done to a sample, in the order in which it is done.

use gshear_dem::boundary::Boundary;
use gshear_dem::laws::keys::KeyReader;
use toml::de::DeTable;

use crate::checker::Checker;
use crate::general::SCENE;
use crate::quasi_static::{Newtonian, QuasiStatic};
use crate::sample::{Origin, SAMPLE};
use crate::value::Value;
use crate::walls::PlaneShear;
use crate::words::{list, quoted_list};

/// A stage of a run that writes frames and a time series. What prepares the sample comes before the
/// first one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RunStage {
    /// Shear at a rate: `[shear]`.
    Shear,
    /// Relaxation and quasi-static strain: `[relax]` and `[aqs]`.
    Strain,
    /// Newton's equations: `[newtonian]`.
    Newtonian,
}

impl RunStage {
    /// All, in the order in which they run unless the scene says otherwise.
    pub const ALL: [Self; 3] = [Self::Shear, Self::Strain, Self::Newtonian];

    /// The name, as messages, checkpoints and the key `stages` have it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Shear => "shear",
            Self::Strain => "aqs",
            Self::Newtonian => "newtonian",
        }
    }

    /// The stage of this name.
    pub(crate) fn by_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|stage| stage.name() == name)
    }

    /// The name of a file made of this stage, which is `name` for a shear.
    pub fn named(self, name: &str) -> String {
        match self {
            Self::Shear => name.into(),
            _ => format!("{}-{name}", self.name()),
        }
    }
}

/// The stages of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Stages {
    /// The order in which they run, each once.
    pub order: Vec<RunStage>,
    /// Shear at a rate.
    pub shear: Option<PlaneShear>,
    /// Relaxation and quasi-static strain.
    pub strain: Option<QuasiStatic>,
    /// Newton's equations, from the state at rest before.
    pub newtonian: Option<Newtonian>,
}

impl Stages {
    /// The first one.
    pub fn first(&self) -> RunStage {
        self.order[0]
    }

    /// The last one.
    pub fn last(&self) -> RunStage {
        self.order[self.order.len() - 1]
    }

    /// Whether there is this one.
    pub fn has(&self, stage: RunStage) -> bool {
        self.order.contains(&stage)
    }

    /// Those after this one, in order.
    pub fn after(&self, stage: RunStage) -> &[RunStage] {
        let at = self.order.iter().position(|known| *known == stage);
        at.map_or(&[], |at| &self.order[at + 1..])
    }

    /// The shear, if it comes first.
    pub(crate) fn first_shear(&self) -> Option<&PlaneShear> {
        if self.first() == RunStage::Shear {
            self.shear.as_ref()
        } else {
            None
        }
    }

    /// The strain steps, if they come first.
    pub fn first_strain(&self) -> Option<&QuasiStatic> {
        if self.first() == RunStage::Strain {
            self.strain.as_ref()
        } else {
            None
        }
    }

    /// Where the grains of the first stage come from.
    pub fn origin(&self) -> &Origin {
        match (self.first_shear(), self.first_strain()) {
            (Some(shear), _) => &shear.origin,
            (_, Some(strain)) => &strain.origin,
            _ => unreachable!("the first stage is one that the scene has"),
        }
    }
}

/// The stages whose tables a configuration has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct GivenStages {
    /// Without any, it shears, and the keys of that are missing.
    pub shears: bool,
    pub strains: bool,
}

impl GivenStages {
    /// Those of this tree.
    pub fn of(tree: &DeTable<'_>) -> Self {
        let has = |name: &str| tree.contains_key(name);
        let strains = ["relax", "aqs", "newtonian"].into_iter().any(has);
        Self {
            shears: !strains || has("shear"),
            strains,
        }
    }

    /// The order of the stages, by the key `stages` if it is given.
    pub fn order(self, c: &mut Checker<'_>, has_newtonian: bool) -> Vec<RunStage> {
        let mut natural = Vec::new();
        if self.shears {
            natural.push(RunStage::Shear);
        }
        if self.strains {
            natural.push(RunStage::Strain);
        }
        if has_newtonian {
            natural.push(RunStage::Newtonian);
        }
        let key = &SCENE.stages;
        let order = match c.value(key) {
            Some(Value::Names(given)) => {
                let given = given.clone();
                match ordered(&given, &natural) {
                    Ok(order) => order,
                    Err(what) => {
                        c.refuse(key, &what);
                        natural.clone()
                    }
                }
            }
            _ => natural.clone(),
        };
        if self.shears && self.strains {
            let names = order.iter().map(|stage| stage.name().to_string());
            c.fill(key, Value::Names(names.collect()));
        } else {
            // There is no other order.
            c.omit(&[key]);
        }
        order
    }

    /// Refuses quasi-static strain of a sample that is not periodic along all axes.
    pub(crate) fn check_boundary(self, c: &mut Checker<'_>, boundary: &Boundary) {
        if !self.strains || boundary.is_periodic() {
            return;
        }
        let what = "quasi-static strain ([relax], [aqs], [newtonian]) needs a cell that is periodic along all axes: give sample.boundary = \"periodic\", or leave those tables out";
        if c.is_given(&SAMPLE.boundary) {
            c.refuse(&SAMPLE.boundary, what);
        } else {
            c.lacks("sample", "boundary = \"periodic\", as quasi-static strain ([relax], [aqs], [newtonian]) needs a cell that is periodic along all axes");
        }
    }
}

/// The stages of these names, which must be those of the scene. Newton's equations begin at rest,
/// and so after strain steps.
fn ordered(names: &[String], natural: &[RunStage]) -> Result<Vec<RunStage>, String> {
    let all = || quoted_list(natural.iter().map(|stage| stage.name()), "and");
    let mut order = Vec::new();
    for name in names {
        let Some(stage) = RunStage::by_name(name) else {
            let known = quoted_list(RunStage::ALL.map(RunStage::name), "or");
            return Err(format!("each must be {known}, found {name:?}"));
        };
        if !natural.contains(&stage) {
            return Err(format!(
                "names {name:?}, and the scene has no [{name}]; give the table, or leave the name out"
            ));
        }
        if order.contains(&stage) {
            return Err(format!("names {name:?} twice; each stage runs once"));
        }
        order.push(stage);
    }
    let missing = natural.iter().filter(|stage| !order.contains(stage));
    let missing: Vec<String> = missing.map(|stage| format!("[{}]", stage.name())).collect();
    if !missing.is_empty() {
        return Err(format!(
            "leaves out {}, which the scene has; name {}",
            list(&missing, "and"),
            all()
        ));
    }
    let at = |stage| order.iter().position(|known| *known == stage);
    if let Some(moves) = at(RunStage::Newtonian)
        && (moves + 1 != order.len() || at(RunStage::Strain) != moves.checked_sub(1))
    {
        return Err(
            "must end with \"aqs\" and \"newtonian\": Newton's equations begin with a state at rest, and nothing follows them"
                .into(),
        );
    }
    Ok(order)
}
