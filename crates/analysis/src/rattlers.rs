//! Rattlers: grains with too few contacts to carry load.

use gshear_dem::state::{ContactSample, Frame, GrainConstants};

/// Which grains are rattlers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RattlerRule {
    /// Free grains with D or fewer contacts in D dimensions, wall grains with D - 1 or fewer (LH
    /// section 3.2 for disks, D = 2). Every contact of the frame counts, whatever its force.
    #[default]
    LeeHurley,
    /// Free grains that have too few contacts to be in balance. They are taken out with their
    /// contacts until there are none. Grains of the walls are held.
    ///
    /// With friction two contacts balance a grain: equal and opposite forces along the line through
    /// both points of contact, which give no torque, if that line is within both cones of friction
    /// (Agnolin & Roux 2007, PRE 76, 061302, count such spheres). Without friction all forces point
    /// to the centre, and D + 1 are needed (O'Hern et al. 2003, PRE 68, 011306).
    Balance {
        /// Whether contacts have friction.
        friction: bool,
    },
    /// None: all grains count.
    None,
}

impl RattlerRule {
    /// Marks the rattlers of a frame. `rattler` becomes `[N]`, by grain id.
    pub fn mark(self, grains: &GrainConstants, frame: &Frame, rattler: &mut Vec<bool>) {
        let axes = frame.dimension.axes();
        match self {
            Self::LeeHurley => mark_below_coordination(axes, grains, &frame.contacts, rattler),
            Self::Balance { friction } => {
                let least = if friction { 2 } else { axes + 1 };
                mark_unbalanced(least, grains, &frame.contacts, rattler);
            }
            Self::None => {
                rattler.clear();
                rattler.resize(grains.count(), false);
            }
        }
    }
}

/// Marks the free grains with fewer than `least` contacts with others that are not marked.
fn mark_unbalanced(
    least: usize,
    grains: &GrainConstants,
    touching: &[ContactSample],
    rattler: &mut Vec<bool>,
) {
    rattler.clear();
    rattler.resize(grains.count(), false);
    loop {
        let mut contacts = vec![0; grains.count()];
        let ends = touching.iter().map(|contact| [contact.i, contact.j]);
        for pair in ends.filter(|pair| pair.iter().all(|n| !rattler[*n as usize])) {
            pair.iter().for_each(|n| contacts[*n as usize] += 1);
        }
        let mut is_done = true;
        for (n, count) in contacts.iter().enumerate() {
            if grains.body[n] == 0 && !rattler[n] && *count < least {
                (rattler[n], is_done) = (true, false);
            }
        }
        if is_done {
            return;
        }
    }
}

/// Marks the grains with `axes` contacts or fewer, in a wall one fewer.
fn mark_below_coordination(
    axes: usize,
    grains: &GrainConstants,
    touching: &[ContactSample],
    rattler: &mut Vec<bool>,
) {
    let mut contacts = vec![0; grains.count()];
    for contact in touching {
        contacts[contact.i as usize] += 1;
        contacts[contact.j as usize] += 1;
    }
    rattler.clear();
    let counts = contacts.iter().zip(&grains.body);
    rattler.extend(counts.map(|(count, body)| *count <= if *body == 0 { axes } else { axes - 1 }));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{contact, grains_of, touching};
    use gshear_dem::dimension::Dimensions::{self, Three, Two};

    /// Marks the rattlers of grains with these contacts.
    fn mark(
        rule: RattlerRule,
        dimension: Dimensions,
        grains: &GrainConstants,
        contacts: &[ContactSample],
        rattler: &mut Vec<bool>,
    ) {
        let mut frame = touching(10.0, &[], contacts.to_vec());
        frame.dimension = dimension;
        rule.mark(grains, &frame, rattler);
    }

    #[test]
    fn a_free_grain_needs_three_contacts_and_a_wall_grain_two() {
        let mut grains = grains_of(&[1.0; 5]);
        grains.body = vec![0, 0, 1, 2, 0];
        // Number of contacts of the grains 0 … 4: 3, 2, 2, 1, 0.
        let contacts = vec![contact(0, 1), contact(0, 2), contact(0, 3), contact(1, 2)];
        let mut rattler = vec![true; 9];
        mark(
            RattlerRule::LeeHurley,
            Two,
            &grains,
            &contacts,
            &mut rattler,
        );
        assert_eq!(rattler, [false, true, false, true, true]);
        // A free sphere needs four contacts, a wall sphere three.
        mark(
            RattlerRule::LeeHurley,
            Three,
            &grains,
            &contacts,
            &mut rattler,
        );
        assert_eq!(rattler, [true; 5]);
        let contacts = [&contacts[..], &[contact(0, 4), contact(2, 4)]].concat();
        mark(
            RattlerRule::LeeHurley,
            Three,
            &grains,
            &contacts,
            &mut rattler,
        );
        assert_eq!(rattler, [false, true, false, true, true]);
    }

    /// Four grains that all touch hold each other, a chain beside them does not.
    #[test]
    fn a_chain_falls_from_its_end_on() {
        let pairs = [
            (0, 1),
            (0, 2),
            (0, 3),
            (1, 2),
            (1, 3),
            (2, 3),
            (3, 4),
            (4, 5),
            (4, 6),
            (5, 6),
            (6, 7),
        ];
        let contacts = pairs.map(|(i, j)| contact(i, j));
        let mut grains = grains_of(&[1.0; 8]);
        let mut rattler = Vec::new();
        let mut marked = |rule, dimension, grains: &GrainConstants| -> Vec<usize> {
            mark(rule, dimension, grains, &contacts, &mut rattler);
            (0..8).filter(|n| rattler[*n]).collect()
        };
        let [with, without] = [true, false].map(|friction| RattlerRule::Balance { friction });
        assert_eq!(marked(without, Two, &grains), [4, 5, 6, 7]);
        assert_eq!(marked(without, Three, &grains), [0, 1, 2, 3, 4, 5, 6, 7]);
        for dimension in [Two, Three] {
            assert_eq!(marked(with, dimension, &grains), [7]);
        }
        assert_eq!(marked(RattlerRule::None, Two, &grains), [0; 0]);
        // Grains 5 and 7 have two contacts and one: fewer than three.
        assert_eq!(marked(RattlerRule::LeeHurley, Two, &grains), [5, 7]);
        // Grains of walls are held.
        (grains.body[7], grains.body[5]) = (1, 2);
        assert_eq!(marked(without, Two, &grains), [0; 0]);
    }
}
