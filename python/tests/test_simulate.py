"""What `simulate` passes on to gshear-mpi."""

from __future__ import annotations

import subprocess
import sys
from fractions import Fraction
from pathlib import Path, PurePosixPath

import numpy as np
import pytest

from gshear import ProgramFailedError, Run, simulate
from gshear._toml import override, toml
from gshear.programs import find

from .conftest import SCENES

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (True, True),
        (False, False),
        (np.True_, True),
        (3, 3),
        (np.int64(-3), -3),
        (2**53, 2**53),
        (1e-05, 1e-05),
        (0.1, 0.1),
        (float("inf"), float("inf")),
        (np.float64(0.1), 0.1),
        (np.float32(0.5), 0.5),
        (Fraction(1, 4), 0.25),
        ('a "b" \\ c\n\t\u0304\x00\x1f\x7f', 'a "b" \\ c\n\t\u0304\x00\x1f\x7f'),
        (PurePosixPath('/a b/it\'s "c"#d'), '/a b/it\'s "c"#d'),
        ([], []),
        ((1, [2.5, True], "x"), [1, [2.5, True], "x"]),
        (np.array([[1, 2], [3, 4]]), [[1, 2], [3, 4]]),
        (range(3), [0, 1, 2]),
        (
            [{"velocity": np.float64(3.0), "a b": {"c.d": False}}, {}],
            [{"velocity": 3.0, "a b": {"c.d": False}}, {}],
        ),
    ],
)
def test_a_parser_of_toml_reads_back_what_is_written(value: object, expected: object) -> None:
    found = tomllib.loads(f"x = {toml(value)}")["x"]
    assert found == expected
    assert type(found) is type(expected)


@pytest.mark.parametrize("value", [{1, 2}, b"x", object(), [None], {1: 2}, 1j])
def test_what_toml_lacks_is_refused(value: object) -> None:
    with pytest.raises(TypeError, match="give"):
        toml(value)


def test_a_string_is_passed_on() -> None:
    assert [override(x) for x in ("2 mm", "[1, 2]", None, True)] == [
        "2 mm",
        "[1, 2]",
        "none",
        "true",
    ]


def test_the_program_takes_every_kind_of_value(tmp_path: Path) -> None:
    values: dict[str, object] = {
        "title": "A title",
        "seed": np.uint32(7),
        "output.energy": False,
        "time.collision_speed": None,
        "load.gravity": np.float64(9.5),
        "shear.spring_number": 100,
        "shear.protocol": [
            {"velocity": 3.0, "distance": np.float64(3e-4)},
            {"velocity": 0, "time": 1e-4},
        ],
    }
    scene = SCENES / "crossing-3d.toml"
    with Run(simulate(scene, tmp_path / "a", ranks=1, values=values, quiet=True)) as run:
        found = {key: run.scene[key] for key in values if values[key] is not None}
    assert found.pop("shear.protocol") == [
        {"velocity": 3.0, "distance": 3e-4},
        {"velocity": 0.0, "time": 1e-4},
    ]
    assert all(value == values[key] for key, value in found.items())
    assert found["output.energy"] is False

    # The path of a packing, with what a shell and TOML would take amiss.
    packing = tmp_path / 'it\'s a "packing" #1' / "grains.data"
    packing.parent.mkdir()
    export = ["export", str(tmp_path / "a"), "--format", "lammps-data", "--out", str(packing)]
    subprocess.run([str(find("gshear-reduce")), *export], check=True, capture_output=True)
    values |= {"sample.packing": packing, "sample.walls": "types"}
    with Run(simulate(scene, tmp_path / "b", ranks=1, values=values, quiet=True)) as run:
        assert run.scene["sample.packing"] == str(packing)


@pytest.mark.parametrize(
    ("said", "hint"),
    [
        ("error while loading shared libraries: libmpi.so.12: cannot open shared", "pip install"),
        ("PMI_Init: unsupported PMI version", "bin/mpiexec"),
    ],
)
def test_an_mpi_of_another_kind_is_explained(
    said: str, hint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "gshear-mpi"
    program.write_text(f"#!/bin/sh\necho '{said}' >&2\nexit 127\n")
    program.chmod(0o755)
    monkeypatch.setenv("GSHEAR_MPI", str(program))
    with pytest.raises(ProgramFailedError, match=hint) as caught:
        simulate(SCENES / "crossing.toml", tmp_path / "out", ranks=1, quiet=True)
    assert said in caught.value.output
