"""An environment of its own for a script that needs packages."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path


def run_in(environment: Path, packages: list[str]) -> None:
    """Starts the script again in an environment with these packages, unless it runs there.

    Makes the environment if it is missing.
    """
    if Path(sys.prefix).resolve() == environment.resolve():
        return
    if not (environment / "bin/pip").exists():
        subprocess.run([sys.executable, "-m", "venv", environment], check=True)
    install = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run([environment / "bin/python", *install, *packages], check=True)
    python = str(environment / "bin/python")
    os.execv(python, [python, *sys.argv])  # noqa: S606
