"""No file of a crate imports, through others, one that imports it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = [*sorted((ROOT / "crates").glob("*/src")), ROOT / "src"]
Module = tuple[str, ...]


def leaves(tree: str) -> list[str]:
    """Paths of a use tree: `a::{b, c::d}` is `a::b` and `a::c::d`."""
    head, brace, rest = tree.partition("{")
    if not brace:
        return [tree.split(" as ")[0].strip()]
    parts, depth, part = [], 0, ""
    for letter in rest[: rest.rindex("}")]:
        depth += (letter == "{") - (letter == "}")
        if letter == "," and depth == 0:
            parts.append(part)
            part = ""
        else:
            part += letter
    return [
        head.strip() + leaf
        for part in [*parts, part]
        if part.strip()
        for leaf in leaves(part.strip())
    ]


class Crate:
    """Modules of a crate and what they import."""

    def __init__(self, source: Path) -> None:
        self.text: dict[Module, str] = {}
        for path in source.rglob("*.rs"):
            parts = path.relative_to(source).with_suffix("").parts
            if "tests" in parts or "bin" in parts:
                continue
            module = parts[:-1] if parts[-1] in ("mod", "lib", "main") else parts
            text = path.read_text(encoding="utf-8").split("#[cfg(test)]\nmod ")[0]
            self.text[module] = re.sub(r"//.*", "", text)

    def absolute(self, module: Module, path: str) -> Module | None:
        words = tuple(path.split("::"))
        if words[0] == "crate":
            return words[1:]
        while words[0] in ("super", "self"):
            module = module[:-1] if words[0] == "super" else module
            words = words[1:]
            if not words:
                return module
        else:
            return (*module, *words) if path.startswith(("super", "self")) else None

    def uses(self, module: Module, public: bool = False) -> list[Module]:
        """What `use` and paths name, from the root of the crate on."""
        text = self.text[module]
        # At the beginning of a line: messages have the word, too.
        public_use = r"pub(?:\([a-z]+\))? "
        prefix = r"^\s*" + (public_use if public else rf"(?:{public_use})?")
        trees = re.findall(prefix + r"use ([^;]+);", text, re.MULTILINE)
        paths = [leaf for tree in trees for leaf in leaves(" ".join(tree.split()))]
        if public:
            return [self.absolute(module, path) or (*module, *path.split("::")) for path in paths]
        paths += re.findall(r"\b(?:crate|super)(?:::\w+)+", re.sub(r"\buse [^;]+;", "", text))
        found = [self.absolute(module, path) for path in paths]
        return [path for path in found if path is not None]

    def home(self, path: Module, depth: int = 0) -> Module:
        """The module that defines what a path names, through `pub use`."""
        module = path
        while module not in self.text:
            module = module[:-1]
        name = path[len(module) : len(module) + 1]
        if name and depth < 5:
            for used in self.uses(module, public=True):
                if used[-1:] == name and used != path:
                    return self.home(used, depth + 1)
        return module

    def circle(self) -> list[Module]:
        """Modules in a circle; those on the way to a module are no part of it."""
        arrows = {
            module: {
                home
                for home in map(self.home, self.uses(module))
                if home != module[: len(home)] and module != home[: len(module)]
            }
            for module in self.text
        }
        while True:
            entered = set().union(*arrows.values()) & arrows.keys()
            inner = {module for module in entered if arrows[module] & arrows.keys()}
            if inner == arrows.keys():
                return sorted(inner)
            arrows = {module: arrows[module] & inner for module in inner}


@pytest.mark.parametrize("source", SOURCES, ids=lambda source: source.parent.name)
def test_no_files_import_each_other(source: Path) -> None:
    assert Crate(source).circle() == []


def test_a_circle_is_found(tmp_path: Path) -> None:
    (tmp_path / "b").mkdir()
    (tmp_path / "lib.rs").write_text("mod a;\nmod b;\n")
    (tmp_path / "a.rs").write_text("use crate::b::{Two, Three as Other};\npub struct One;\n")
    (tmp_path / "b" / "mod.rs").write_text("mod two;\npub use two::Two;\n")
    (tmp_path / "b" / "two.rs").write_text("pub struct Two(super::super::a::One);\n")
    assert Crate(tmp_path).circle() == [("a",), ("b", "two")]
    (tmp_path / "b" / "two.rs").write_text(
        "pub struct Two;\n#[cfg(test)]\nmod tests { use crate::a::One; }\n"
    )
    assert Crate(tmp_path).circle() == []
