//! CSV tables of the maps.

use std::fmt::Write as _;

use super::steps::top;
use super::studied::{Step, Studied};
use gshear_analysis::forces;
use gshear_dem::state::Disks;

/// Returns one line per grain and step; lengths in m, D²min in m².
pub fn grains_table(run: &Studied, steps: &[&Step]) -> String {
    let mut csv = String::from(
        "step,stage,start_strain,end_strain,grain,body,x,y,radius,in_gr_region,dmin,greatest_dmin\n",
    );
    for step in steps {
        let (top, [from, to]) = (top(&step.dmin), step.strain);
        for (n, [x, y]) in step.frame.position.iter().enumerate() {
            let id = n as u32;
            let (stage, body, radius) =
                (step.stage.name(), run.grains.body[n], run.grains.radius[n]);
            let marks = [step.regions.binary_search(&id).is_ok(), top.contains(&id)].map(u8::from);
            writeln!(
                csv,
                "{},{stage},{from:?},{to:?},{n},{body},{x:?},{y:?},{radius:?},{},{:?},{}",
                step.number, marks[0], step.dmin[n], marks[1]
            )
            .expect("writing to a string cannot fail");
        }
    }
    csv
}

/// Returns one line per contact and step: |f| and, if `with_change`, its change.
pub fn contacts_table(run: &Studied, steps: &[&Step], with_change: bool) -> String {
    let mut csv = String::from("step,stage,end_strain,i,j,x_i,y_i,x_j,y_j,force");
    csv += if with_change { ",force_change\n" } else { "\n" };
    for step in steps {
        for (k, contact) in step.frame.contacts.iter().enumerate() {
            let from = step.frame.position[contact.i as usize];
            let [x, y] = run
                .grains
                .separation(from, step.frame.position[contact.j as usize]);
            write!(
                csv,
                "{},{},{:?},{},{},{:?},{:?},{:?},{:?},{:?}",
                step.number,
                step.stage.name(),
                step.strain[1],
                contact.i,
                contact.j,
                from[0],
                from[1],
                from[0] + x,
                from[1] + y,
                forces::size(contact)
            )
            .expect("writing to a string cannot fail");
            if with_change {
                write!(csv, ",{:?}", step.force_change[k])
                    .expect("writing to a string cannot fail");
            }
            csv.push('\n');
        }
    }
    csv
}

/// Returns one line per grain and step, in m.
pub fn displacement_table(grains: &Disks, steps: &[&Step]) -> String {
    let mut csv = String::from("step,stage,start_strain,end_strain,grain,x,y,radius,u_x,u_y\n");
    for step in steps {
        let [from, to] = step.strain;
        for (n, u) in step.displacement.iter().enumerate() {
            let ([x, y], radius) = (step.frame.position[n], grains.radius[n]);
            writeln!(
                csv,
                "{},{},{from:?},{to:?},{n},{x:?},{y:?},{radius:?},{:?},{:?}",
                step.number,
                step.stage.name(),
                u[0],
                u[1]
            )
            .expect("writing to a string cannot fail");
        }
    }
    csv
}
