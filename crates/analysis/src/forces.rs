//! Contact forces of 2D frames: magnitude, direction, and change between two frames (LH section
//! 3.2).

use super::neighbourhood::separation;
use gshear_dem::state::{ContactSample, Disks, Frame};

/// Returns |f| (N/m in 2D), normal and tangential part together.
pub fn size(contact: &ContactSample) -> f64 {
    let (normal, [x, y, z]) = (contact.normal_force, contact.tangential_force);
    (normal * normal + (x * x + y * y + z * z)).sqrt()
}

/// Returns n, from j to i, and the force f on i (N/m), in the coordinates of the cell.
pub fn vector(grains: &Disks, frame: &Frame, contact: &ContactSample) -> ([f64; 2], [f64; 2]) {
    let [i, j] = [contact.i, contact.j].map(|n| frame.position[n as usize]);
    let d = separation(grains.length, j, i);
    let distance = (d[0] * d[0] + d[1] * d[1]).sqrt();
    let n = [d[0] / distance, d[1] / distance];
    let (normal, tangential) = (contact.normal_force, contact.tangential_force[0]);
    let f = [
        normal * n[0] - tangential * n[1],
        normal * n[1] + tangential * n[0],
    ];
    (n, f)
}

/// Returns |θ| (rad), 0 … π/2: the angle between the x axis and the line of the contact force.
///
/// The angle is that of the line, not of the vector: i and j feel opposite forces, and their order
/// in the contact is arbitrary.
pub fn angle(grains: &Disks, frame: &Frame, contact: &ContactSample) -> f64 {
    let (_, f) = vector(grains, frame, contact);
    f[1].abs().atan2(f[0].abs())
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
    use crate::testing::{grains_in, pushed, touching};
    use std::f64::consts::PI;

    #[test]
    fn changes_are_those_of_the_size_of_contacts_in_both_frames() {
        let frame = |contacts: &[ContactSample]| touching(Vec::new(), contacts.to_vec());
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
        let grains = grains_in(10.0, &[1.0, 1.0]);
        for (normal, tangential, wanted) in [
            (1.0, 0.0, 0.0),
            (1.0, 1.0, PI / 4.0),
            (1.0, -1.0, PI / 4.0),
            (0.0, 2.0, PI / 2.0),
            (3.0_f64.sqrt(), 1.0, PI / 6.0),
        ] {
            let contact = pushed(0, 1, normal, tangential);
            let frame = touching(vec![[0.4, 3.0], [8.5, 3.0]], vec![contact]);
            let (n, f) = vector(&grains, &frame, &contact);
            assert_eq!((n, f), ([1.0, 0.0], [normal, tangential]));
            let found = angle(&grains, &frame, &contact);
            assert!((found - wanted).abs() < 1e-15, "{found} for {wanted}");
        }
    }
}
