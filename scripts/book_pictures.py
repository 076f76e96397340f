#!/usr/bin/env python3
"""Takes pictures of pages of the book, to look at after a change of docs/book.css.

    make book
    scripts/book_pictures.py         writes target/book-pictures/book-*.png

Needs Chromium: CHROMIUM in the environment, or one of the usual names in the path. Makes an
environment for the package that reduces the colours beside them.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

from environment import run_in

ROOT = Path(__file__).resolve().parents[1]
BOOK = ROOT / "target/book"
PICTURES = ROOT / "target/book-pictures"
ENVIRONMENT = PICTURES / "environment"
PACKAGES = ["pillow>=11,<13"]
run_in(ENVIRONMENT, PACKAGES)

from PIL import Image  # noqa: E402

PROGRAMS = ("chromium", "chromium-browser", "google-chrome")
# No network, no sound, no windows; as root, as in a container, there is no sandbox.
OPTIONS = [
    "--headless",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
    "--allow-file-access-from-files",
    "--virtual-time-budget=5000",
    # Without it, tiles that are not painted yet are white.
    "--run-all-compositor-stages-before-draw",
]
COLOURS = 64
MOST_BYTES = 150_000


@dataclass(frozen=True)
class Picture:
    """A page in windows of these widths, side by side."""

    name: str
    page: str
    widths: tuple[int, ...]
    height: int


PICTURES = [
    Picture("contents", "index.html", (1250,), 1540),
    Picture("tutorial", "tutorial/first-run.html", (1250,), 900),
    Picture("reference", "reference/keys.html", (1400,), 900),
    Picture("theory", "explanation/scheme.html", (1150, 400), 900),
]
GAP = 12


def chromium() -> str:
    """Returns the program."""
    given = os.environ.get("CHROMIUM")
    found = [shutil.which(name) for name in ((given,) if given else PROGRAMS)]
    for program in found:
        if program:
            return program
    raise SystemExit("error: no Chromium; install it, or set CHROMIUM to its path")


def take(program: str, picture: Picture, target: Path) -> None:
    """Takes a picture."""
    page, mark, anchor = picture.page.partition("#")
    address = f"{(BOOK / page).as_uri()}{mark}{anchor}"
    frames = "".join(
        f'<iframe src="{address}" width="{width}" height="{picture.height}"></iframe>'
        for width in picture.widths
    )
    # A page in a frame is as wide as a window of that width, however narrow, and begins at its
    # anchor.
    style = f"body{{margin:0;display:flex;gap:{GAP}px;background:#999}}iframe{{border:0}}"
    width = sum(picture.widths) + GAP * (len(picture.widths) - 1)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "page.html").write_text(f"<style>{style}</style>{frames}")
        command = [program, *OPTIONS, *(["--no-sandbox"] if os.geteuid() == 0 else [])]
        command += [f"--user-data-dir={folder / 'user'}"]
        command += [f"--window-size={width},{picture.height}"]
        command += [f"--screenshot={folder / 'page.png'}", (folder / "page.html").as_uri()]
        subprocess.run(command, check=True, capture_output=True, timeout=120)
        with Image.open(folder / "page.png") as image:
            if len(image.getcolors(1 << 24) or []) < COLOURS:
                raise SystemExit(f"error: {picture.page}: the picture is empty")
            few = image.convert("RGB").quantize(COLOURS, Image.Quantize.MAXCOVERAGE)
        few.save(target, optimize=True)
    size = target.stat().st_size
    if size > MOST_BYTES:
        raise SystemExit(f"error: {target}: {size} bytes")
    print(target.relative_to(ROOT), size)


def main() -> None:
    """Takes all pictures."""
    if not (BOOK / "index.html").is_file():
        raise SystemExit("error: target/book holds no book; run make book")
    program = chromium()
    for picture in PICTURES:
        take(program, picture, PICTURES / f"book-{picture.name}.png")


if __name__ == "__main__":
    main()
