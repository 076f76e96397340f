"""Comments of the Rust sources are as narrow as the code, but for tables and links."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
FOLDERS = ("crates", "src", "tests", "benches", "packaging/manual")
COLUMNS = 100
WIDE = re.compile(r"\s*//[/!]? *(\||\S+$)")


def test_comments_are_not_wider_than_the_code() -> None:
    sources = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.rs"))]
    wide = [
        f"{path}:{number}"
        for path in sources
        for number, line in enumerate(path.read_text("utf-8").split("\n"), 1)
        if len(line) > COLUMNS and line.lstrip().startswith("//") and not WIDE.match(line)
    ]
    assert wide == []
