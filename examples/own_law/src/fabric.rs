//! An observable of its own: the anisotropy of the directions of the contacts between disks,
//!
//! ```text
//! a = 2 √(⟨cos 2θ⟩² + ⟨sin 2θ⟩²)
//! ```
//!
//! with the mean over the contacts whose normal force is not less than `least_force`. It is 0 if
//! they have no direction in common, and the amplitude of the second harmonic of their distribution.

use std::sync::Arc;

use gshear_dem::laws::keys::{Key, NOT_NEGATIVE, Values};
use gshear_dem::observables::{
    Contact, Needs, Observable, ObservableKind, SampleView, Total,
};

/// The observable as scenes name it.
pub const KIND: ObservableKind = ObservableKind {
    name: "fabric",
    summary: "anisotropy of the directions of the contacts",
    unit: "1",
    keys: &[&LEAST_FORCE],
    read: |values, _| {
        Arc::new(Fabric {
            least_force: values.number(&LEAST_FORCE).unwrap_or(0.0),
        })
    },
};

/// A key of its own. Its bounds, message and unit follow from this declaration.
const LEAST_FORCE: Key = Key {
    path: "observable.least_force",
    doc: "least normal force of a contact that counts",
    unit: "N/m",
    values: Values::Number(NOT_NEGATIVE),
    otherwise: "0",
    ..Key::PLAIN
};

// Its totals.
const COSINE: usize = 0;
const SINE: usize = 1;

/// The constant (N/m).
#[derive(Debug)]
struct Fabric {
    least_force: f64,
}

impl Observable for Fabric {
    fn totals(&self) -> usize {
        2
    }

    fn needs(&self) -> Needs {
        Needs {
            contacts: true,
            ..Needs::GRAINS
        }
    }

    fn contact(&self, _: &SampleView, contact: &Contact, totals: &mut [Total]) {
        if contact.normal_force < self.least_force {
            return;
        }
        let [x, y, _] = contact.separation;
        let per_square = 1.0 / (x * x + y * y);
        totals[COSINE].add((x * x - y * y) * per_square);
        totals[SINE].add(2.0 * x * y * per_square);
    }

    fn value(&self, _: &SampleView, totals: &[Total]) -> f64 {
        let [cosine, sine] = [totals[COSINE].mean(), totals[SINE].mean()];
        2.0 * (cosine * cosine + sine * sine).sqrt()
    }
}
