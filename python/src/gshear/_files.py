"""Writes files of results: beside their names, to disk, then renamed, so that none is half."""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO


def write(path: Path, content: str | Callable[[BinaryIO], object]) -> None:
    """Writes a file: a text, or what a function writes. On failure what was there stays.

    Raises:
        OSError: The file cannot be written, as on a full disk.
    """
    part = path.with_name(f"{path.name}.{secrets.token_hex(3)}.part")
    # A name that exists is never written through, such as somebody's link.
    descriptor = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
    try:
        with os.fdopen(descriptor, "wb") as file:
            if isinstance(content, str):
                file.write(content.encode())
            else:
                content(file)
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
    except BaseException as error:
        with contextlib.suppress(OSError):
            part.unlink()
        if isinstance(error, OSError) and error.filename is None:
            error.filename = os.fspath(path)
        raise
    # Not every file system brings the names of a folder to disk.
    with contextlib.suppress(OSError):
        _sync_folder(path.parent)


def _sync_folder(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
