//! What `gshear-mpi --version` prints.

use gshear_dem::simd::Isa;
use gshear_mpi_exchange::library_version;
use gshear_store::provenance;

/// Instruction sets that the kernel has.
const INSTRUCTION_SETS: [&str; 3] = ["avx512", "avx2", "portable"];

/// Program and commit, the libraries, and the instruction sets that this processor has, the one that
/// runs first.
pub fn text() -> String {
    let here: Vec<&str> = INSTRUCTION_SETS
        .into_iter()
        .filter(|name| Isa::named(name).is_some())
        .collect();
    format!(
        "{}\nMPI: {}\nHDF5: {}\ninstruction sets: {}\n",
        provenance::printed(),
        library_version(),
        provenance::hdf5_version(),
        here.join(", ")
    )
}
