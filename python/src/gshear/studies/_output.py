"""What the studies share: calling gshear-reduce, writing tables, figures and a page, exit codes."""

from __future__ import annotations

import argparse
import csv
import functools
import html
import math
import os
import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

import pandas as pd
from matplotlib.figure import Figure as Drawing

from .. import _files, programs
from ..errors import GshearError, ProgramFailedError, RunError

# Okabe & Ito: blue, vermillion, green, purple, orange, sky blue, black.
CURVES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#22262b")
INK, GREY, PALE = "#22262b", "#8a9199", "#e4e7ea"
STYLE = """body { font-family: sans-serif; max-width: 75em; margin: auto; padding: 1em; }
figure { margin: 2em 0; } img { max-width: 100%; } th { text-align: left; font-weight: normal; }
td, th { padding: 0.1em 1em 0.1em 0; border-bottom: 1px solid #e4e7ea; vertical-align: top; }"""


# Caption, figure, and its tables by the end of their file names.
Drawn: TypeAlias = "tuple[str, Drawing, dict[str, pd.DataFrame]]"


def save(folder: Path, name: str, drawn: Drawn) -> str:
    """Writes a figure as SVG, PDF and PNG, and its tables as CSV; returns its HTML."""
    caption, figure, tables = drawn
    # Once is enough for all files.
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    for suffix in ("svg", "pdf", "png"):
        draw = functools.partial(figure.savefig, format=suffix, dpi=150, bbox_inches="tight")
        _files.write(folder / f"{name}.{suffix}", draw)
    for end, table in tables.items():
        write_table(folder / f"{name}{end}.csv", table)
    files = [f"{name}{end}.csv" for end in tables] + [f"{name}.pdf", f"{name}.png"]
    links = ", ".join(f'<a href="{file}">{file}</a>' for file in files)
    return (
        f'<figure id="{name}">\n<img src="{name}.svg" alt="{name}"/>\n'
        f"<figcaption>{html.escape(caption)} {links}</figcaption>\n</figure>\n"
    )


def save_numbered(folder: Path, figures: Mapping[int, Drawn | str]) -> str:
    """Saves figures under their numbers, or says why one is missing; returns the HTML."""
    body = ""
    for number, found in figures.items():
        if isinstance(found, str):
            body += f"<p>Figure {number}: {html.escape(found)}.</p>\n"
        else:
            drawn = (f"Figure {number}. {found[0]}", found[1], found[2])
            body += save(folder, f"fig-{number:02}", drawn)
    return body


def drawing(width: float, height: float) -> Drawing:
    """Returns an empty figure of this size (inches)."""
    return Drawing(figsize=(width, height), layout="constrained")


def page(path: Path, title: str, lead: str, body: str) -> Path:
    """Writes the page and returns its path; `body` is HTML."""
    title, lead = html.escape(title), html.escape(lead)
    _files.write(
        path,
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8"/>\n'
        f"<title>{title}</title>\n<style>\n{STYLE}\n</style>\n</head>\n<body>\n<h1>{title}</h1>\n<p>{lead}</p>\n"
        f"{body}</body>\n</html>\n",
    )
    return path


def html_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Returns a table as HTML; its cells are text."""
    lines = [f"<tr>{''.join(f'<td>{html.escape(cell)}</td>' for cell in head)}</tr>\n"]
    for first, *rest in rows:
        cells = "".join(f"<td>{html.escape(cell)}</td>" for cell in rest)
        lines.append(f"<tr><th>{html.escape(first)}</th>{cells}</tr>\n")
    return f"<table>\n{''.join(lines)}</table>\n"


def write_table(path: Path, table: pd.DataFrame, *, quoted: bool = False) -> None:
    """Writes a table as CSV; numbers read back to the same bits."""
    text = table.to_csv(
        index=False, na_rep="NaN", quoting=csv.QUOTE_ALL if quoted else csv.QUOTE_MINIMAL
    )
    _files.write(path, text)


def reduce(command: str, run: Path, out: Path, *options: str | os.PathLike[str]) -> None:
    """Runs a command of gshear-reduce on a run; it writes into the folder `out`."""
    words = [programs.find("gshear-reduce"), command, run, "--out", out, *options]
    out.mkdir(parents=True, exist_ok=True)
    programs.run(words, quiet=True)


def folder_of(out: Path | None, run: Path, name: str) -> Path:
    """Returns the folder that the user has named, or that of this name in the folder of the run.

    Raises:
        RunError: It is a link, which somebody else may have put into the folder of the run.
    """
    if out is not None:
        return out
    folder = run / name
    if folder.is_symlink():
        raise RunError(
            f"{folder}: is a link, where results are not written; "
            "remove it, or give the place with --out"
        )
    return folder


def scientific(value: float, digits: int) -> str:
    """Returns a number as 1.23e-4, with this many digits after the point."""
    text = f"{value:.{digits}e}".replace("nan", "NaN")
    return re.sub(r"e([+-])0*(?=\d)", lambda m: "e-" if m[1] == "-" else "e", text)


def spread(values: Iterable[float]) -> dict[str, float]:
    """Returns statistics of the values that are not NaN.

    `runs` is their number, `error` the standard error of the mean s/√n with s² = Σ(x - x̄)²/(n - 1);
    a statistic is NaN if there are too few values.
    """
    known = pd.Series(sorted(x for x in values if not math.isnan(x)), dtype="float64")
    found = known.agg(["mean", "sem", "min", "median", "max"]).to_list()
    names = ["mean", "error", "least", "median", "greatest"]
    return {"runs": len(known)} | dict(zip(names, found, strict=True))


def main(
    parser: argparse.ArgumentParser,
    study: Callable[[argparse.Namespace], Path],
    arguments: Sequence[str] | None = None,
) -> int:
    """Runs a study and returns its exit code: 2 for bad input, otherwise that of gshear-reduce."""
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN", help="folder of a run")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder to write into")
    try:
        path = study(parser.parse_args(arguments))
    except ProgramFailedError as error:
        print(error.output.strip() or str(error), file=sys.stderr)
        return error.exit_code
    except (GshearError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(f"wrote {path}")
    return 0
