"""All files of a release name one version."""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[2]
FILES = [
    "Cargo.toml",
    "CITATION.cff",
    "CHANGELOG.md",
    "packaging/conda/recipe.yaml",
    "packaging/spack/package.py",
    "python/pyproject.toml",
]


def check(root: Path) -> tuple[int, str]:
    """Returns exit code and messages of the check of the versions."""
    ran = subprocess.run(
        ["bash", CHECKOUT / "scripts" / "release", "check"],  # noqa: S607
        env=os.environ | {"RELEASE_ROOT": str(root)},
        capture_output=True,
        text=True,
        check=False,
    )
    return ran.returncode, ran.stderr


def test_all_files_name_one_version() -> None:
    assert check(CHECKOUT) == (0, "")


@pytest.mark.parametrize("name", FILES)
def test_another_version_is_noticed(tmp_path: Path, name: str) -> None:
    for file in FILES:
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(CHECKOUT / file, tmp_path / file)
    version = re.findall(r'^version = "(.*)"$', (CHECKOUT / "Cargo.toml").read_text(), re.MULTILINE)
    text = (tmp_path / name).read_text()
    (tmp_path / name).write_text(text.replace(version[0], "7.8.9", 2))
    code, said = check(tmp_path)
    assert code == 1
    assert ("Cargo.toml has 7.8.9" if name == "Cargo.toml" else f"{name}: version 7.8.9") in said


def addresses(root: Path, *arguments: str) -> tuple[int, str]:
    """Returns exit code and messages of the script of the addresses."""
    ran = subprocess.run(
        ["bash", CHECKOUT / "scripts" / "addresses", *arguments],  # noqa: S607
        env=os.environ | {"RELEASE_ROOT": str(root)},
        capture_output=True,
        text=True,
        check=False,
    )
    return ran.returncode, ran.stderr


def test_the_addresses_are_set_in_all_files_at_once(tmp_path: Path) -> None:
    for file in FILES:
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(CHECKOUT / file, tmp_path / file)
    places = [f"https://host.example/{word}" for word in ("code", "book", "issues")]
    assert addresses(tmp_path, *places) == (0, "")
    assert check(tmp_path) == (0, "")
    text = "".join((tmp_path / file).read_text() for file in FILES)
    assert "example.org" not in text
    assert [text.count(f'"{place}"') for place in places] == [4, 6, 2]

    citation = tmp_path / "CITATION.cff"
    citation.write_text(citation.read_text().replace(places[0], "https://another.example"))
    code, said = check(tmp_path)
    assert code == 1
    assert "CITATION.cff: repository-code: another address" in said


def test_the_recipe_of_spack_is_python() -> None:
    tree = ast.parse((CHECKOUT / "packaging" / "spack" / "package.py").read_text())
    assert [node.name for node in tree.body if isinstance(node, ast.ClassDef)] == ["GshearMpi"]


def test_a_tarball_names_its_commit(tmp_path: Path) -> None:
    def git(*arguments: str | Path) -> str:
        return subprocess.run(
            ["git", "-C", CHECKOUT, *arguments],  # noqa: S607
            capture_output=True,
            text=True,
            check=True,
        ).stdout.strip()

    tarball = tmp_path / "sources.tar"
    git("archive", f"--output={tarball}", "HEAD", "packaging/commit")
    shutil.unpack_archive(tarball, tmp_path)
    assert (tmp_path / "packaging" / "commit").read_text().strip() == git("rev-parse", "HEAD")


def test_a_wheel_needs_the_standard_library_of_its_target(tmp_path: Path) -> None:
    rustc = tmp_path / "rustc"
    rustc.write_text(f"#!/bin/sh\necho {tmp_path}\n")
    rustc.chmod(0o755)

    def ask(*arguments: str) -> tuple[int, str]:
        ran = subprocess.run(
            ["bash", CHECKOUT / "scripts" / "wheel", "--check", *arguments],  # noqa: S607
            env=os.environ | {"RUSTC": str(rustc)},
            capture_output=True,
            text=True,
            check=False,
        )
        return ran.returncode, ran.stderr

    code, said = ask("--target", "aarch64")
    assert code == 1
    assert "rustup target add aarch64-unknown-linux-gnu" in said
    (tmp_path / "libstd-1.rlib").touch()
    assert ask("--target", "aarch64") == (0, "")
    assert ask("--target", "sparc")[0] == 2
