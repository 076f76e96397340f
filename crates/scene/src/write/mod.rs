//! The checked scene as TOML again, with every default filled in: what the user chose stays as
//! chosen, what follows from it stands in comments, so that reading it gives the same scene to the
//! last bit.

mod lines;
mod periodic;
#[cfg(test)]
mod tests;
mod walls;

use crate::key::Key;
use crate::raw::{self, KeyTable};
use crate::scene::{
    Bookkeeping, Boundary, Dimensions, Origin, Sample, Scene, Sizes, StepChoice, TimeStep, Walls,
};
use crate::words::show;
use lines::Lines;

/// The configuration of a scene.
pub(super) fn toml(scene: &Scene) -> String {
    let mut t = Lines(String::new());
    t.line("# What is run: every default filled in. What follows from it:");
    match &scene.boundary {
        Boundary::Walls(walls) => walls::derived(&mut t, scene, walls),
        Boundary::Periodic(_) => periodic::derived(&mut t, &scene.time_step),
    }
    head(&mut t, scene);
    sample(&mut t, scene);
    match &scene.boundary {
        Boundary::Walls(walls) => walls::load(&mut t, &walls.load),
        Boundary::Periodic(periodic) => periodic::size(&mut t, periodic),
    }
    time(&mut t, &scene.time_step);
    match &scene.boundary {
        Boundary::Walls(walls) => walls::stages(&mut t, walls, scene.keep_checkpoints),
        Boundary::Periodic(periodic) => periodic::stages(&mut t, periodic, scene.keep_checkpoints),
    }
    bookkeeping(&mut t, &scene.bookkeeping);
    t.0
}

/// What stands above all tables, `[material]` and `[contact]`.
fn head(t: &mut Lines, scene: &Scene) {
    let keys = raw::Raw::KEYS;
    t.text(&keys.title, &scene.title);
    if let Some(author) = &scene.author {
        t.text(&keys.author, author);
    }
    t.whole(&keys.seed, scene.seed);
    t.whole(&keys.dimension, scene.dimension.axes() as u64);
    let values = |t: &mut Lines, table: &str| {
        for (key, value) in scene.law.given() {
            if key.table() == table {
                t.number(&Key::absent((*key).into()), *value);
            }
        }
    };
    let _: raw::Material = t.table();
    values(t, raw::Material::NAME);
    let keys: raw::Contact = t.table();
    t.text(&keys.law, scene.law.kind().name);
    values(t, raw::Contact::NAME);
    t.number(&keys.friction, scene.contact.friction);
    if scene.dimension == Dimensions::Two && scene.law.kind().rolling {
        t.number(&keys.rolling_friction, scene.contact.rolling_friction);
        t.number(
            &keys.rolling_damping_ratio,
            scene.contact.rolling_damping_ratio,
        );
    }
}

fn sample(t: &mut Lines, scene: &Scene) {
    let keys: raw::Sample = t.table();
    let sizes = match &scene.boundary {
        Boundary::Walls(walls) => match &walls.origin {
            Origin::Insertion(sizes) => Some(sizes),
            Origin::Packing { file, walls } => {
                t.text(&keys.packing, &file.path.display().to_string());
                let copies = &file.replicate[..scene.dimension.axes() - 1];
                let copies: Vec<String> = copies.iter().map(u32::to_string).collect();
                t.numbers(&keys.replicate, &copies);
                let name = Walls::NAMES.iter().find(|(_, known)| known == walls);
                t.text(&keys.walls, name.map_or("", |(name, _)| name));
                None
            }
        },
        Boundary::Periodic(periodic) => Some(&periodic.sizes),
    };
    t.whole(&keys.grains, scene.sample.grains.into());
    radii(t, &scene.sample, sizes);
    if let Boundary::Periodic(periodic) = &scene.boundary {
        t.text(&keys.placement, periodic.placement.name());
    }
    if let Boundary::Walls(walls) = &scene.boundary {
        t.number(&keys.length, scene.sample.length);
        if scene.dimension == Dimensions::Three {
            t.number(&keys.width, scene.sample.width);
        }
        t.number(&keys.wall_thickness, walls.wall_layers);
    }
}

/// Between which radii, and how they are distributed, if the grains are inserted.
fn radii(t: &mut Lines, sample: &Sample, sizes: Option<&Sizes>) {
    let keys = raw::Sample::KEYS;
    if !matches!(sizes, Some(Sizes::List(_))) {
        t.number(&keys.radius_min, sample.radius_min);
        t.number(&keys.radius_max, sample.radius_max);
    }
    let Some(sizes) = sizes else { return };
    t.text(&keys.sizes, sizes.name());
    match sizes {
        Sizes::Uniform => {}
        Sizes::Normal { mean, deviation } => {
            t.number(&keys.radius_mean, *mean);
            t.number(&keys.radius_deviation, *deviation);
        }
        Sizes::Binary { large_fraction } => t.number(&keys.large_fraction, *large_fraction),
        Sizes::List(radii) => {
            let radii: Vec<String> = radii.iter().map(|r| show(*r)).collect();
            t.numbers(&keys.radii, &radii);
        }
    }
}

fn time(t: &mut Lines, time_step: &TimeStep) {
    let keys: raw::Time = t.table();
    match time_step.given {
        StepChoice::Derived => {}
        StepChoice::Given => t.number(&keys.step, time_step.step),
        StepChoice::Collision(speed) => t.number(&keys.collision_speed, speed),
    }
    t.flag(&keys.force, time_step.force);
}

fn bookkeeping(t: &mut Lines, bookkeeping: &Bookkeeping) {
    let keys: raw::Bookkeeping = t.table();
    if let Some(skin) = bookkeeping.list.skin {
        t.number(&keys.skin, skin);
    }
    t.whole(&keys.rebuild_every, bookkeeping.list.rebuild_every);
    t.text(&keys.simd, bookkeeping.simd);
    t.number(&keys.watchdog, bookkeeping.watchdog);
}
