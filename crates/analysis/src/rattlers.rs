//! Rattlers: grains with too few contacts to carry load.

use gshear_dem::state::{ContactSample, Disks};

/// Marks the rattlers of a frame in so many dimensions D: free grains with D or fewer contacts,
/// wall grains with D - 1 or fewer (LH section 3.2 for disks, D = 2).
///
/// `rattler` becomes `[N]`, by grain id. Every contact of the frame counts, whatever its force.
pub fn mark(axes: usize, grains: &Disks, touching: &[ContactSample], rattler: &mut Vec<bool>) {
    let mut contacts = vec![0; grains.count()];
    for contact in touching {
        contacts[contact.i as usize] += 1;
        contacts[contact.j as usize] += 1;
    }
    rattler.clear();
    let of_bodies = contacts.iter().zip(&grains.body);
    rattler.extend(of_bodies.map(|(&of, &body)| of <= if body == 0 { axes } else { axes - 1 }));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{contact, grains_in};

    #[test]
    fn a_free_grain_needs_three_contacts_and_a_wall_grain_two() {
        let mut grains = grains_in(10.0, &[1.0; 5]);
        grains.body = vec![0, 0, 1, 2, 0];
        // Number of contacts of the grains 0 … 4: 3, 2, 2, 1, 0.
        let contacts = vec![contact(0, 1), contact(0, 2), contact(0, 3), contact(1, 2)];
        let mut rattler = vec![true; 9];
        mark(2, &grains, &contacts, &mut rattler);
        assert_eq!(rattler, [false, true, false, true, true]);
        // A free sphere needs four contacts, a wall sphere three.
        mark(3, &grains, &contacts, &mut rattler);
        assert_eq!(rattler, [true; 5]);
        let contacts = [&contacts[..], &[contact(0, 4), contact(2, 4)]].concat();
        mark(3, &grains, &contacts, &mut rattler);
        assert_eq!(rattler, [false, true, false, true, true]);
    }
}
