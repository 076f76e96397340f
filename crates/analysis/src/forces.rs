//! Contact forces: magnitude, direction, and change between two frames (LH section 3.2).

use gshear_dem::dimension::Dimensions;
use gshear_dem::state::{ContactSample, Frame, length};

/// Returns |f| (N/m in 2D), normal and tangential part together.
pub fn size(contact: &ContactSample) -> f64 {
    let (normal, [x, y, z]) = (contact.normal_force, contact.tangential_force);
    (normal * normal + (x * x + y * y + z * z)).sqrt()
}

/// A contact in the coordinates of the cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactVectors {
    /// n, the unit vector from j, a grain or a flat wall, to i.
    pub normal: [f64; 3],
    /// f on i (N; N/m in 2D).
    pub force: [f64; 3],
}

/// Returns the direction of a contact and its force.
pub fn vectors(frame: &Frame, contact: &ContactSample) -> ContactVectors {
    let n = frame.wall_normal(contact).unwrap_or_else(|| {
        let separation = frame.separation(contact.j, contact.i);
        let distance = length(separation);
        separation.map(|x| x / distance)
    });
    let tangential = match frame.dimension {
        // The component along (-n_y, n_x).
        Dimensions::Two => {
            let along = contact.tangential_force[0];
            [-along * n[1], along * n[0], 0.0]
        }
        Dimensions::Three => contact.tangential_force,
    };
    ContactVectors {
        normal: n,
        force: std::array::from_fn(|k| contact.normal_force * n[k] + tangential[k]),
    }
}

/// Returns |θ| (rad), 0 … π/2: the angle between the x axis and the line of the contact force.
///
/// The angle is that of the line, not of the vector: i and j feel opposite forces, and their order
/// in the contact is arbitrary.
pub(crate) fn angle(frame: &Frame, contact: &ContactSample) -> f64 {
    let [x, y, z] = vectors(frame, contact).force;
    y.hypot(z).atan2(x.abs())
}

/// Writes the differential force network to `changes`: the change of |f| of every contact of the
/// later frame, 0 for contacts made between the two frames. Lost contacts do not appear.
///
/// `changes` gets the length of `later.contacts`. Contacts of both frames must be sorted by (i, j).
pub fn changes(earlier: &Frame, later: &Frame, changes: &mut Vec<f64>) {
    let mut before = earlier.contacts.iter().peekable();
    changes.clear();
    changes.extend(later.contacts.iter().map(|contact| {
        let key = (contact.i, contact.j);
        while before.next_if(|c| (c.i, c.j) < key).is_some() {}
        match before.peek() {
            Some(same) if (same.i, same.j) == key => size(contact) - size(same),
            _ => 0.0,
        }
    }));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{pushed, touching};
    use std::f64::consts::PI;

    #[test]
    fn changes_are_those_of_the_size_of_contacts_in_both_frames() {
        let frame = |contacts: &[ContactSample]| touching(10.0, &[], contacts.to_vec());
        let earlier = frame(&[
            pushed(0, 1, 3.0, -4.0),
            pushed(0, 2, 1.0, 0.0),
            pushed(1, 2, 1.0, 0.0),
        ]);
        let later = frame(&[
            pushed(0, 1, 12.0, 5.0),
            pushed(1, 2, 0.5, 0.0),
            pushed(1, 3, 9.0, 0.0),
        ]);
        let mut found = vec![7.0];
        changes(&earlier, &later, &mut found);
        assert_eq!(found, [8.0, -0.5, 0.0]);
        changes(&frame(&[]), &later, &mut found);
        assert_eq!(found, [0.0; 3]);
        changes(&later, &frame(&[]), &mut found);
        assert!(found.is_empty());
    }

    #[test]
    fn the_force_is_turned_from_the_normal_by_its_tangential_part() {
        // Across the periodic boundary: the normal from grain 1 to grain 0 points along +x.
        for (normal, tangential, wanted) in [
            (1.0, 0.0, 0.0),
            (1.0, 1.0, PI / 4.0),
            (1.0, -1.0, PI / 4.0),
            (0.0, 2.0, PI / 2.0),
            (3.0_f64.sqrt(), 1.0, PI / 6.0),
        ] {
            let contact = pushed(0, 1, normal, tangential);
            let frame = touching(10.0, &[[0.4, 3.0], [8.5, 3.0]], vec![contact]);
            let ContactVectors { normal: n, force } = vectors(&frame, &contact);
            assert_eq!((n, force), ([1.0, 0.0, 0.0], [normal, tangential, 0.0]));
            let found = angle(&frame, &contact);
            assert!((found - wanted).abs() < 1e-15, "{found} for {wanted}");
        }
    }
}
