//! CSV tables of the maps.

use super::studied::{MapStep, Studied};
use gshear_analysis::forces;
use gshear_dem::state::Disks;
use gshear_store::table::Table;

/// Returns one line per grain and step; lengths in m, D²min in m².
pub fn grains_table(run: &Studied, steps: &[&MapStep]) -> String {
    let rows = steps.iter().flat_map(|step| {
        let top = step.top();
        let grains = 0..step.frame.position.len();
        grains.map(move |n| (*step, n, top.contains(&(n as u32))))
    });
    Table::of(rows)
        .column("step", |(step, ..)| step.number)
        .column("stage", |(step, ..)| step.stage.name())
        .columns(["start_strain", "end_strain"], |(step, ..)| step.strain)
        .column("grain", |(_, n, _)| *n)
        .column("body", |(_, n, _)| run.grains.body[*n])
        .columns(["x", "y"], |(step, n, _)| step.frame.position[*n])
        .column("radius", |(_, n, _)| run.grains.radius[*n])
        .column("in_gr_region", |(step, n, _)| {
            u8::from(step.regions.binary_search(&(*n as u32)).is_ok())
        })
        .column("dmin", |(step, n, _)| step.dmin[*n])
        .column("greatest_dmin", |(.., is_top)| u8::from(*is_top))
        .csv()
}

/// Returns one line per contact and step: |f| and, if `with_change`, its change.
pub fn contacts_table(run: &Studied, steps: &[&MapStep], with_change: bool) -> String {
    let rows = steps.iter().flat_map(|step| {
        let contacts = step.frame.contacts.iter().enumerate();
        contacts.map(move |(k, contact)| (*step, k, contact))
    });
    let table = Table::of(rows)
        .column("step", |(step, ..)| step.number)
        .column("stage", |(step, ..)| step.stage.name())
        .column("end_strain", |(step, ..)| step.strain[1])
        .column("i", |(.., contact)| contact.i)
        .column("j", |(.., contact)| contact.j)
        .columns(["x_i", "y_i", "x_j", "y_j"], |(step, _, contact)| {
            let from = step.frame.position[contact.i as usize];
            let to = step.frame.position[contact.j as usize];
            let [x, y] = run.grains.separation(from, to);
            [from[0], from[1], from[0] + x, from[1] + y]
        })
        .column("force", |(.., contact)| forces::size(contact));
    match with_change {
        true => table
            .column("force_change", |(step, k, _)| step.force_change[*k])
            .csv(),
        false => table.csv(),
    }
}

/// Returns one line per grain and step, in m.
pub fn displacement_table(grains: &Disks, steps: &[&MapStep]) -> String {
    let rows = steps.iter().flat_map(|step| {
        let displacements = step.displacement.iter().enumerate();
        displacements.map(move |(n, u)| (*step, n, *u))
    });
    Table::of(rows)
        .column("step", |(step, ..)| step.number)
        .column("stage", |(step, ..)| step.stage.name())
        .columns(["start_strain", "end_strain"], |(step, ..)| step.strain)
        .column("grain", |(_, n, _)| *n)
        .columns(["x", "y"], |(step, n, _)| step.frame.position[*n])
        .column("radius", |(_, n, _)| grains.radius[*n])
        .columns(["u_x", "u_y"], |(.., u)| *u)
        .csv()
}
