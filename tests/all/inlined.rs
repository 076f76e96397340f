//! No vector operation of the kernel is a call. Code that is not inlined into a function of its
//! instruction set is compiled without that set: the results are the same, but it takes many times
//! as long.
//!
//! Portable code is exempt; on x86-64 its operations are deliberately not inlined.

use crate::common::{PROGRAM, REDUCER, start};

#[test]
fn no_vector_operation_is_called() {
    for program in [PROGRAM, REDUCER] {
        // `nm` comes with the linker.
        let out = start("nm")
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
            // Detection of the instruction set, and the functions `compiled`, which start the work,
            // are calls.
            .filter(|line| {
                let entries = ["xgetbv", "cpuid", "detect", "compiled"];
                !entries.iter().any(|name| line.contains(name))
            })
            .collect::<Vec<_>>();
        assert!(called.is_empty(), "{program}:\n{}", called.join("\n"));
    }
}
