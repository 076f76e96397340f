"""Values of Python as TOML."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping, Sequence
from numbers import Integral, Real

import numpy as np


def override(value: object) -> str:
    """Returns what follows the `=` of `--set KEY=`.

    A string is passed on as it is: it may be TOML itself, a number with a unit or a bare word.
    `None` takes the key away.

    Raises:
        TypeError: TOML, or a scene, has nothing of that type.
    """
    if value is None:
        return "none"
    return value if isinstance(value, str) else toml(value)


def toml(value: object) -> str:
    """Returns a number, a boolean, a text, a path, or an array or a table of them as TOML.

    Raises:
        TypeError: TOML, or a scene, has nothing of that type.
    """
    if isinstance(value, np.ndarray):
        return toml(value.tolist())
    if isinstance(value, np.generic):
        return toml(value.item())
    # Before the integers: True is one.
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Integral):
        return str(int(value))
    if isinstance(value, Real):
        return repr(float(value))
    if isinstance(value, str):
        return _quoted(value)
    if isinstance(value, os.PathLike):
        return _quoted(os.fsdecode(value))
    if isinstance(value, Mapping):
        entries = (f"{_key(name)} = {toml(entry)}" for name, entry in value.items())
        return f"{{ {', '.join(entries)} }}"
    if isinstance(value, Sequence) and not isinstance(value, bytes | bytearray | memoryview):
        return f"[{', '.join(toml(entry) for entry in value)}]"
    raise TypeError(
        f"a {type(value).__name__} ({value!r}) is no value of a scene: "
        "give a number, a boolean, a text, a path, or a list or a dict of them"
    )


def _quoted(text: str) -> str:
    # The strings of JSON are strings of TOML but for DEL, which TOML wants escaped.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _key(name: object) -> str:
    if not isinstance(name, str):
        raise TypeError(f"{name!r} is no name of a key: give a text")
    return name if re.fullmatch("[A-Za-z0-9_-]+", name) else _quoted(name)
