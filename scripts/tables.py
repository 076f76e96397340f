#!/usr/bin/env python3
"""Says which tables under docs/figures are of an older physics than the present one.

    tables.py [ROOT]

docs/figures/made.csv has a line for each table:

- `file`: its name;
- `commit`: the newest one of the history that the program of all its runs contains. An empty
  `digest` says that it is the commit of the table instead: its runs may be of any commit before;
- `scene`: of its runs, and `runs`, their number;
- `digest`: of the one run, or of the digests of all runs (`tables.joined`);
- `features`: what its runs have, in the words of the CHANGELOG's *Physics* entries.

A table is of an older physics if the CHANGELOG of its commit lacks a *Physics* entry of the present
one that concerns it. An entry that ends with "Concerns: A, B." concerns tables with all of these
features, one without such an end concerns every table. The exit code is 1 if a table is of an older
physics, and 2 if made.csv is wrong. This is not a part of CI: results are made again on purpose.
"""

from __future__ import annotations

import csv
import hashlib
import re
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

FIGURES = Path("docs/figures")
COLUMNS = ["file", "commit", "scene", "runs", "digest", "features"]
CONCERNS = re.compile(r"\s+Concerns: ([^.]*)\.$")
# An entry is the same one if it begins with the same words; its end may be reworded.
WORDS = 8


class Entry(NamedTuple):
    """An entry under *Physics*: its first words, and the features that it concerns."""

    begins: str
    features: frozenset[str]


def entries(changelog: str) -> list[Entry]:
    """Returns the *Physics* entries of a changelog."""
    found = []
    for section in re.findall(r"^### Physics\n(.*?)(?=^##|\Z)", changelog, re.M | re.S):
        for text in re.findall(r"^- (.*(?:\n  .*)*)", section, re.M):
            words = " ".join(text.split())
            concerns = CONCERNS.search(words)
            features = concerns[1].split(", ") if concerns else []
            begins = " ".join(CONCERNS.sub("", words).split()[:WORDS])
            found.append(Entry(begins, frozenset(features)))
    return found


def joined(digests: Iterable[str]) -> str:
    """Returns one digest for those of several runs, in any order."""
    return hashlib.sha256("\n".join(sorted(digests)).encode()).hexdigest()[:32]


def changelog_of(root: Path, commit: str) -> str | None:
    """Returns the changelog of a commit, "" if it had none, or None if HEAD does not contain it."""
    git = ["git", "-C", str(root)]
    contained = subprocess.run(
        [*git, "merge-base", "--is-ancestor", commit, "HEAD"], capture_output=True, check=False
    )
    if contained.returncode:
        return None
    shown = subprocess.run(
        [*git, "show", f"{commit}:CHANGELOG.md"], capture_output=True, text=True, check=False
    )
    return shown.stdout


def wrong(root: Path, rows: list[dict[str, str]]) -> list[str]:
    """Returns what is wrong with made.csv."""
    said = []
    listed = [row["file"] for row in rows]
    tables = sorted(path.name for path in (root / FIGURES).glob("*.csv"))
    counts = {name: listed.count(name) for name in tables if name != "made.csv"}
    said += [f"{name} has {n} lines; give it one" for name, n in counts.items() if n != 1]
    for row in rows:
        if row["file"] not in tables:
            said.append(f"{row['file']} is no file of {FIGURES}; remove its line")
        elif changelog_of(root, row["commit"]) is None:
            said.append(
                f"{row['file']}: HEAD does not contain {row['commit']}; "
                "name a commit of its history"
            )
    return said


def main(root: Path) -> int:
    """Prints what is of an older physics."""
    with (root / FIGURES / "made.csv").open(encoding="utf-8", newline="") as file:
        reader = csv.DictReader(file)
        rows = list(reader)
    if reader.fieldnames != COLUMNS:
        print(f"error: {FIGURES}/made.csv: its columns must be {', '.join(COLUMNS)}")
        return 2
    faults = wrong(root, rows)
    if faults:
        print(*(f"error: {FIGURES}/made.csv: {fault}" for fault in faults), sep="\n")
        return 2
    present = entries((root / "CHANGELOG.md").read_text(encoding="utf-8"))
    older = 0
    for row in rows:
        known = {entry.begins for entry in entries(changelog_of(root, row["commit"]) or "")}
        features = frozenset(row["features"].split())
        since = [e for e in present if e.begins not in known and e.features <= features]
        of = "runs of" if row["digest"] else "committed in"
        state = "older physics" if since else "present physics"
        print(f"{row['file']}: {state}, {of} {row['commit']}")
        for entry in since:
            print(f"  since then: {entry.begins} …")
        older += bool(since)
    print(f"{older} of {len(rows)} tables are of an older physics")
    return int(older > 0)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1]))
