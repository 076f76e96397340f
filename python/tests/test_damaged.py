"""Damaged and foreign files raise RunError, whatever is in them, and take no more memory than they
hold."""

from __future__ import annotations

import contextlib
import os
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from gshear import NoSuchNameError, Run, RunError, Sweep
from gshear.tables import read_csv

FRAMES = "particles/trajectory/"
DATASETS = [
    *(FRAMES + name for name in ("id", "radius", "body", "position/value", "position/step")),
    *(FRAMES + name for name in ("position/time", "velocity/value", "box/edges/value")),
    *("connectivity/contacts/" + name for name in ("offset", "i", "normal_force")),
    *("observables/" + name for name in ("strain/value", "strain/step", "stress_ratio/value")),
]


def null(file: h5py.File, name: str) -> None:
    file[name] = h5py.Empty("f8")


def scalar(file: h5py.File, name: str) -> None:
    file[name] = 3.0


def loop(file: h5py.File, name: str) -> None:
    file[name] = h5py.SoftLink("/" + name)


def text(file: h5py.File, name: str) -> None:
    kind = h5py.string_dtype()
    file.create_dataset(name, data=np.array(["a"] * 4, dtype=object), dtype=kind)


def compound(file: h5py.File, name: str) -> None:
    file.create_dataset(name, data=np.zeros(4, dtype=[("a", "f8"), ("b", "i4")]))


def group(file: h5py.File, name: str) -> None:
    file.create_group(name)


def nothing(_: h5py.File, __: str) -> None:
    pass


def huge(file: h5py.File, name: str) -> None:
    file.create_dataset(name, shape=(2**40,), dtype="f8", chunks=(64,))


def flat(file: h5py.File, name: str) -> None:
    file[name] = np.zeros((2, 2, 2, 2))


def another_number(file: h5py.File, name: str) -> None:
    file[name] = np.full((3,) * 2, 7) if "value" in name else np.full(3, 7)


REPLACEMENTS = [null, scalar, loop, text, compound, group, nothing, huge, flat, another_number]


def read_all(path: Path) -> None:
    """Reads what a run has, as people do."""
    with Run(path, quiet=True) as run:
        assert run.dimension in (2, 3)
        assert len(run.scene)
        assert len(run.series["strain"]) == len(run.series["stress_ratio"])
        for frame in run.frames:
            for name in ("radius", "body", "id"):
                assert len(frame[name]) == len(frame.position)
            assert frame.unwrapped.shape == frame.velocity.shape
            contacts = frame.contacts
            assert len(contacts.normal) == len(contacts.normal_force) == contacts.count
            contacts.coordination()
        run.array("position")
        run.array("normal_force")


def old(path: Path) -> Path:
    """Not written just now, when a program might be in the middle of it."""
    os.utime(path, (0, 0))
    return path


@pytest.mark.parametrize("replace", REPLACEMENTS, ids=lambda of: of.__name__)
def test_objects_that_are_not_those_of_a_run(
    replace: Callable[[h5py.File, str], None], copy: Callable[[str], Path]
) -> None:
    run = copy("disks") / "run.h5"
    read_all(run)
    whole = run.read_bytes()
    for name in DATASETS:
        run.write_bytes(whole)
        with h5py.File(run, "r+") as file:
            del file[name]
            replace(file, name)
        if replace is another_number:
            # Fewer steps are a shorter run.
            with contextlib.suppress(RunError, NoSuchNameError):
                read_all(old(run))
            continue
        with pytest.raises((RunError, NoSuchNameError), match=r"run\.h5|has no column"):
            read_all(old(run))


@pytest.mark.parametrize("value", [h5py.Empty("f8"), 7, "text", np.zeros(3), b"\xff\xfe"])
@pytest.mark.parametrize("name", ["scene", "dimension"])
def test_parameters_that_are_not_those_of_a_run(
    name: str, value: object, copy: Callable[[str], Path]
) -> None:
    run = copy("disks") / "run.h5"
    with h5py.File(run, "r+") as file:
        file["parameters"].attrs[name] = value
    with pytest.raises(RunError, match="is damaged"):
        read_all(old(run))


def test_bytes_that_were_changed(copy: Callable[[str], Path]) -> None:
    """Somewhere in the file, which is then read, refused, or shows the other number."""
    run = copy("disks") / "run.h5"
    whole = run.read_bytes()
    generator = np.random.default_rng(3)
    refused = 0
    for _ in range(60):
        at, bit = int(generator.integers(min(len(whole), 60_000))), int(generator.integers(8))
        damaged = bytearray(whole)
        damaged[at] ^= 1 << bit
        run.write_bytes(damaged)
        try:
            read_all(old(run))
        except (RunError, NoSuchNameError):
            refused += 1
    assert refused > 0


# In a process of its own, with 2 GB of addresses.
READ = """
import sys
from gshear import GshearError, Run
try:
    with Run(sys.argv[1], quiet=True) as run:
        print(run.dmin(1).shape)
except GshearError as error:
    print(error)
"""


def test_a_reduced_file_that_announces_too_much_is_made_anew(copy: Callable[[str], Path]) -> None:
    folder = copy("disks")
    with Run(folder, quiet=True) as run:
        shape = run.dmin(1).shape
    with h5py.File(folder / "reduced.h5", "r+") as file:
        kind = file["dmin/strain"].dtype
        del file["dmin/strain"]
        file.create_dataset("dmin/strain", shape=(2**31,), dtype=kind, chunks=(64,))
    said = subprocess.run(
        [sys.executable, "-c", READ, str(folder)],
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30)),
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert said.strip() == str(shape)


def test_tables_that_are_none(copy: Callable[[str], Path], tmp_path: Path) -> None:
    folder = copy("disks")
    with Run(folder, quiet=True) as run:
        phases = run.phases()
        for damage in (b"", b"\xff\xfe\x00", b"kind,start_row\nstick,a\n", b"1,2\n3,4,5\n6\n"):
            # Made anew.
            (folder / "phases.csv").write_bytes(damage)
            assert run.phases().equals(phases)
    # The log of a run that has not ended is its series.
    with h5py.File(folder / "run.h5", "r+") as file:
        file["parameters"].attrs["digest"] = ""
    log = folder / "log.csv"
    whole = log.read_bytes()
    for damage in (b"\xff\xfe\n\n", b"a,b\n1,2\n", whole.replace(b"\n", b"\nx", 2), b"1\n2,3\n"):
        log.write_bytes(damage)
        with Run(folder, quiet=True) as run, pytest.raises(RunError, match=r"log\.csv: is damaged"):
            run.series.mean()
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(RunError, match="no such file"):
        read_csv(tmp_path / "pipe.csv")
    with pytest.raises(RunError, match="no such folder"):
        Sweep(tmp_path / "nothing")


def test_names_that_there_are_not_name_those_that_there_are(disks: Run) -> None:
    for of, name, hint in (
        (disks.series, "tau", "did you mean 'stress_ratio'?"),
        (disks.series, "stressratio", "did you mean 'stress_ratio'?"),
        (disks.phases(), "delta_tau", "did you mean 'delta_tau_p'?"),
        (disks.frame(0), "radii", "did you mean 'radius'?"),
        (disks.frame(0).contacts, "normal_forces", "did you mean 'normal_force'?"),
        (disks.scene, "contact.fricton", "did you mean 'friction'?"),
        (disks.series, "zzz", "it has step, time, strain"),
    ):
        with pytest.raises(KeyError) as caught:
            of[name]
        said = str(caught.value)
        assert repr(name) in said
        assert hint in said
    # What pandas takes besides names stays as it is.
    series = disks.series
    assert len(series[series["strain"] > 0.05]) < len(series)
    assert list(series[["step", "time"]]) == ["step", "time"]
    assert series.attrs["units"]["time"] == "s"
    with pytest.raises(AttributeError, match="did you mean 'radius'"):
        _ = disks.frame(0).radii
