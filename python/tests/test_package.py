"""The package as such."""

from __future__ import annotations

import subprocess
from importlib.resources import files

import gshear
from gshear.programs import find


def test_version_is_that_of_the_programs() -> None:
    command = [str(find("gshear-reduce")), "--version"]
    said = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    assert said.split()[-1] == gshear.__version__


def test_types_are_for_others_too() -> None:
    assert (files("gshear") / "py.typed").is_file()


def test_everything_public_is_documented() -> None:
    for name in gshear.__all__:
        assert getattr(gshear, name).__doc__
