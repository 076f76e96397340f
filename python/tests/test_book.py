"""scripts/book.py finds what is wrong with a book."""

from __future__ import annotations

import ast
import importlib.util
import inspect
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

import gshear
from gshear import analysis, mdanalysis, plots

CHECKOUT = Path(__file__).resolve().parents[2]
MDBOOK = """#!/bin/sh
# Stands for mdBook: a page for each file of Markdown, whose links lead to pages.
[ -z "$SAYS" ] || echo "$SAYS" >&2
cd "$2/src" || exit 1
mkdir -p "$4" && cp -r . "$4"
find . -name '*.md' ! -name SUMMARY.md | while read -r page; do
    mkdir -p "$4/$(dirname "$page")"
    sed -E -e '/^```/,/^```/d' -e 's|^# (.*)|<h1 id="\\1">\\1</h1>|' -e 's|\\.md|.html|' \
        -e 's|\\[(.*)\\]\\(([^)]*)\\)|<a href="\\2">\\1</a>|' "$page" >"$4/${page%.md}.html"
done
"""


@pytest.fixture(scope="module")
def book() -> ModuleType:
    path = CHECKOUT / "scripts" / "book.py"
    spec = importlib.util.spec_from_file_location("book", path)
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules["book"] = module
    # The modules beside it.
    sys.path.append(str(path.parent))
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def formulas(book: ModuleType) -> ModuleType:
    module: ModuleType = book.formulas
    return module


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Returns a small checkout whose book has no fault."""
    root = tmp_path / "checkout"
    (root / "docs" / "more").mkdir(parents=True)
    files = {
        "README.md": "# Read\n[a](docs/a.md#a)\n",
        "NOTES.md": "# Notes\n[a](docs/a.md)\n",
        "docs/README.md": "# Docs\n## Part\n- [A](a.md): a\n"
        "  - [B](more/b.md)\n- [N](../NOTES.md)\n",
        "docs/a.md": "# a\n[b](more/b.md#b)\n\n```text\n[none](none.md)\n```\n",
        "docs/more/b.md": "# b\n[notes](../../NOTES.md)\n[NOTES.md](../../NOTES.md)\n",
        "docs/book.toml": "",
        "docs/book.css": "",
    }
    for name, text in files.items():
        (root / name).write_text(text)
    mdbook = root / "mdbook"
    mdbook.write_text(MDBOOK)
    mdbook.chmod(0o755)
    return root


def faults(book: ModuleType, root: Path) -> str:
    try:
        book.build(root, str(root / "mdbook"), None, root / "out")
    except book.BookError as error:
        return str(error)
    return ""


def test_a_sound_book_is_built(book: ModuleType, root: Path) -> None:
    assert faults(book, root) == ""
    summary = (root / "out-source" / "src" / "SUMMARY.md").read_text()
    assert "# Part\n\n- [A](a.md)\n  - [B](more/b.md)\n- [N](repository/NOTES.md)\n" in summary
    page = (root / "out" / "more" / "b.html").read_text()
    assert '<a href="../repository/NOTES.html">notes</a>' in page
    # The file's name is the title of the page.
    assert '<a href="../repository/NOTES.html">Notes</a>' in page


def test_a_link_whose_text_is_code_is_one(book: ModuleType, root: Path) -> None:
    (root / "docs" / "t.csv").write_text("a,b\n")
    (root / "docs" / "a.md").write_text("# a\n[`docs/t.csv`](t.csv)\n")
    assert faults(book, root) == ""
    assert (root / "out" / "t.csv").read_text() == "a,b\n"


def test_a_link_in_code_is_none(book: ModuleType) -> None:
    text = "`[x](a.md)` [y](b.md)\n```\n[z](c.md)\n```\n[`w`](d.md)\n"
    found: list[str] = []

    def note(link: re.Match[str]) -> str:
        found.append(link["target"])
        return link.group()

    assert book.outside_code(text, book.LINK, note) == text
    assert found == ["b.md", "d.md"]


@pytest.mark.parametrize(
    ("name", "text", "fault"),
    [
        ("docs/a.md", "# a\n[x](none.md)\n", "docs/a.md: none.md: no such file"),
        ("docs/a.md", "# a\n[`x`](none.md)\n", "docs/a.md: none.md: no such file"),
        ("docs/a.md", "# a\n[x](more/b.md#c)\n", "docs/a.md: more/b.md#c: no such heading"),
        ("docs/a.md", "# a\n[x](#c)\n", "docs/a.md: #c: no such heading"),
        ("README.md", "# r\n[x](docs/c.md)\n", "README.md: docs/c.md: no such file"),
        ("docs/c.md", "# c\n", "docs/README.md does not name docs/c.md"),
        (
            "docs/README.md",
            "# d\n## P\n- [A](a.md)\n- [B](more/b.md)\n- [C](c.md)\n",
            "names docs/c.md",
        ),
        (
            "docs/README.md",
            "# d\n## P\n- [A](a.md)\n- [B](more/b.md)\n- [A](a.md)\n",
            "names twice",
        ),
    ],
)
def test_a_fault_of_the_pages_is_found(
    book: ModuleType, root: Path, name: str, text: str, fault: str
) -> None:
    (root / name).write_text(text)
    assert fault in faults(book, root)


def test_a_warning_of_mdbook_is_a_fault(
    book: ModuleType, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SAYS", " WARN unclosed HTML tag")
    assert "unclosed HTML tag" in faults(book, root)


def test_links_of_the_built_pages_are_followed(book: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text('<a href="b.html#x">b</a><img src="c.png">')
    (tmp_path / "b.html").write_text('<h1 id="y">y</h1><a href="https://example.org">e</a>')
    assert book.html_faults(tmp_path) == [
        "a.html: b.html#x: no such anchor",
        "a.html: c.png: no such file",
    ]


def test_formulas_of_all_pages_convert(formulas: ModuleType) -> None:
    pages = [*(CHECKOUT / "docs").rglob("*.md"), *CHECKOUT.glob("*.md")]
    texts = [page.read_text() for page in pages]
    converted = [formulas.typeset(text) for text in texts]
    before, after = ("".join(all_of).count for all_of in (texts, converted))
    assert after("<math ") == before("$`") + before("```math\n")
    assert after("<math ") > 300


def test_formulas_become_mathml(formulas: ModuleType) -> None:
    text = "| $`\\lvert x\\rvert`$ | `$` |\n\n- a\n  ```math\n  a^* =\n  \\ln b\n  ```\n"
    assert formulas.typeset(text) == (
        '| <math display="inline"><mrow><mo form="prefix" stretchy="false">&#124;</mo><mi>x</mi>'
        '<mo form="postfix" stretchy="false">&#124;</mo></mrow></math> | `$` |\n\n'
        '- a\n  <div class="formula"><math display="block"><mrow><msup><mi>a</mi><mo>&#42;</mo>'
        '</msup><mo>=</mo><mi>ln</mi><mspace width="0.17em"></mspace><mi>b</mi></mrow></math></div>'
        "\n"
    )


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("$`\\foo x`$", r"\foo is not understood: \foo x"),
        ("$`\\frac{1}{2`$", r"braces do not match: \frac{1}{2"),
        ("$`a}b{`$", "braces do not match: a}b{"),
        ("$`a & b`$", "& is not understood: a & b"),
        ("$`x^`$", "MissingSuperScriptOrSubscriptError: x^"),
        ("$`√x`$", "write √ as a command of LaTeX: √x"),
        ("```math\n\\left( x\n```\n", r"ExtraLeftOrMissingRightError: \left( x"),
        ("the $`x`$th", "no space or bracket beside it: $`x`$"),
        ("the ($`x` and", "a formula without an end: '$`x` and"),
    ],
)
def test_a_formula_that_does_not_convert_is_a_fault(
    book: ModuleType, root: Path, text: str, fault: str
) -> None:
    (root / "docs" / "a.md").write_text(f"# a\n{text}\n")
    assert f"docs/a.md: {fault}" in faults(book, root)


@pytest.mark.parametrize(
    ("plain", "latex"),
    [
        ("k_t' + ½(a² - t*)", r"k_t' + \tfrac12(a^2 - t^*)"),
        ("√(δR*) k_n δ^(3/2)", r"\sqrt{δR^*} k_n δ^{3/2}"),
        ("√δ ≤ √(2 m* k_n √(δR*))", r"\sqrt{δ} \le \sqrt{2 m^* k_n \sqrt{δR^*}}"),
        (
            "|F_t| ← max(0, x_drive - ẍ)",
            r"\lvert F_t\rvert \leftarrow \max(0, x_\mathrm{drive} - \ddot{x})",
        ),
        (
            "(2/3) 1e-9 d̄,   10⁻⁹ (ω_i-ω_j)_r",
            r"\tfrac{2}{3} 10^{-9} \bar{d}, \qquad 10^{-9} (ω_i-ω_j)_r",
        ),
    ],
)
def test_formulas_of_comments_are_translated(formulas: ModuleType, plain: str, latex: str) -> None:
    assert formulas.latex(plain) == latex
    assert formulas.mathml(latex)


@pytest.mark.parametrize(
    ("text", "marked"),
    [
        ("a grain at t+½Δt, 2 m of `k_t`", "a grain at $`t+\\tfrac12 Δt`$, 2 m of `k_t`"),
        ("A5: a γ_n (m), 3D D_max²", "A5: a $`γ_n`$ (m), 3D $`D_\\mathrm{max}^2`$"),
        ("J. Doe, LH's D²min, of i in n", "J. Doe, LH's D²min, of $`i`$ in $`n`$"),
        ("# α\n[a](b_c.md) λ\n", "# α\n[a](b_c.md) $`λ`$\n"),
    ],
)
def test_formulas_in_sentences_are_marked(formulas: ModuleType, text: str, marked: str) -> None:
    assert formulas.marked(text) == marked


def test_paragraphs_are_wrapped_but_formulas_are_whole(formulas: ModuleType) -> None:
    long = f"- {'word ' * 18}$`{'a + ' * 8}b`$ end\n"
    assert formulas.wrapped(long) == f"- {'word ' * 18}".rstrip() + f"\n  $`{'a + ' * 8}b`$ end\n"
    block = f"```math\n{'a ' * 60}\n```\n"
    assert formulas.wrapped(block) == block


def test_the_package_is_that_of_the_tests(formulas: ModuleType) -> None:
    packages = (CHECKOUT / "python" / "pyproject.toml").read_text()
    assert all(f'"{package}"' in packages for package in formulas.PACKAGES)


def test_the_page_of_laws_is_that_of_the_sources(book: ModuleType) -> None:
    text = book.laws(CHECKOUT)
    assert (CHECKOUT / "docs" / "reference" / "laws.md").read_text() == text
    assert text.count("\n## ") >= 5


def test_the_page_of_the_python_package_has_all_that_is_public(book: ModuleType) -> None:
    text = book.python_api(CHECKOUT)
    headings = set(re.findall(r"^###+ (.*)$", text, re.M))
    named = {name: getattr(gshear, name) for name in gshear.__all__}
    for module in (analysis, plots, mdanalysis):
        own = {n: item for n, item in vars(module).items() if callable(item) and n[0] != "_"}
        listed = set(getattr(module, "__all__", own))
        named |= {
            name: item
            for name, item in own.items()
            if name in listed and getattr(item, "__module__", "").startswith("gshear.")
        }
    members = {
        f"{name}.{member}"
        for name, item in named.items()
        if isinstance(item, type) and not issubclass(item, tuple)
        for member, value in vars(item).items()
        if member[0] != "_" and (inspect.isfunction(value) or isinstance(value, property))
    }
    assert {"Run.array", "Box.wrap", "Contacts.force"} <= members
    assert sorted((named.keys() | members) - headings) == []


def test_docstrings_become_markdown(book: ModuleType) -> None:
    text = '''
def f(x: int, *, y: dict[str, int] | None = None, **style: float) -> list[int]:
    """Does f.

        f(1)

    Args:
        x: The first,
            on two lines.
        **style: More.

    Returns:
        A list: of one.

    Raises:
        ValueError: Never.
    """
'''
    (item,) = book.public(ast.parse(text).body)
    assert book.described(item, "") == (
        "\n### f\n\n```python\n"
        "f(x: int, *, y: dict[str, int] | None=None, **style: float) -> list[int]\n```\n\n"
        "Does f.\n\n    f(1)\n\n**Args**\n\n- `x`: The first,\n  on two lines.\n"
        "- `**style`: More.\n\n**Returns**\n\nA list: of one.\n\n**Raises**\n\n"
        "- `ValueError`: Never.\n"
    )
    long = "name: int, " * 9 + "*, last: dict[str, int]"
    (item,) = book.public(ast.parse(f"def f({long}): ...").body)
    said = book.described(item, "")
    assert said.count("    name: int,\n") == 9
    assert "    *,\n    last: dict[str, int],\n)\n" in said
