"""Puts the programs that scripts/wheel has built into the wheel."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

# The programs need the ABI of MPICH: lib/libmpi.so.12 and bin/mpiexec of the environment.
MPI = "mpich>=4.2,<6"


class Programs(BuildHookInterface[Any]):
    """Adds the folder `GSHEAR_PROGRAMS`, laid out like an environment, and the MPI.

    `GSHEAR_PLATFORM` is the platform tag. Without the folder the wheel has Python alone.
    """

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Fills in what hatchling is to add; `version` is standard or editable."""
        folder = os.environ.get("GSHEAR_PROGRAMS")
        if version != "standard" or not folder:
            return
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{os.environ['GSHEAR_PLATFORM']}"
        build_data["dependencies"].append(MPI)
        for path in sorted(Path(folder).iterdir()):
            if path.name == "bin":
                build_data["shared_scripts"] |= {str(p): p.name for p in sorted(path.iterdir())}
            else:
                build_data["shared_data"][str(path)] = path.name
