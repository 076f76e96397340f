#!/usr/bin/env python3
"""Builds the book of docs/ with mdBook, with the API of the crates beside it, and checks its links.

    scripts/book.py build --mdbook PROGRAM --api target/doc    writes target/book
    scripts/book.py pages [--check]                            writes docs/reference/laws.md

The lists of docs/README.md are the table of contents. Pages outside docs/ that it names are pages
of the book, too; other files of the repository that a page links are copied beside it. The pages of
the Rust and the Python API are made of their sources and belong to the book alone. A link with
the name of a page's file as its text gets the title of the page. Warnings of
mdBook and links that lead nowhere are errors, both in the book and in the Markdown files as a
code-hosting site shows them. Formulas in LaTeX become MathML (formulas.py).
"""

from __future__ import annotations

import argparse
import ast
import importlib.util
import inspect
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from html.parser import HTMLParser
from pathlib import Path, PurePosixPath
from urllib.parse import unquote, urlsplit

import formulas
from formulas import CODE

from environment import run_in

CONTENTS = "docs/README.md"
RUST_PAGE = "api.md"
PYTHON_PAGE = "python-api.md"
LAWS = "docs/reference/laws.md"
PACKAGE = "python/src/gshear"
# Modules of the Python package whose names users import.
MODULES = ("__init__", "analysis", "plots", "mdanalysis")
# What laws have beside them: file and title; the adhesions follow the second.
BESIDE_LAWS = {
    "laws/rolling_spheres.rs": "rolling and twisting of spheres",
    "laws/ageing.rs": "friction that grows with the age",
    "adhesions/mod.rs": "adhesion",
    "laws/mixture.rs": "several materials",
}

ITEM = re.compile(r"^(?P<indent> *)- \[(?P<title>[^]]+)\]\((?P<path>[^)#\s]+\.md)\)")
LINK = re.compile(r"(?P<before>!?\[(?:[^][]|\[[^]]*\])*\]\()(?P<target>[^)\s]+)(?P<after>\))")


Replacement = Callable[[re.Match[str]], str]


class BookError(Exception):
    """What is wrong with the book, one line a fault."""


@dataclass(frozen=True)
class Entry:
    """A line of the table of contents: a part, or a page of one."""

    title: str
    path: str | None = None
    depth: int = 0


def normal(path: str) -> str:
    """A path of the repository without `..`."""
    return os.path.normpath(path)


def contents(root: Path) -> list[Entry]:
    """The table of contents: headings of docs/README.md, and the pages that their lists name."""
    entries = []
    for line in (root / CONTENTS).read_text().splitlines():
        if line.startswith("## "):
            entries.append(Entry(line[3:].strip()))
        elif found := ITEM.match(line):
            path = normal(f"docs/{found['path']}")
            entries.append(Entry(found["title"], path, len(found["indent"]) // 2))
    return entries


def outside_code(text: str, change: re.Pattern[str], by: Replacement) -> str:
    """`change.sub` on all that is not code; what `change` finds may hold code."""
    either = re.compile(f"{CODE.pattern}|{change.pattern}", CODE.flags | change.flags)
    return either.sub(lambda found: found.group() if found["code"] else by(found), text)


def is_outside(target: str) -> bool:
    """A link to another site."""
    return bool(urlsplit(target).scheme)


class Source:
    """The files of the book, as mdBook reads them."""

    def __init__(self, root: Path, folder: Path) -> None:
        self.root = root
        self.folder = folder
        self.entries = contents(root)
        self.pages = [CONTENTS] + [e.path for e in self.entries if e.path]
        self.faults: list[str] = []
        self.copied: set[str] = set()

    def place(self, path: str) -> str:
        """Where a file of the repository is in the book; README.md becomes index.html."""
        if path == "README.md":
            path = CONTENTS
        path = path.removeprefix("docs/") if path.startswith("docs/") else f"repository/{path}"
        return (
            str(PurePosixPath(path).with_name("index.md")) if path.endswith("README.md") else path
        )

    def write(self) -> None:
        """Writes all pages, the files that they link, and SUMMARY.md."""
        docs = self.root / "docs"
        listed = set(self.pages)
        if len(listed) < len(self.pages):
            twice = sorted({p for p in self.pages if self.pages.count(p) > 1})
            self.faults.append(f"{CONTENTS} names twice: {', '.join(twice)}")
        for page in sorted(docs.rglob("*.md")):
            name = page.relative_to(self.root).as_posix()
            if name not in listed:
                self.faults.append(f"{CONTENTS} does not name {name}")
        for name in dict.fromkeys(self.pages):
            if (self.root / name).is_file():
                self.write_page(name)
            else:
                self.faults.append(f"{CONTENTS} names {name}, which does not exist")
        self.write_api()
        self.write_summary()

    def write_page(self, name: str) -> None:
        """Writes a page, with its links as the places in the book want them."""

        def moved(found: re.Match[str]) -> str:
            target = found["target"]
            if is_outside(target) or target.startswith("#"):
                return found.group()
            path, mark, anchor = target.partition("#")
            to = normal(str(PurePosixPath(name).parent / unquote(path)))
            if (self.root / to).is_dir():
                to = f"{to}/README.md"
            # A missing file is a fault of the Markdown files, which `source_faults` finds.
            if to not in self.pages and to != "README.md" and (self.root / to).is_file():
                self.copy(to)
            start = PurePosixPath(self.place(name)).parent
            path = os.path.relpath(self.place(to), start)
            before = found["before"]
            # Readers of the book know pages, not files.
            names = (target.partition("#")[0], PurePosixPath(to).name)
            if to in self.pages and before in [f"[{name}](" for name in names]:
                before = f"[{self.title(to)}]("
            return f"{before}{path}{mark}{anchor}{found['after']}"

        text = outside_code((self.root / name).read_text(), LINK, moved)
        try:
            text = formulas.typeset(text)
        except formulas.FormulaError as error:
            self.faults += [f"{name}: {line}" for line in str(error).splitlines()]
        target = self.folder / self.place(name)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text)

    def title(self, name: str) -> str:
        """The title of a page, by its first heading."""
        page = self.root / name
        heading = re.search(r"^# (.+)$", page.read_text(), re.M) if page.is_file() else None
        return heading[1] if heading else name

    def copy(self, name: str) -> None:
        """Copies a file that is no page."""
        if name in self.copied:
            return
        self.copied.add(name)
        target = self.folder / self.place(name)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(self.root / name, target)

    def write_api(self) -> None:
        """The page of the Python package, and one that leads to rustdoc's."""
        if (self.root / PACKAGE).is_dir():
            (self.folder / PYTHON_PAGE).write_text(python_api(self.root))
        rows = []
        for file in sorted((self.root / "crates").glob("*/Cargo.toml")):
            package = dict(re.findall(r'^(name|description) = "(.*)"$', file.read_text(), re.M))
            crate = package["name"].replace("-", "_")
            about = package.get("description", "")
            rows.append(f"| [{package['name']}](api/{crate}/index.html) | {about} |")
        if rows:
            text = "# Rust API\n\nThe crates of the workspace, documented by rustdoc.\n\n"
            text += "| crate | content |\n| --- | --- |\n" + "\n".join(rows) + "\n"
            (self.folder / RUST_PAGE).write_text(text)

    def write_summary(self) -> None:
        """Writes mdBook's table of contents."""
        lines = ["# Summary", "", "[Documentation](index.md)"]
        part = ""
        for entry in [*self.entries, Entry("")]:
            if entry.path:
                lines.append(f"{'  ' * entry.depth}- [{entry.title}]({self.place(entry.path)})")
                continue
            pages = (
                {"Python API": PYTHON_PAGE, "Rust API": RUST_PAGE} if part == "Reference" else {}
            )
            for title, page in pages.items():
                if (self.folder / page).exists():
                    lines.append(f"- [{title}]({page})")
            part = entry.title
            lines += ["", f"# {part}", ""] if part else []
        (self.folder / "SUMMARY.md").write_text("\n".join(lines) + "\n")


def slugs(text: str) -> set[str]:
    """Anchors of a page's headings as code-hosting sites make them."""
    found: dict[str, int] = {}
    anchors = set()
    for heading in re.findall(r"^#{1,6} +(.+?) *#*$", CODE.sub(keep_inline, text), re.M):
        plain = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading)
        slug = "".join(c for c in plain.lower() if c.isalnum() or c in " -_").replace(" ", "-")
        count = found.get(slug, 0)
        found[slug] = count + 1
        anchors.add(f"{slug}-{count}" if count else slug)
    return anchors | set(re.findall(r"<a (?:id|name)=\"([^\"]+)\"", text))


def keep_inline(code: re.Match[str]) -> str:
    """Code inside a line without its ticks; nothing of a block."""
    return "" if code["fence"] else code.group().strip("`")


def source_faults(root: Path, pages: list[str]) -> list[str]:
    """Links between the Markdown files that lead nowhere on a code-hosting site."""
    faults = []
    for name in dict.fromkeys(pages):
        if not (root / name).is_file():
            continue
        text = CODE.sub("", (root / name).read_text())
        for link in LINK.finditer(text):
            target = link["target"]
            if is_outside(target):
                continue
            path, _, anchor = target.partition("#")
            to = normal(str(PurePosixPath(name).parent / unquote(path))) if path else name
            if not (root / to).exists():
                faults.append(f"{name}: {target}: no such file")
            elif (
                anchor
                and to.endswith(".md")
                and unquote(anchor) not in slugs((root / to).read_text())
            ):
                faults.append(f"{name}: {target}: no such heading")
    return faults


class Page(HTMLParser):
    """The links and anchors of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Notes the links and anchors of an element."""
        values = dict(attrs)
        for name in ("id", "name"):
            if value := values.get(name):
                self.anchors.add(value)
        for name in ("href", "src"):
            if (value := values.get(name)) and tag != "base":
                self.links.append(value)


def html_faults(book: Path) -> list[str]:
    """Links of the book's pages, not those of rustdoc, that lead nowhere."""
    pages: dict[Path, Page] = {}

    def page(path: Path) -> Page:
        if path not in pages:
            pages[path] = Page(path.read_text())
        return pages[path]

    faults = []
    for path in sorted(book.rglob("*.html")):
        # The page for addresses that do not exist has links from the root of the site.
        if path.relative_to(book).parts[0] == "api" or path.name in ("404.html", "toc.html"):
            continue
        for link in page(path).links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            to = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            where = f"{path.relative_to(book)}: {link}"
            if not to.is_file():
                faults.append(f"{where}: no such file")
            elif (
                parts.fragment
                and to.suffix == ".html"
                and unquote(parts.fragment) not in page(to).anchors
            ):
                faults.append(f"{where}: no such anchor")
    return faults


def build(root: Path, mdbook: str, api: Path | None, book: Path) -> None:
    """Writes the book into the folder `book`."""
    source = book.with_name(f"{book.name}-source")
    for folder in (source, book):
        shutil.rmtree(folder, ignore_errors=True)
    (source / "src").mkdir(parents=True)
    for file in ("book.toml", "book.css"):
        shutil.copyfile(root / "docs" / file, source / file)
    pages = Source(root, source / "src")
    pages.write()
    faults = pages.faults + source_faults(root, ["README.md", *pages.pages])
    if faults:
        raise BookError("\n".join(faults))
    command = [mdbook, "build", str(source), "--dest-dir", str(book.resolve())]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    said = ran.stdout + ran.stderr
    if ran.returncode or re.search(r"\b(WARN|ERROR)\b", said):
        raise BookError(f"mdbook has warnings:\n{said}")
    if api is not None:
        shutil.copytree(api, book / "api")
    if faults := html_faults(book):
        raise BookError("\n".join(faults))
    print(f"{len(pages.pages)} pages: {book / 'index.html'}")


def listed(folder: Path, name: str) -> list[str]:
    """The modules in a list of kinds, such as LAWS of laws/mod.rs."""
    found = re.search(name + r"[^=]*=\s*&?\[(.*?)\]", (folder / "mod.rs").read_text(), re.S)
    if found is None:
        raise BookError(f"{folder}/mod.rs: no list {name}")
    return re.findall(r"(\w+)::KIND", found[1])


def titled(path: Path) -> str:
    """The name of a law or an adhesion in its source file."""
    found = re.search(r"name: \"([^\"]+)\"", path.read_text())
    if found is None:
        raise BookError(f"{path}: no name")
    return found[1]


def laws(root: Path) -> str:
    """The page of the contact laws, from the front pages of their source files."""
    source = root / "crates/dem/src"
    pages = {}
    for name in listed(source / "laws", "LAWS"):
        path = source / f"laws/{name}.rs"
        pages[path] = titled(path)
    for file, title in BESIDE_LAWS.items():
        pages[source / file] = title
        if file == "adhesions/mod.rs":
            for name in listed(source / "adhesions", "ADHESIONS"):
                path = source / f"adhesions/{name}.rs"
                pages[path] = f"adhesion {titled(path)}"
    begin, end = "<!-- laws: generated -->\n", "<!-- end of laws -->\n"
    before, _, rest = (root / LAWS).read_text().partition(begin)
    text = ""
    for path, title in pages.items():
        front = [
            line[3:].removeprefix(" ")
            for line in path.read_text().splitlines()
            if line.startswith("//!")
        ]
        text += f"\n## {title}\n\n" + typeset_comment("\n".join(front)) + "\n"
    return f"{before}{begin}{text}\n{end}{rest.partition(end)[2]}"


def typeset_comment(text: str) -> str:
    """A comment whose formulas, in blocks of text and in sentences, are LaTeX."""
    text = formulas.wrapped(formulas.marked(text))
    return re.sub(
        r"^```text\n(.*?)^```$",
        lambda found: formulas.block(found[1].splitlines()),
        text,
        flags=re.M | re.S,
    )


Definition = ast.ClassDef | ast.FunctionDef


def python_api(root: Path) -> str:
    """The page of the Python package, from the docstrings of its public names."""
    folder = root / PACKAGE
    text = "# Python API\n\nFrom the docstrings of `gshear`; "
    text += "the [Python package](repository/python/index.md) has an overview.\n"
    for module in MODULES:
        path = folder / f"{module}.py"
        if not path.is_file():
            path = folder / module / "__init__.py"
        tree = ast.parse(path.read_text())
        name = "gshear" if module == "__init__" else f"gshear.{module}"
        text += f"\n## {name}\n\n{markdown(tree)}"
        found = public(tree.body)
        for line in tree.body if path.name == "__init__.py" else []:
            if isinstance(line, ast.ImportFrom) and line.level:
                source = path.parents[line.level - 1] / f"{line.module}.py"
                inner = public(ast.parse(source.read_text()).body)
                names = {alias.name for alias in line.names}
                # What a class has from another one belongs to it.
                classes = [i for i in inner if isinstance(i, ast.ClassDef) and i.name in names]
                names |= {ast.unparse(base) for item in classes for base in item.bases}
                found += [item for item in inner if item.name in names]
        text += "".join(described(item, "") for item in found)
    return text


def public(body: list[ast.stmt]) -> list[Definition]:
    """Classes, functions, methods and properties, not those of overloads."""
    items = [item for item in body if isinstance(item, ast.ClassDef | ast.FunctionDef)]
    return [item for item in items if item.name[0] != "_" and "overload" not in decorators(item)]


def decorators(item: Definition) -> list[str]:
    """The names of what stands above a definition."""
    return [ast.unparse(line) for line in item.decorator_list]


def described(item: Definition, owner: str) -> str:
    """The heading, signature and docstring of a definition, then those of its methods."""
    name = f"{owner}{item.name}"
    text = f"\n{'####' if owner else '###'} {name}\n\n"
    function: Definition | None = item
    if isinstance(item, ast.ClassDef):
        methods = [line for line in item.body if isinstance(line, ast.FunctionDef)]
        function = next((line for line in methods if line.name == "__init__"), None)
        # Objects of other classes are made by the package alone.
        function = function if "Args:" in (ast.get_docstring(item) or "") else None
    if isinstance(function, ast.FunctionDef):
        text += f"```python\n{signature(name, function, 'property' in decorators(item))}\n```\n\n"
    text += markdown(item)
    if isinstance(item, ast.ClassDef):
        text += "".join(described(method, f"{item.name}.") for method in public(item.body))
    return text


def signature(name: str, function: ast.FunctionDef, is_property: bool) -> str:
    """Name, arguments and result; an argument in each line if they are too long for one."""
    result = f" -> {ast.unparse(function.returns)}" if function.returns else ""
    if function.name == "__init__":
        result = ""
    if is_property:
        return name + result
    arguments = function.args
    if [first.arg for first in arguments.args[:1]] == ["self"]:
        arguments.args = arguments.args[1:]
    given = ast.unparse(arguments)
    line = f"{name}({given}){result}"
    if len(line) <= 88:
        return line
    parts = re.split(r", (?=\*{0,2}\w+[:=]|\*,)", given)
    return f"{name}(\n" + "".join(f"    {part},\n" for part in parts) + f"){result}"


def markdown(item: ast.Module | Definition) -> str:
    """A docstring, whose sections become lists and paragraphs."""
    text = ""
    section = ""
    for line in inspect.cleandoc(ast.get_docstring(item) or "").split("\n"):
        if found := re.fullmatch(r"(Args|Attributes|Raises|Returns):", line):
            section = found[1]
            text += f"**{section}**\n\n"
        elif not section:
            text += f"{line}\n"
        elif entry := re.match(r"    (\*{0,2}\w+): (.*)", line):
            text += f"- `{entry[1]}`: {entry[2]}\n" if section != "Returns" else f"{line[4:]}\n"
        else:
            text += f"{line[6:] if section != 'Returns' and line else line[4:]}\n"
    return text


def write_pages(root: Path, check: bool) -> None:
    """Writes the page of the laws, or only looks whether it is due."""
    page, text = root / LAWS, laws(root)
    if not check:
        page.write_text(text)
    elif not page.is_file() or page.read_text() != text:
        raise BookError(f"{LAWS} is not what the sources say: run make docs")


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--root", type=Path, default=Path(__file__).resolve().parent.parent)
    commands = parser.add_subparsers(dest="command", required=True)
    builds = commands.add_parser("build", help="write the book")
    builds.add_argument("--mdbook", default="mdbook")
    builds.add_argument("--api", type=Path, help="rustdoc's pages, which are copied into the book")
    builds.add_argument("--out", type=Path, help="folder of the book [target/book]")
    writes = commands.add_parser("pages", help=f"write {LAWS}")
    writes.add_argument("--check", action="store_true", help="only compare")
    arguments = parser.parse_args()
    try:
        if arguments.command == "pages":
            write_pages(arguments.root, arguments.check)
        else:
            if importlib.util.find_spec("latex2mathml") is None:
                run_in(arguments.root.resolve() / "target/book-formulas", formulas.PACKAGES)
            out = arguments.out or arguments.root / "target/book"
            build(arguments.root, arguments.mdbook, arguments.api, out)
    except BookError as error:
        for line in str(error).splitlines():
            print(f"error: {line}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
