"""Movies of runs, which gshear-reduce draws."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from . import programs
from .run import Run


def movie(
    run: Run | str | os.PathLike[str],
    out: str | os.PathLike[str] | None = None,
    *,
    frames: range | None = None,
    fields: Sequence[str] = ("force",),
    rate: int = 12,
    width: int | None = None,
    quiet: bool = False,
) -> Path:
    """Draws a movie of frames with gshear-reduce, on the same scale throughout; returns its path.

        gshear.movie("out/my", "my.png", frames=range(0, 100, 2), fields=["force", "dmin"])

    The pictures are those of `gshear-reduce report`: maps of disks between walls, else the packing
    seen from outside.

    Args:
        run: The run, or the path of its folder or file.
        out: The file: `.mp4`, which needs ffmpeg in PATH, or `.png`, an animated PNG, with a folder
            of its frames beside it. By default `movie.mp4` if ffmpeg is there, else `movie.png`, in
            the folder of the run.
        frames: Numbers of the frames, from 0 on; all by default.
        fields: Of `force`, `dmin` (D²min since the frame before in the movie) and `velocity` (along
            x); several share a picture.
        rate: Frames per second.
        width: Width in pixels; by default that of the pictures, at most 1280.
        quiet: Do not print the command.

    Raises:
        ValueError: `frames` are none, go backwards, or begin below 0.
        ProgramFailedError: gshear-reduce refused what is asked for.
    """
    path = run.path if isinstance(run, Run) else Path(run)
    words = [str(programs.find("gshear-reduce")), "movie", str(path)]
    words += ["--fields", ",".join(fields), "--rate", str(rate)]
    if frames is not None:
        if len(frames) == 0 or frames.step < 1 or frames[0] < 0:
            raise ValueError(f"{frames} has no frames in their order; give range(first, end, step)")
        words += ["--frames", f"{frames[0]}..{frames[-1]}:{frames.step}"]
    words += [] if out is None else ["--out", os.fspath(out)]
    words += [] if width is None else ["--width", str(width)]
    said = programs.run(words, quiet=quiet)
    return Path(said.splitlines()[0].removeprefix("wrote "))
