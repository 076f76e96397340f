"""Scenes: configurations of runs, every default filled in."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from typing import Any

from .errors import no_such

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


class Scene(Mapping[str, Any]):
    """The checked scene of a run, as a mapping.

    `scene["contact"]["friction"]` and `scene["contact.friction"]` are the same.
    `docs/reference/config.md` describes every key, with its unit.

    Attributes:
        text: The scene as TOML, with what follows from it as comments.
    """

    def __init__(self, text: str) -> None:
        self.text = text
        self._values: dict[str, Any] = tomllib.loads(text)

    def __getitem__(self, path: str) -> Any:  # noqa: ANN401 - values of TOML
        value: Any = self._values
        for key in path.split("."):
            if not isinstance(value, dict) or key not in value:
                known = value if isinstance(value, dict) else ()
                raise no_such("the scene", "key", path, known)
            value = value[key]
        return value

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __repr__(self) -> str:
        return f"<Scene {self.get('title', '')!r}: {', '.join(self)}>"
