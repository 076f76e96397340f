"""The scenes in configs/ fit the JSON schema that they name, by other programs' validators."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import jsonschema
import pytest

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parents[2]
SCHEMA = ROOT / "docs" / "scene.schema.json"
CONFIGS = sorted((ROOT / "configs").glob("*.toml"))
SCENES = sorted((ROOT / "tests" / "scenes").glob("*.toml"))


def named_schema(config: Path) -> Path:
    """The schema that the first line of a scene names."""
    line = config.read_text().splitlines()[0]
    assert line.startswith("#:schema "), f"{config.name} names no schema"
    return (config.parent / line.removeprefix("#:schema ")).resolve()


def problems(text: str) -> list[str]:
    schema: dict[str, Any] = json.loads(SCHEMA.read_text())
    validator = jsonschema.Draft202012Validator(schema)
    return [error.message for error in validator.iter_errors(tomllib.loads(text))]


@pytest.mark.parametrize("config", CONFIGS, ids=lambda path: path.stem)
def test_a_scene_fits_its_schema(config: Path) -> None:
    assert named_schema(config) == SCHEMA
    assert problems(config.read_text()) == []


@pytest.mark.parametrize("scene", SCENES, ids=lambda path: path.stem)
def test_a_scene_of_the_tests_fits_the_schema(scene: Path) -> None:
    assert problems(scene.read_text()) == []


@pytest.mark.parametrize(
    "right",
    [
        "extends = 'base.toml'\nnewtonian = 'none'",
        "load = { stiffness_number = 'none', pressure = '13.5 kPa' }",
        "sample = { radii = ['1 µm', 1e-6, '0.5e-3mm'], sizes = 'none', grains = 'none' }",
        "time.force = 'none'",
        "shear.protocol = [{ velocity = '1 mm/s', time = '.5 h' }]",
        "sample.replicate = [2]\nshear.protocol = [{ velocity = 0.0, time = 1 }]",
        "sweep.seed = [1, 2]",
        "[sweep]\nseeds = 3\n[sweep.zip]\n'load.pressure' = [1, 2]\ntitle = ['a', 'b']",
        "[[sweep.zip]]\nseed = [1, 2]\n[[sweep.zip]]\ncontact.friction = [0.1, 0.2]",
    ],
)
def test_units_none_and_lists_are_taken(right: str) -> None:
    assert problems(right) == []


@pytest.mark.parametrize(
    ("wrong", "right"),
    [
        ("[contact]\nfrction = 0.3", "[contact]\nfriction = 0.3"),
        ("[load]\npressure = 'small'", "[load]\npressure = '5 MPa'"),
        ("[load]\npressure = '1,5 MPa'", "[load]\npressure = '1.5 N·mm⁻²'"),
        ("[sample]\ngrains = '1000'", "[sample]\ngrains = 1000"),
        ("extends = 3", "extends = 'base.toml'"),
    ],
)
def test_a_mistake_is_found(wrong: str, right: str) -> None:
    assert len(problems(wrong)) == 1
    assert problems(right) == []


@pytest.mark.parametrize(
    "wrong",
    [
        "sample.grains = 0",
        "sample.grains = 1.5",
        "sample.grain = 1",
        "sample = 1",
        "gravity = 1",
        "dimension = 4",
        "contact.law = 'walton'",
        "contact.damping_ratio = 1",
        "load.stiffness_number = 5.0",
        "time.force = 1",
        "sample.radii = []",
        "sample.radii = [-1]",
        "shear.protocol = [{ velocity = 1 }]",
        "shear.protocol = [{ velocity = 1, shear_stress = 1, time = 1 }]",
        "shear.protocol = [{ pressure = 1, time = 1 }]",
        "shear.protocol = [{ bottom_amplitude = 1, bottom_frequency = 1 }]",
        "shear.protocol = [{ velocity = 1, time = 1, distance = 1 }]",
        "shear.protocol = [{ velocity = 1, time = 'long' }]",
        "load.pressure = '5'",
        "load.pressure = 'MPa 5'",
        "contact.friction = '0.5 MPa'",
        "relax.drag = 'Hz'",
        "sample.radii = ['big']",
        "time.force = 'yes'",
        "load = 'heavy'",
        "sweep.seeds = 0",
        "sweep.zip = 3",
    ],
)
def test_what_the_program_refuses_is_refused(wrong: str) -> None:
    assert problems(wrong) != []


def taplo(*files: Path) -> tuple[int, str]:
    """Exit code and messages of the checker of Taplo, which editors use."""
    program = Path(sys.executable).parent / "taplo"
    command: list[str | Path] = [program, "lint", "--no-auto-config", "--colors", "never", *files]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    return ran.returncode, ran.stderr


def test_taplo_accepts_the_scenes() -> None:
    code, said = taplo(*CONFIGS)
    assert code == 0, said
    assert f"total={len(CONFIGS)}" in said


def test_taplo_underlines_a_wrong_key(tmp_path: Path) -> None:
    """One message, at the place of the key: with a schema that it cannot read there is none."""
    (tmp_path / "docs").mkdir()
    shutil.copy(SCHEMA, tmp_path / "docs")
    (tmp_path / "configs").mkdir()
    scene = tmp_path / "configs" / "wrong.toml"
    text = (ROOT / "configs" / "mu-of-i-2d.toml").read_text()
    scene.write_text(text.replace("\nfriction =", "\nfrction ="))
    line = scene.read_text().splitlines().index("frction = 0.4") + 1
    code, said = taplo(scene)
    assert code == 1
    places = re.findall(r"wrong\.toml:(\d+):\d+", said)
    assert places == [str(line)], said
    assert "unknown key" in said
