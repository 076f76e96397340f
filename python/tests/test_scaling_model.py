"""The model of docs/validation/speed.md: its tables are those of the script, its limits the
measured ones."""

from __future__ import annotations

import csv
import importlib.util
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

CHECKOUT = Path(__file__).resolve().parents[2]
TABLES = CHECKOUT / "docs" / "figures" / "scaling-model.txt"
WORK = CHECKOUT / "docs" / "figures" / "work.csv"
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


def test_one_rank_is_as_measured(model: ModuleType) -> None:
    disks = model.LAWS["disks"]
    assert model.grain(disks, 5000) == pytest.approx(13.7e-9)
    assert model.grain(disks, 1e6) == pytest.approx(37.5e-9)


def test_counts_of_the_model_are_those_of_the_table(model: ModuleType) -> None:
    # Cuts of the samples of the table, in mean diameters: height, and width of spheres.
    sections = {
        ("disks", "1"): 69.3,
        ("disks", "20"): 69.3,
        ("spheres", "1 by 1"): 12.3 * 20,
        ("spheres", "4 by 5"): 12.3 * 100,
        ("spheres", "20 by 1"): 12.3 * 20,
    }
    compared = 0
    with WORK.open(newline="") as file:
        for row in csv.DictReader(file):
            law, ranks = model.LAWS[row["scene"]], int(row["ranks"])
            if ranks > 1:
                area = sections[row["scene"], row["copies"]] * ranks
                assert int(row["pairs_twice"]) == pytest.approx(law.across * area, rel=0.05)
                assert int(row["ghosts"]) == pytest.approx(2 * law.ghosts * area, rel=0.05)
                compared += 1
            assert int(row["pairs"]) == pytest.approx(law.pairs * int(row["grains"]), rel=0.01)
    assert compared == 14


def test_check_has_the_constants_of_the_model(model: ModuleType) -> None:
    source = (CHECKOUT / "crates" / "driver" / "src" / "layout.rs").read_text("utf-8")
    blocks = re.findall(r"Constants \{\n((?: +\w+: [\d.e-]+,\n)+)", source)
    assert len(blocks) == len(model.LAWS)
    names = "of_pairs", "pairs", "across", "ghosts", "copied", "between_threads", "alone"
    for block, law in zip(blocks, model.LAWS.values(), strict=True):
        values = {name: float(value) for name, value in re.findall(r"(\w+): ([\d.e-]+),", block)}
        assert {name: values[name] for name in names} == {
            name: getattr(law, name) for name in names
        }
        # In the cache.
        assert values["grain"] in {time for _, time in law.times}


def test_parts_of_a_step(model: ModuleType) -> None:
    machine = model.Machine(128, 2e-6, 12e9, 400e9, 5e6)
    disks = model.LAWS["disks"]
    sample = model.Sample(1e5, False, 10.0, disks.density)

    def slabs(ranks: int, threads: int = 1) -> Any:
        return model.step(disks, sample, model.Cuts((ranks, 1, 1)), threads, machine)

    alone = slabs(1)
    assert alone.total == alone.grains == pytest.approx(1e5 * model.grain(disks, 1e5))
    node, nodes = slabs(128), slabs(200)
    assert node.messages == 0 < nodes.messages
    assert node.sums < nodes.sums
    # Slabs of less than four diameters.
    assert slabs(1000) is None
    assert slabs(4, 4).threads > slabs(4).threads == 0
    # Two faces of the height of the sample; bricks in a row are slabs, and cubes have six faces.
    assert model.Cuts((4, 1, 1)).area(sample) == pytest.approx(2 * (1e4 / disks.density) ** 0.5)
    cube = model.Sample(8e6, True, 1.0, 1.0)
    assert model.Cuts((2, 2, 2)).area(cube) == pytest.approx(6 * 100**2)
    found = model.best(model.LAWS["spheres"], cube, 8, 3, machine, 1)
    assert found.cuts.area(cube) == pytest.approx(6 * 100**2)
