"""The pages of docs/tutorial do what they say.

All pages run one after the other in one folder, as a reader would. Blocks of `toml` and `python`
that begin with `# NAME` are files of that name. Blocks of `sh` are run and must succeed. The lines
of a `text` block are in the output of the block before, in this order; `…` stands for any text.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from gshear.programs import OPEN_MPI, ROOT, find

CHECKOUT = Path(__file__).resolve().parents[2]
TUTORIAL = CHECKOUT / "docs" / "tutorial"
PAGES = ["first-run", "own-scene", "sweep", "reduce", "python"]
BLOCK = re.compile(r"^```(sh|text|toml|python)\n(.*?)^```$", re.MULTILINE | re.DOTALL)

# Stands for Slurm: runs the script of a job at once, for every task of an array.
SBATCH = """#!/bin/bash
set -eu
tasks=
while [[ $1 == -* ]]; do
    [[ $1 == --array=* ]] && tasks=$(seq $(tr - ' ' <<<"${1#--array=}"))
    shift
done
export SLURM_JOB_ID=1 SLURM_ARRAY_JOB_ID=1 SLURM_SUBMIT_DIR=$PWD
export LAUNCH="mpirun -n 2"
for task in $tasks; do
    SLURM_ARRAY_TASK_ID=$task bash "$@"
done
"""


def missing(expected: str, output: str) -> str | None:
    """Returns the first expected line that is not in the output, in this order."""
    lines = iter(output.splitlines())
    for line in expected.splitlines():
        pattern = ".*".join(re.escape(piece) for piece in line.split("…"))
        if not any(re.fullmatch(pattern, said.rstrip()) for said in lines):
            return line
    return None


@dataclass
class Reader:
    """Someone who follows the pages in a folder."""

    folder: Path
    environment: dict[str, str]
    output: str = ""
    commands: int = 0
    compared: int = 0
    faults: list[str] = field(default_factory=list)

    def follow(self, page: str, text: str) -> None:
        """Does what a page says."""
        for kind, block in BLOCK.findall(text):
            if kind == "sh":
                self.run(page, block)
            elif kind == "text":
                self.compared += 1
                if (line := missing(block, self.output)) is not None:
                    self.faults.append(f"{page}: no line {line!r} in\n{self.output}")
            else:
                name = re.match(r"# (\S+)\n", block)
                assert name, f"{page}: a block of {kind} names no file"
                (self.folder / name[1]).write_text(block)

    def run(self, page: str, block: str) -> None:
        """Runs a block of commands."""
        self.commands += 1
        ran = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", block],  # noqa: S607
            cwd=self.folder,
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=900,
            check=False,
        )
        self.output = ran.stdout
        if ran.returncode:
            self.faults.append(f"{page}: exit code {ran.returncode} of\n{block}\n{ran.stdout}")


@pytest.fixture
def reader(tmp_path: Path) -> Reader:
    """Returns a reader in a folder that looks like a checkout with built programs."""
    programs = tmp_path / "programs"
    folder = tmp_path / "checkout"
    programs.mkdir()
    folder.mkdir()
    for name in ("gshear-mpi", "gshear-reduce"):
        (programs / name).symlink_to(find(name).resolve())
    (programs / "sbatch").write_text(SBATCH)
    (programs / "squeue").write_text("#!/bin/sh\necho 1:00:00\n")
    for name in ("sbatch", "squeue"):
        (programs / name).chmod(0o755)
    for name in ("job-scripts", "configs"):
        (folder / name).symlink_to(CHECKOUT / name)
    environment = dict(os.environ)
    environment |= {
        "PATH": f"{programs}:{Path(sys.executable).parent}:{environment['PATH']}",
        "GSHEAR": str(programs / "gshear-mpi"),
        "MPLBACKEND": "Agg",
    }
    environment |= OPEN_MPI | ROOT
    return Reader(folder, environment)


def test_pages_do_what_they_say(reader: Reader) -> None:
    assert sorted(PAGES) == sorted(page.stem for page in TUTORIAL.glob("*.md"))
    for page in PAGES:
        reader.follow(page, (TUTORIAL / f"{page}.md").read_text())
        assert not reader.faults, "\n".join(reader.faults)
    assert reader.commands > 15
    assert reader.compared > 10
    assert (reader.folder / "strength.svg").stat().st_size > 1000


def test_a_wrong_page_is_noticed(reader: Reader) -> None:
    reader.follow("page", "```sh\necho one two\n```\n\n```text\none…\n```\n")
    assert not reader.faults
    reader.follow("page", "```text\nthree\n```\n")
    reader.follow("page", "```sh\nfalse\n```\n")
    reader.follow("page", "```sh\necho b; echo a\n```\n\n```text\na\nb\n```\n")
    assert len(reader.faults) == 3
