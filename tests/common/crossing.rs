//! Runs of the crossing scene: 220 disks that change slabs and cross the seam.

use std::path::{Path, PathBuf};

use super::{Outcome, gshear_mpi};

pub const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/crossing.toml");

/// Keys by which a run of the scene begins with its disks as it packs them.
pub const PACKED: [&str; 6] = [
    concat!(
        "sample.packing=",
        env!("CARGO_MANIFEST_DIR"),
        "/tests/scenes/crossing.data"
    ),
    "sample.grains=none",
    "sample.radius_min=none",
    "sample.radius_max=none",
    "sample.length=none",
    "pack.tolerance=none",
];

/// A run of the crossing scene from the first grain, in `folder`.
pub fn whole(folder: &Path, ranks: usize, set: &[&str]) -> Outcome {
    let mut arguments = vec![SCENE.to_string()];
    arguments.extend(set.iter().map(|s| format!("--set={s}")));
    gshear_mpi(ranks, folder, &arguments)
}

/// A run from a checkpoint.
pub fn resumed(checkpoint: &Path, folder: &Path, ranks: usize, set: &[&str]) -> Outcome {
    let mut arguments = vec![format!("--resume={}", checkpoint.display())];
    arguments.extend(set.iter().map(|s| format!("--set={s}")));
    gshear_mpi(ranks, folder, &arguments)
}

/// Stops the crossing scene after `step` of the shear and returns the checkpoint.
pub fn stopped(folder: &Path, ranks: usize, step: u64, set: &[&str]) -> PathBuf {
    let mut arguments = vec![SCENE.to_string(), format!("--stop-at={step}")];
    arguments.extend(set.iter().map(|s| format!("--set={s}")));
    let outcome = gshear_mpi(ranks, folder, &arguments);
    assert_eq!(outcome.code, 75, "{}", outcome.text);
    folder.join("checkpoint.h5")
}
