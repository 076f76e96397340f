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
CONFIGS = sorted((ROOT / "configs").glob("*.toml"))


def named_schema(config: Path) -> Path:
    """The schema that the first line of a scene names."""
    line = config.read_text().splitlines()[0]
    assert line.startswith("#:schema "), f"{config.name} names no schema"
    return (config.parent / line.removeprefix("#:schema ")).resolve()


def problems(text: str) -> list[str]:
    schema: dict[str, Any] = json.loads((ROOT / "docs" / "scene.schema.json").read_text())
    validator = jsonschema.Draft202012Validator(schema)
    return [error.message for error in validator.iter_errors(tomllib.loads(text))]


@pytest.mark.parametrize("config", CONFIGS, ids=lambda path: path.stem)
def test_a_scene_fits_its_schema(config: Path) -> None:
    assert named_schema(config) == ROOT / "docs" / "scene.schema.json"
    assert problems(config.read_text()) == []


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
    shutil.copy(ROOT / "docs" / "scene.schema.json", tmp_path / "docs")
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
