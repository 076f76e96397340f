//! Every test that runs the real programs or needs several crates, in one program: it is linked
//! once, and waits overlap.
//!
//! A program that one test starts inherits the HDF5 files that others have open at that moment, and
//! would keep HDF5's locks on them. This process therefore takes none (`.cargo/config.toml`).

mod accuracy;
mod ageing;
mod bad_input;
mod box_deformations;
mod box_protocols;
mod box_rolling;
mod box_runs;
mod box_stages;
mod branches;
mod changing_cells;
mod checkpoint;
#[path = "../common/mod.rs"]
mod common;
mod compressed_runs;
mod config;
mod contracts;
mod contracts_of_boxes;
mod contracts_of_protocols;
mod contracts_of_spheres;
mod contracts_of_springs;
mod damage;
mod damped_motion;
mod dissipation;
mod ends_of_parts;
mod ends_of_stages;
mod estimates;
mod extreme_numbers;
mod failures;
mod faults;
mod flat_walls;
mod free_surface;
mod harness;
mod inlined;
mod jacobian;
mod job_scripts;
mod kept_files;
mod new_scenes;
mod observables;
mod owners;
mod packing;
mod packing_contacts;
mod places;
mod properties;
mod reduce;
mod reduced_protocols;
mod removal;
mod replay;
mod runs_of_protocols;
mod scalars;
mod spectrum_of_runs;
mod stages_in_turn;
mod stiffness_of_laws;
mod stress;
mod sweep;
mod sweep_jobs;
mod terminal;
mod trajectory;
mod version;
mod watchdog;
mod without_walls;

#[test]
fn this_process_takes_no_locks_of_hdf5() {
    let variable = std::env::var("HDF5_USE_FILE_LOCKING");
    assert_eq!(variable.as_deref(), Ok("FALSE"), "run the tests with cargo");
}
