//! The numbers and vectors that `run.h5` holds of every contact.

use gshear_dem::state::ContactSample;
use gshear_store::trajectory::Form;

/// A number, or the components of a vector, of a contact.
pub struct ContactQuantity {
    /// Name of its dataset.
    pub name: &'static str,
    /// Whether it is a tangential vector, of one component in 2D and three in 3D.
    tangential: bool,
    value: fn(&ContactSample) -> [f64; 3],
}

impl ContactQuantity {
    const fn new(
        name: &'static str,
        tangential: bool,
        value: fn(&ContactSample) -> [f64; 3],
    ) -> Self {
        Self {
            name,
            tangential,
            value,
        }
    }

    /// Number of its components in so many dimensions.
    pub fn components(&self, axes: usize) -> usize {
        if self.tangential && axes == 3 { 3 } else { 1 }
    }

    /// The values of its components.
    pub fn values(&self, axes: usize, contact: &ContactSample) -> impl Iterator<Item = f64> {
        let components = self.components(axes);
        (self.value)(contact).into_iter().take(components)
    }
}

const ALL: [ContactQuantity; 9] = [
    ContactQuantity::new("normal_force", false, |c| [c.normal_force; 3]),
    ContactQuantity::new("tangential_force", true, |c| c.tangential_force),
    ContactQuantity::new("tangential_history", true, |c| c.tangential_history),
    ContactQuantity::new("rolling_history", true, |c| match c.torques {
        [0.0, 0.0, 0.0, _] => [c.rolling_history, 0.0, 0.0],
        [x, y, z, _] => [x, y, z],
    }),
    ContactQuantity::new("twisting_history", false, |c| [c.torques[3]; 3]),
    ContactQuantity::new("overlap", false, |c| [c.overlap; 3]),
    ContactQuantity::new("sliding", false, |c| [c.sliding as f64; 3]),
    ContactQuantity::new("rolling", false, |c| [c.rolling as f64; 3]),
    ContactQuantity::new("twisting", false, |c| [c.twisting as f64; 3]),
];

/// All quantities of a contact apart from its grains.
pub fn of_contacts(form: Form) -> impl Iterator<Item = &'static ContactQuantity> {
    let is_known = move |of: &&ContactQuantity| match of.name {
        "rolling_history" | "rolling" => form.axes == 2 || form.torques,
        "twisting_history" | "twisting" => form.torques,
        _ => true,
    };
    ALL.iter().filter(is_known)
}
