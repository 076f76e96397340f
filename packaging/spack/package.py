# Copyright: the gshear-mpi developers. SPDX-License-Identifier: (Apache-2.0 OR MIT)
"""Recipe for Spack 0.23 and newer; docs/howto/install.md says how to use it."""

import os

from spack.package import *

try:  # From Spack 1.0 on.
    from spack_repo.builtin.build_systems.generic import Package
except ImportError:
    pass


class GshearMpi(Package):
    """MPI-parallel discrete element shear of frictional granular packings, and its reducer.
    Runs give the same bits on any number of ranks."""

    homepage = "https://example.org/gshear-mpi/docs"
    # No address of a download: the tarball of a release is taken from the working directory.
    manual_download = True
    url = f"file://{os.getcwd()}/gshear-mpi-0.1.0.tar.gz"

    license("MIT OR Apache-2.0")

    # scripts/release writes the checksum.
    version("0.1.0")

    depends_on("c", type="build")
    depends_on("rust@1.95:", type="build")
    depends_on("pkgconfig", type="build")
    depends_on("llvm +clang", type="build")  # libclang, for the bindings of MPI
    depends_on("mpi@3:")
    depends_on("hdf5@1.10:1.14 +mpi")

    def setup_build_environment(self, env):
        env.set("PREFIX", self.prefix)
        env.set("MPICC", self.spec["mpi"].mpicc)
        env.set("HDF5_DIR", self.spec["hdf5"].prefix)
        env.set("LIBCLANG_PATH", self.spec["llvm"].prefix.lib)
        # A folder of the user that already holds the crates, for a node without network.
        env.set("CARGO_HOME", os.environ.get("CARGO_HOME", join_path(self.stage.path, "cargo")))

    def install(self, spec, prefix):
        os.environ["CARGO_BUILD_JOBS"] = str(make_jobs)
        Executable("scripts/install")()

    @run_after("install")
    @on_package_attributes(run_tests=True)
    def check_scene(self):
        Executable(self.prefix.bin.join("gshear-mpi"))("--check")
