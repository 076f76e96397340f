//! What `--version` of both programs prints.

use gshear_dem::simd::Isa;
use gshear_mpi_exchange::library_version;
use gshear_store::provenance;

/// Instruction sets that the kernel has.
const INSTRUCTION_SETS: [&str; 3] = ["avx512", "avx2", "portable"];

/// Program and commit, the libraries, and the instruction sets that this processor has, the one
/// that runs first.
pub fn text() -> String {
    let program = provenance::printed();
    format!("{program}\nMPI: {}\n{}", library_version(), of_all())
}

/// The same of `gshear-reduce`, which works without MPI.
pub fn text_of_reducer() -> String {
    format!("{}\n{}", provenance::printed_of("gshear-reduce"), of_all())
}

fn of_all() -> String {
    let mut here = INSTRUCTION_SETS.to_vec();
    here.retain(|name| Isa::named(name).is_some());
    format!(
        "HDF5: {}\ninstruction sets: {}\n",
        provenance::hdf5_version(),
        here.join(", ")
    )
}
