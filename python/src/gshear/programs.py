"""Finds and starts gshear-mpi and gshear-reduce."""

from __future__ import annotations

import contextlib
import json
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping
from datetime import timedelta
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from ._toml import override
from .errors import ProgramFailedError, ProgramNotFoundError

# Settings of Open MPI, which other MPIs ignore: ranks of two runs do not share the first cores, and
# there may be more of them than cores.
OPEN_MPI = {
    "OMPI_MCA_hwloc_base_binding_policy": "none",
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
}
# Without these, Open MPI refuses to start as root, as in a container.
ROOT = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}


def _installed(package: str, name: str) -> Path | None:
    """Returns the program of this name that pip installed with a package, or None."""
    try:
        files = distribution(package).files or []
    except PackageNotFoundError:
        return None
    paths = (file.locate() for file in files if file.parts[-2:] == ("bin", name))
    return next((Path(found).resolve() for path in paths if (found := shutil.which(path))), None)


def find(name: str) -> Path:
    """Returns the path of `gshear-mpi` or `gshear-reduce`.

    The places, in this order: the environment variable `GSHEAR_MPI` or `GSHEAR_REDUCE`, the wheel
    of this package if it has the programs, `PATH`, and `target/release` of the checkout that holds
    this package.

    Raises:
        ProgramNotFoundError: None of the places has it, or the variable names no program.
    """
    variable = name.upper().replace("-", "_")
    if given := os.environ.get(variable):
        if found := shutil.which(given):
            return Path(found)
        raise ProgramNotFoundError(
            f"{variable}={given}: no program of this name: set it to the path of {name}"
        )
    if own := _installed("gshear", name):
        return own
    if found := shutil.which(name):
        return Path(found)
    for folder in Path(__file__).resolve().parents:
        program = folder / "target" / "release" / name
        if shutil.which(program):
            return program
    raise ProgramNotFoundError(
        f"{name} not found in PATH or in target/release of the checkout: "
        f"build it with `make build`, or set {variable} to its path"
    )


def launcher(program: Path) -> list[str]:
    """Returns the command that starts MPI ranks of a program, up to its options.

    It is that of the environment variable `MPIRUN`; for a program of the wheel mpiexec of the MPI
    that pip installed with it; else mpirun.

    Raises:
        ProgramNotFoundError: There is no mpirun.
    """
    if given := os.environ.get("MPIRUN"):
        return shlex.split(given)
    if program == _installed("gshear", program.name) and (own := _installed("mpich", "mpiexec")):
        return [str(own)]
    if shutil.which("mpirun") is None:
        raise ProgramNotFoundError(
            "mpirun not found in PATH: install an MPI, set MPIRUN to its path, or use ranks=1"
        )
    return ["mpirun"]


def progress(folder: Path) -> Callable[[], None] | None:
    """Returns a function that shows the progress of a run in one line of a notebook.

    None outside of a notebook. The line appears when the run writes `status.json`.
    """
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    if not hasattr(shell, "kernel"):
        return None
    from IPython.display import DisplayHandle, display

    path = folder / "status.json"
    before = path.stat().st_mtime_ns if path.exists() else 0
    line: DisplayHandle | None = None

    def look() -> None:
        nonlocal line
        try:
            if path.stat().st_mtime_ns == before:
                return
            status = json.loads(path.read_text())
        except (OSError, ValueError):
            return
        part, steps, strain, left = map(status.get, ("fraction", "steps", "strain", "seconds_left"))
        words = [status["stage"] if part is None else f"{status['stage']} {part:.0%}"]
        words.append(f"step {status['step']:,}" + (f" of {steps:,}" if steps else ""))
        if strain is not None:
            words.append(f"strain {strain:.5f}")
        if left is not None:
            words.append(f"{timedelta(seconds=round(left))} left")
        if status["state"] != "running":
            words.append(status["state"])
        text = ", ".join(words)
        bar = "<progress></progress>" if part is None else f"<progress value={part}></progress>"
        data = {"text/plain": text, "text/html": f"{bar} {text}"}
        if line:
            line.update(data, raw=True)
        else:
            line = display(data, raw=True, display_id=True)

    return look


def run(
    command: Iterable[str | os.PathLike[str]],
    *,
    quiet: bool = False,
    look: Callable[[], None] | None = None,
) -> str:
    """Runs a command and returns its standard output.

    Unless `quiet`, prints the command to standard error before. Calls `look` every second and at
    the end.

    Raises:
        ProgramFailedError: The exit code is not 0; has what the program wrote.
    """
    words = [os.fspath(word) for word in command]
    if not quiet:
        print(f"gshear: running {shlex.join(words)}", file=sys.stderr)
    environment = OPEN_MPI | os.environ | (ROOT if os.geteuid() == 0 else {})
    pipe = subprocess.PIPE
    with subprocess.Popen(
        words, stdout=pipe, stderr=pipe, text=True, env=environment, errors="replace"
    ) as process:
        try:
            while process.returncode is None:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    output, errors = process.communicate(timeout=1 if look else None)
                if look:
                    look()
        except BaseException:
            process.kill()
            raise
    if process.returncode != 0:
        raise ProgramFailedError(words, process.returncode, output + errors)
    return output


def simulate(
    scene: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    ranks: int = 2,
    values: Mapping[str, object] | None = None,
    quiet: bool = False,
) -> Path:
    """Runs a scene with gshear-mpi, or continues it, and returns the folder of its results.

    A run that is finished already is left as it is (`--resume auto`). The call returns when the run
    has ended. `find` and `launcher` say which programs are taken. In a notebook a line of progress
    takes the place of the command.

    Args:
        scene: Path of a scene, see `docs/reference/config.md`.
        out: Folder of the results.
        ranks: Number of MPI ranks; with 1 the program runs without mpirun.
        values: Values of the scene to replace, as in `{"shear.strain": 0.02}` (`--set`): numbers,
            booleans, paths, lists and dicts of Python and NumPy. `None` takes a key away. A string
            is passed on as it is, as in `{"sample.length": "2 mm"}`; in lists and dicts it is a
            text.
        quiet: Print neither the command nor the progress.

    Raises:
        TypeError: A value has a type that no key of a scene has.
        ValueError: `ranks` is less than 1.
        ProgramNotFoundError: gshear-mpi or mpirun is missing.
        ProgramFailedError: The run failed or stopped early (exit code 75).
    """
    if ranks < 1:
        raise ValueError(f"ranks is {ranks}; give 1 or more")
    program = find("gshear-mpi")
    command: list[str | os.PathLike[str]] = []
    if ranks != 1:
        command += [*launcher(program), "-n", str(ranks)]
    command += [program, scene, "--out", out, "--resume", "auto"]
    for key, value in (values or {}).items():
        command += ["--set", f"{key}={override(value)}"]
    look = None if quiet else progress(Path(out))
    run(command, quiet=quiet or look is not None, look=look)
    return Path(out)
