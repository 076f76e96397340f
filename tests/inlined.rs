//! The kernel's vector operations are instructions, not calls: what is not inlined into the code of its instruction set is compiled
//! without it, and takes many times as long with the same results.
//!
//! Portable code has no such set to lose; its fused multiply-add is out of line on purpose.

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
            symbols.contains("gshear_dem"),
            "{program} is stripped of its names"
        );
        let called = symbols
            .lines()
            .filter(|line| {
                let of_simd = line.contains("gshear_dem") && line.contains("simd");
                line.contains("core_arch")
                    || of_simd && (line.contains("avx2") || line.contains("avx512"))
            })
            // Which instructions there are is asked once; whole pieces of work are entered by a call.
            .filter(|line| {
                let entries = ["xgetbv", "cpuid", "detect", "compiled"];
                !entries.iter().any(|name| line.contains(name))
            })
            .collect::<Vec<_>>();
        assert!(called.is_empty(), "{program}:\n{}", called.join("\n"));
    }
}
