"""The Rust sources say what they mean: `if` for conditions, nouns for values, few named closures.

The limits are those of well-kept programs of this size (ripgrep, rapier, rust-analyzer). Tests are
left out.
"""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
# A condition in place of an `if`.
CONDITION = re.compile(r"\.filter\(\|_\|")
# A preposition in place of a noun.
PREPOSITION = re.compile(r"\blet (mut )?of\b|\bof:(?!:)")
CLOSURE = re.compile(r"\blet (mut )?\w+(: [^=]*)? = (move )?\|")
# The head of a function up to its body.
HEAD = re.compile(r"\bfn \w+(<.*?>)?\s*\((.*?)\)\s*(->[^{;]*?)?(where[^{;]*)?[{;]", re.DOTALL)
# A parameter that is taken apart where it is declared.
TUPLE = re.compile(r"(^|,)\s*&?(mut )?[(\[][^()\[\]]*[)\]]\s*:")
TUPLES_PER_FUNCTION = 5 / 1000
CLOSURES_PER_LINE = 4 / 1000


def _code() -> dict[Path, str]:
    """Returns the sources of programs and crates without comments and tests."""
    sources = {}
    for path in sorted([*ROOT.glob("crates/*/src/**/*.rs"), *ROOT.glob("src/**/*.rs")]):
        if path.name == "tests.rs" or "tests" in path.relative_to(ROOT).parts:
            continue
        text = path.read_text("utf-8").split("#[cfg(test)]")[0]
        lines = [line for line in text.split("\n") if not line.lstrip().startswith("//")]
        sources[path] = "\n".join(line for line in lines if line.strip())
    return sources


def _places(pattern: re.Pattern[str]) -> list[str]:
    return [
        f"{path.relative_to(ROOT)}: {line.strip()}"
        for path, text in _code().items()
        for line in text.split("\n")
        if pattern.search(line)
    ]


def test_conditions_are_written_as_such() -> None:
    assert _places(CONDITION) == []


def test_values_have_nouns_as_names() -> None:
    assert _places(PREPOSITION) == []


def test_few_closures_have_names() -> None:
    lines = sum(text.count("\n") + 1 for text in _code().values())
    found = _places(CLOSURE)
    assert len(found) <= CLOSURES_PER_LINE * lines, "\n".join(found)


def test_few_parameters_are_taken_apart_where_they_are_declared() -> None:
    heads = [head for text in _code().values() for head in HEAD.finditer(text)]
    found = [head[0] for head in heads if TUPLE.search(head[2])]
    assert len(heads) > 1000
    assert len(found) <= TUPLES_PER_FUNCTION * len(heads), "\n".join(found)
