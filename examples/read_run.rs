//! Reads a run of walls with `gshear-store`: its shear stress ratio over the strain, and the sliding contacts of its frames.
//!
//!     cargo run --release                                            # the default scene, into out/
//!     cargo run --release --example read_run -- out

use std::path::Path;

use gshear_dem::failure::Result;
use gshear_store::run_reader::RunFile;

fn main() {
    let Some(folder) = std::env::args().nth(1) else {
        eprintln!("usage: read_run FOLDER");
        std::process::exit(2);
    };
    if let Err(failure) = read(Path::new(&folder)) {
        eprintln!("error: {failure}");
        std::process::exit(failure.exit_code());
    }
}

/// `folder` has the `run.h5` of a run of walls.
fn read(folder: &Path) -> Result<()> {
    let run = RunFile::open(folder)?;
    println!(
        "{} grains, {} frames, digest {}",
        run.grains().count(),
        run.frames(),
        run.digest().unwrap_or("none: the run has not ended"),
    );

    // A time series is a column of numbers, a row each.
    let series = run.series();
    let (strain, ratio) = (series.column("strain"), series.column("stress_ratio"));
    for row in (0..series.rows()).step_by((series.rows() / 10).max(1)) {
        println!("strain {:.4}: stress ratio {:.3}", strain[row], ratio[row]);
    }

    // Frames have every grain and every contact. A block of them is read at once.
    let length = run.block_length();
    for first in (0..run.frames()).step_by(length) {
        for frame in run.records(first..run.frames().min(first + length))? {
            let sliding = frame.contacts.iter().filter(|c| c.sliding > 0).count();
            println!(
                "step {:8}: {} contacts, {sliding} of them slide",
                frame.step,
                frame.contacts.len(),
            );
        }
    }
    Ok(())
}
