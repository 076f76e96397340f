"""The package as such."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

import gshear
from gshear.programs import find

from .conftest import CHECKOUT


def test_version_is_that_of_the_programs() -> None:
    command = [str(find("gshear-reduce")), "--version"]
    said = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    assert said.splitlines()[0].split()[1] == gshear.__version__


def test_types_are_for_others_too() -> None:
    assert (files("gshear") / "py.typed").is_file()


def test_everything_public_is_documented() -> None:
    for name in gshear.__all__:
        assert getattr(gshear, name).__doc__


def test_the_examples_of_the_readme_run(
    copy: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = "python/README.md"
    examples = re.findall(r"```python\n(.*?)```", (CHECKOUT / page).read_text(), re.DOTALL)
    assert len(examples) == 2
    (tmp_path / "out" / "sweep").mkdir(parents=True)
    copy("disks").rename(tmp_path / "out" / "plane-shear-2d")
    for name in ["disks", "other disks"]:
        copy(name).rename(tmp_path / "out" / "sweep" / name)
    monkeypatch.chdir(tmp_path)
    for example in examples:
        exec(compile(example, page, "exec"), {})  # noqa: S102
    plt.close("all")
