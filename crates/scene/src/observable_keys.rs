//! The keys of `[[observable]]`, and the words that they take.

use std::ops::Bound::Excluded;

use gshear_dem::laws::keys::{ANY, Bounds, NOT_NEGATIVE};
use gshear_dem::observables::{Reduction, StressComponent};
use gshear_dem::state::body;

use crate::table::{names, table};

/// What a scene may call the ways to reduce a quantity.
pub(crate) const REDUCTIONS: [(&str, Reduction); 5] = [
    ("mean", Reduction::Mean),
    ("sum", Reduction::Sum),
    ("min", Reduction::Least),
    ("max", Reduction::Greatest),
    ("count", Reduction::Count),
];
static REDUCTION_NAMES: [&str; 5] = names(&REDUCTIONS);

/// The components of a stress.
pub(crate) const COMPONENTS: [(&str, StressComponent); 2] = [
    ("normal", StressComponent::Normal),
    ("shear", StressComponent::Shear),
];
static COMPONENT_NAMES: [&str; 2] = names(&COMPONENTS);

/// Which grains count, by their bodies.
pub(crate) const BODIES: [(&str, &[u32]); 5] = [
    ("free", &[body::FREE]),
    ("walls", &[body::BOTTOM, body::TOP]),
    ("bottom", &[body::BOTTOM]),
    ("top", &[body::TOP]),
    ("all", &[body::FREE, body::BOTTOM, body::TOP]),
];
static BODY_NAMES: [&str; 5] = names(&BODIES);

/// A height inside the sample over h.
const INSIDE: Bounds = Bounds::new(Excluded(0.0), Excluded(1.0));

table! {
    /// The keys of an `[[observable]]`.
    OBSERVABLE: ObservableKeys "observable" Sheared Resume {
        /// name of the column
        name: Text(&[]) { condition: "letters, digits and underscores; no column of the program" },
        /// unit of the column, as the files are to have it
        unit: Text(&[]) {
            otherwise: "that of the quantity, of formulas none",
        },
        /// of a grain: `v_x`, or a formula of such quantities
        quantity: Text(&[]) { condition: "a quantity of a grain, or a formula of these" },
        /// what becomes of the quantities of the grains that count
        reduce: Text(&REDUCTION_NAMES) { default: REDUCTION_NAMES[0] },
        /// grains that count: free, of a wall, or all
        grains: Text(&BODY_NAMES) { default: BODY_NAMES[0] },
        /// grains that count: from ≤ x/L_x < to
        x: Numbers(ANY) { condition: "two, from < to" },
        /// grains that count: from ≤ y/L_y < to; of disks, over h from the bottom
        y: Numbers(ANY) { condition: "two, from < to" },
        /// grains that count, in 3D: from ≤ z/h < to, from the bottom
        z: Numbers(ANY) { condition: "two, from < to" },
        /// grains that count: from ≤ R ≤ to
        radius: Numbers(NOT_NEGATIVE) { unit: "m", condition: "two, from ≤ to" },
        /// grains that count: a formula of quantities of a grain that is not 0, such as
        /// `coordination >= 4`
        condition: Text(&[]) { condition: "a formula of quantities of a grain" },
        /// instead of a quantity: height over h of a plane, through which the contacts transmit
        /// the stress
        plane: Number(INSIDE) {},
        /// of the stress on the plane
        component: Text(&COMPONENT_NAMES) { default: COMPONENT_NAMES[0] },
        /// instead of a quantity: a formula of `time`, columns of the program and observables above
        expression: Text(&[]) { condition: "a formula of columns" },
        /// instead of a quantity: an observable that the program registers
        kind: Text(&[]) { condition: "in a program of your own" },
    }
}
