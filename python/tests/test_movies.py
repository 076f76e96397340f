"""Movies of runs, read by Pillow."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image

import gshear
from gshear import ProgramFailedError, Run


@pytest.mark.parametrize("name", ["disks", "spheres", "disks in a box", "disks without walls"])
def test_a_movie_shows_the_frames(name: str, copy: Callable[[str], Path], tmp_path: Path) -> None:
    """As many pictures as frames, of the size asked for, each different from the one before."""
    with Run(copy(name), quiet=True) as run:
        numbers = range(1, min(6, len(run.frames)), 2)
        out = gshear.movie(
            run,
            tmp_path / "a.png",
            frames=numbers,
            fields=["velocity", "force", "dmin"],
            rate=4,
            width=640,
            quiet=True,
        )
    assert out == tmp_path / "a.png"
    with Image.open(out) as movie:
        assert movie.n_frames == len(numbers)  # type: ignore[attr-defined]
        assert movie.width == 640
        pictures = []
        for k in range(len(numbers)):
            movie.seek(k)
            assert movie.info["duration"] == 250
            pictures.append(movie.convert("RGB").tobytes())
    assert len(set(pictures)) == len(numbers)
    assert len(list((tmp_path / "a").glob("*.png"))) == len(numbers)


def test_what_makes_no_movie_is_refused(copy: Callable[[str], Path]) -> None:
    """Frames that do not go forwards, fields that there are not."""
    run = copy("disks")
    with pytest.raises(ValueError, match="has no frames in their order"):
        gshear.movie(run, frames=range(5, 0, -1))
    with pytest.raises(ValueError, match="has no frames in their order"):
        gshear.movie(run, frames=range(-2, 2))
    with pytest.raises(ProgramFailedError, match="write force, dmin or velocity"):
        gshear.movie(run, fields=["colour"], quiet=True)
    assert not list(run.glob("movie*"))
