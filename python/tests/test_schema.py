"""The scenes in configs/ fit the JSON schema that they name, by another program's validator."""

import json
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
        ("[sample]\ngrains = '1000'", "[sample]\ngrains = 1000"),
        ("extends = 3", "extends = 'base.toml'"),
    ],
)
def test_a_mistake_is_found(wrong: str, right: str) -> None:
    assert len(problems(wrong)) == 1
    assert problems(right) == []
