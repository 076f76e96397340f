#!/usr/bin/env python3
"""Records the programs in a terminal of 80 and of 40 columns, for the book.

    scripts/recordings.py            writes docs/figures/terminal-*.cast and .svg

Each command runs in a pseudo-terminal of that width. What it writes there becomes a recording in
the format asciicast v2 (asciinema plays it) and a picture. It is an error if a line is longer than
the terminal is wide. Needs target/release; makes an environment for its packages in
target/recordings.
"""

from __future__ import annotations

import io
import json
import os
import pty
import re
import select
import shlex
import struct
import sys
import tempfile
import termios
import time
from dataclasses import dataclass, field
from fcntl import ioctl
from pathlib import Path

from environment import run_in

ROOT = Path(__file__).resolve().parents[1]
FIGURES = ROOT / "docs/figures"
ENVIRONMENT = ROOT / "target/recordings"
# A terminal emulator, and what draws its screen.
PACKAGES = ["pyte==0.8.2", "rich>=15,<16"]
run_in(ENVIRONMENT, PACKAGES)

import pyte  # noqa: E402
from rich.console import CONSOLE_SVG_FORMAT, Console  # noqa: E402
from rich.style import Style  # noqa: E402
from rich.terminal_theme import SVG_EXPORT_THEME  # noqa: E402
from rich.text import Text  # noqa: E402

WIDTHS = (80, 40)
HEIGHT = 24
# Names of colours that differ between the two packages.
NAMES = {"brown": "yellow"} | {
    name: name for name in ("black", "red", "green", "blue", "magenta", "cyan", "white")
}
# Lines of a screen on which nothing scrolls away.
TALL = 500
# Pixels of a page for one of the picture.
SCALE = 0.76
MOST_BYTES = 150_000
# Open MPI as root and on any cores; the scene below is fast enough.
VARIABLES = {
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
    "OMPI_MCA_hwloc_base_binding_policy": "none",
    "LC_ALL": "C.UTF-8",
    "TERM": "xterm-256color",
}


@dataclass(frozen=True)
class Subject:
    """What is recorded."""

    name: str
    title: str
    # What a user types, in lines of less than 40 columns.
    typed: str
    code: int = 0
    # The part of the recording at which the picture shows the screen.
    still: float = 1.0


SUBJECTS = [
    Subject("check", "Before a run", "gshear-mpi my.toml --check \\\n    > filled-in.toml"),
    Subject("run", "A run on two ranks", "mpirun -n 2 gshear-mpi my.toml", still=0.8),
    Subject("report", "Its report", "gshear-reduce report out/my\nls out/my"),
    Subject(
        "refused", "A wrong scene", "gshear-mpi my.toml \\\n    --set contact.fricton=0.4", code=2
    ),
]

# The default scene, long enough to be seen.
SCENE = """extends = "{default}"

[shear]
strain = 0.03

[output]
frame_strain = 1e-3
"""


@dataclass
class Recording:
    """What was written to a terminal, and when (s)."""

    width: int
    events: list[tuple[float, str]] = field(default_factory=list)

    def text(self, part: float = 1.0) -> str:
        """Returns what was written in this part of the time."""
        end = self.events[-1][0] * part
        return "".join(text for at, text in self.events if at <= end)

    def asciicast(self, title: str) -> str:
        """Returns the recording in asciicast v2."""
        header = {
            "version": 2,
            "width": self.width,
            "height": HEIGHT,
            "title": title,
            "env": {"TERM": VARIABLES["TERM"], "SHELL": "/bin/sh"},
        }
        lines = [json.dumps(header)]
        lines += [
            json.dumps([round(at, 3), "o", text], ensure_ascii=False) for at, text in self.events
        ]
        return "\n".join(lines) + "\n"


def prompt(command: str) -> str:
    """Returns a command behind a prompt, as a terminal gets it."""
    return "\x1b[1;32m$\x1b[0m " + command.replace("\n", "\r\n") + "\r\n"


def record(subject: Subject, width: int, folder: Path) -> Recording:
    """Runs what is typed in a terminal of this width."""
    recording = Recording(width)
    # A line that ends with a backslash goes on.
    first, *others = re.split(r"(?<!\\)\n", subject.typed)
    recording.events.append((0.0, prompt(first)))
    script = [first]
    for command in others:
        script += [f"printf %s {shlex.quote(prompt(command))}", command]
    child, terminal = pty.fork()
    if child == 0:
        os.chdir(folder)
        path = f"{ROOT / 'target/release'}:{os.environ['PATH']}"
        environment = VARIABLES | {"PATH": path, "HOME": str(folder)}
        sys.stdin.readline()
        os.execvpe("sh", ["sh", "-ec", "\n".join(script)], environment)  # noqa: S606, S607
    # The child waits until the terminal has its size, and nothing is echoed.
    ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", HEIGHT, width, 0, 0))
    mode = termios.tcgetattr(terminal)
    mode[3] &= ~termios.ECHO
    termios.tcsetattr(terminal, termios.TCSANOW, mode)
    os.write(terminal, b"\n")
    begun = time.monotonic()
    pending = b""
    while True:
        select.select([terminal], [], [], 600)
        try:
            pending += os.read(terminal, 65536)
        except OSError:
            break
        # A character may be cut.
        text = pending.decode(errors="ignore")
        pending = pending[len(text.encode()) :]
        if text:
            recording.events.append((0.5 + time.monotonic() - begun, text))
    _, status = os.waitpid(child, 0)
    code = os.waitstatus_to_exitcode(status)
    if code != subject.code:
        raise SystemExit(f"error: {subject.typed}: exit code {code}\n{recording.text()}")
    return recording


def screen_of(text: str, width: int) -> pyte.Screen:
    """Returns the screen of this width after a text; nothing scrolls away."""
    screen = pyte.Screen(width, TALL)
    pyte.Stream(screen).feed(text)
    return screen


def lines(text: str, width: int) -> list[str]:
    """Returns the lines of the screen without blanks at their ends."""
    return "\n".join(line.rstrip() for line in screen_of(text, width).display).rstrip().split("\n")


def draw(text: str, width: int, title: str) -> str:
    """Returns a picture (SVG) of the screen after a text."""
    screen = screen_of(text, width)
    console = Console(
        record=True, width=width, file=io.StringIO(), force_terminal=True, color_system="truecolor"
    )
    for row in range(len(lines(text, width))):
        line = Text(no_wrap=True, end="\n")
        for column in range(width):
            of = screen.buffer[row][column]
            colour = None if of.fg == "default" else NAMES.get(of.fg, f"#{of.fg}")
            line.append(of.data, Style(color=colour, bold=of.bold or None))
        line.rstrip()
        console.print(line, crop=False, overflow="ignore")
    # What goes below the last line, such as underscores, would be cut.
    console.print()
    # Without fonts from the network: those of the reader do.
    template = re.sub(r"@font-face \{\{.*?\}\}\s*", "", CONSOLE_SVG_FORMAT, flags=re.DOTALL)
    svg = console.export_svg(
        title=title, theme=SVG_EXPORT_THEME, code_format=template, unique_id="terminal"
    )
    # Letters of one size, however many columns.
    return re.sub(
        r'viewBox="0 0 ([0-9.]+)',
        lambda box: f'width="{SCALE * float(box[1]):.0f}" {box[0]}',
        svg,
        count=1,
    )


def main() -> None:
    """Records everything at every width."""
    for width in WIDTHS:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            default = ROOT / "configs/plane-shear-2d.toml"
            (folder / "my.toml").write_text(SCENE.format(default=default))
            for subject in SUBJECTS:
                recording = record(subject, width, folder)
                screen, wide = (lines(recording.text(), w) for w in (width, 10 * width))
                if screen != wide:
                    longest = max(wide, key=len)
                    raise SystemExit(f"error: {subject.name} at {width} columns: {longest!r}")
                target = FIGURES / f"terminal-{subject.name}-{width}"
                cast = recording.asciicast(subject.title)
                svg = draw(recording.text(subject.still), width, subject.title)
                for ending, text in ((".cast", cast), (".svg", svg)):
                    if len(text.encode()) > MOST_BYTES:
                        raise SystemExit(f"error: {target}{ending}: {len(text)} bytes")
                    target.with_suffix(ending).write_text(text)
                print(target.relative_to(ROOT), len(cast), len(svg))


if __name__ == "__main__":
    main()
