"""The model of docs/validation/speed.md: its tables are those of the script, its limits the
measured ones."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

CHECKOUT = Path(__file__).resolve().parents[2]
TABLES = CHECKOUT / "docs" / "figures" / "scaling-model.txt"
SCRIPT = CHECKOUT / "scripts" / "scaling_model.py"


@pytest.fixture(scope="module")
def model() -> ModuleType:
    spec = importlib.util.spec_from_file_location("scaling_model", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_the_table_of_the_page_is_that_of_the_script() -> None:
    said = ""
    for options in ([], ["--measured"]):
        command = ["bash", str(CHECKOUT / "scripts" / "scaling"), "--model", *options]
        said += subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert said == TABLES.read_text(), f"write {TABLES} with scripts/scaling --model"


def test_one_rank_and_two_threads_are_as_measured(model: ModuleType) -> None:
    disks = model.LAWS["disks"]
    assert model.grain(disks, 5000) == pytest.approx(1e-6 / 75.80)
    assert model.grain(disks, 1e6) == pytest.approx(37.5e-9)
    assert model.threads_speed(disks, 1) == 1
    assert model.threads_speed(disks, 2) == pytest.approx(1.73)


def test_parts_of_a_step(model: ModuleType) -> None:
    machine = model.Machine(128, 2e-6, 12e9, 400e9, 5e6)
    disks, sample = model.LAWS["disks"], model.Sample(1e5, False, 10.0)
    alone = model.step(disks, sample, 1, 1, machine)
    assert (alone.border, alone.messages, alone.sums) == (0, 0, 0)
    node, nodes = (model.step(disks, sample, ranks, 1, machine) for ranks in (128, 200))
    assert node.messages == 0 < nodes.messages
    assert node.sums < nodes.sums
    assert model.step(disks, sample, 1000, 1, machine) is None
    # The border of a square slab: four rows of its height.
    assert sample.border == pytest.approx(4 * (1e5 / 10) ** 0.5)
