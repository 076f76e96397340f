"""scripts/tables.py says which tables are of an older physics."""

from __future__ import annotations

import csv
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[2]
SCRIPT = CHECKOUT / "scripts" / "tables.py"
COLUMNS = ["file", "commit", "scene", "runs", "digest", "features"]
HEAD = "# Changelog\n\n## Unreleased\n\n### Physics\n"
FIRST = "- Grains of glass are round, as they are\n  in the shop. Concerns: 3D.\n"
SECOND = "- Disks of steel are heavier than they were before. Concerns: 2D, steel.\n"
THIRD = "- Time goes on.\n"


def git(root: Path, *words: str) -> str:
    name = ["-c", "user.name=Name", "-c", "user.email=name@example.org"]
    ran = subprocess.run(
        ["git", "-C", str(root), *name, *words],  # noqa: S607
        capture_output=True,
        text=True,
        check=True,
    )
    return ran.stdout.strip()


class Repository:
    """A repository whose changelog grows."""

    def __init__(self, root: Path) -> None:
        self.root = root
        (root / "docs/figures").mkdir(parents=True)
        git(root, "init", "--quiet")

    def commit(self, changelog: str) -> str:
        (self.root / "CHANGELOG.md").write_text(changelog)
        git(self.root, "add", "--all")
        git(self.root, "commit", "--quiet", "--allow-empty", "--message", "Change")
        return git(self.root, "rev-parse", "HEAD")

    def check(self, rows: list[list[str]], columns: list[str] = COLUMNS) -> tuple[int, list[str]]:
        for row in rows:
            (self.root / "docs/figures" / row[0]).touch()
        with (self.root / "docs/figures/made.csv").open("w", newline="") as file:
            csv.writer(file).writerows([columns, *rows])
        ran = subprocess.run(
            [sys.executable, SCRIPT, self.root], capture_output=True, text=True, check=False
        )
        assert not ran.stderr
        return ran.returncode, ran.stdout.splitlines()


@pytest.fixture
def repository(tmp_path: Path) -> Repository:
    return Repository(tmp_path)


def test_an_entry_of_physics_concerns_tables_with_its_features(repository: Repository) -> None:
    first = repository.commit(HEAD + FIRST)
    second = repository.commit(HEAD + SECOND + FIRST)
    rows = [
        ["spheres.csv", first, "a.toml", "1", "12", "3D steel"],
        ["disks.csv", first, "b.toml", "2", "", "2D"],
        ["steel.csv", first, "b.toml", "2", "34", "2D steel walls"],
        ["new.csv", second, "b.toml", "2", "34", "2D steel"],
    ]
    code, said = repository.check(rows)
    assert (code, len(said)) == (1, 6)
    assert said[0] == f"spheres.csv: present physics, runs of {first}"
    assert said[1] == f"disks.csv: present physics, committed in {first}"
    assert said[2] == f"steel.csv: older physics, runs of {first}"
    assert said[3] == "  since then: Disks of steel are heavier than they were …"
    assert said[4] == f"new.csv: present physics, runs of {second}"
    assert said[5] == "1 of 4 tables are of an older physics"
    # One without features concerns every table; another end of an entry makes no new one.
    repository.commit(HEAD + THIRD + SECOND + FIRST.replace("in the shop", "at home"))
    code, said = repository.check(rows)
    assert (code, said[-1]) == (1, "4 of 4 tables are of an older physics")
    assert sum(line == "  since then: Time goes on. …" for line in said) == 4


def test_present_tables_pass(repository: Repository) -> None:
    last = repository.commit(HEAD + THIRD)
    assert repository.check([["a.csv", last, "a.toml", "1", "12", "2D"]])[0] == 0


@pytest.mark.parametrize(
    ("rows", "columns", "fault"),
    [
        ([["a.csv", "HEAD", "", "", "", ""]] * 2, COLUMNS, "a.csv has 2 lines; give it one"),
        ([["a.csv", "0" * 40, "", "", "", ""]], COLUMNS, "HEAD does not contain 0000"),
        ([["a.csv", "HEAD", "", "", "", ""]], [*COLUMNS[:5], "more"], "its columns must be"),
    ],
)
def test_a_wrong_list_is_refused(
    repository: Repository, rows: list[list[str]], columns: list[str], fault: str
) -> None:
    repository.commit(HEAD)
    code, said = repository.check(rows, columns)
    assert code == 2
    assert fault in said[0]


def test_a_commit_outside_the_history_is_refused(repository: Repository) -> None:
    """A commit of a branch that was rebased is still in the repository of its author alone."""
    first = repository.commit(HEAD + FIRST)
    second = repository.commit(HEAD + SECOND + FIRST)
    rows = [["a.csv", second, "a.toml", "1", "12", "3D"]]
    assert repository.check(rows)[0] == 0
    git(repository.root, "reset", "--quiet", "--hard", first)
    code, said = repository.check(rows)
    fault = f"a.csv: HEAD does not contain {second}; name a commit of its history"
    assert (code, said) == (2, [f"error: docs/figures/made.csv: {fault}"])


def test_every_table_has_a_line(repository: Repository) -> None:
    last = repository.commit(HEAD)
    (repository.root / "docs/figures/b.csv").touch()
    code, said = repository.check([["a.csv", last, "", "", "", ""]])
    assert (code, said) == (2, ["error: docs/figures/made.csv: b.csv has 0 lines; give it one"])
    (repository.root / "docs/figures/b.csv").unlink()
    (repository.root / "docs/figures/made.csv").write_text("")
    names = {path.name for path in (CHECKOUT / "docs/figures").glob("*.csv")} - {"made.csv"}
    with (CHECKOUT / "docs/figures/made.csv").open(newline="") as file:
        listed = list(csv.DictReader(file))
    assert sorted(row["file"] for row in listed) == sorted(names)
    assert [row["scene"] for row in listed if not (CHECKOUT / row["scene"]).exists()] == []


def test_digests_are_joined_in_any_order() -> None:
    joined = runpy.run_path(str(SCRIPT))["joined"]
    assert joined(["a", "b"]) == joined(["b", "a"]) != joined(["a", "c"])
