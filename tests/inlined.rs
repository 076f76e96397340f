//! The kernel's vector operations are instructions, not calls: what is not inlined into the code of its instruction set is compiled
//! without it, and takes many times as long with the same results.

use std::process::Command;

#[test]
fn no_vector_operation_is_called() {
    for program in [
        env!("CARGO_BIN_EXE_gshear-mpi"),
        env!("CARGO_BIN_EXE_gshear-reduce"),
    ] {
        // Comes with the linker.
        let out = Command::new("nm")
            .args(["--defined-only", program])
            .output()
            .expect("nm of binutils runs");
        assert!(out.status.success(), "nm {program}");
        let symbols = String::from_utf8_lossy(&out.stdout);
        assert!(
            symbols.contains("gshear"),
            "{program} is stripped of its names"
        );
        let called = symbols
            .lines()
            .filter(|line| line.contains("core_arch"))
            // Which instructions there are is asked once.
            .filter(|line| !line.contains("xgetbv") && !line.contains("cpuid"))
            .collect::<Vec<_>>();
        assert!(called.is_empty(), "{program}:\n{}", called.join("\n"));
    }
}
