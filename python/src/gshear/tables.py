"""Tables of columns with names, and the CSV files that hold them."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import pandas as pd

from .errors import RunError, no_such

# Since 3.1 pandas reads numbers to their last bit without being told.
EXACT: dict[str, Any] = (
    {"float_precision": "round_trip"}
    if tuple(map(int, pd.__version__.split(".")[:2])) < (3, 1)
    else {}
)


class Table(pd.DataFrame):
    """A table that names its columns if it is asked for another one.

    What pandas makes of it, such as a selection of rows, is a plain `DataFrame`.
    """

    def __getitem__(self, key: Any) -> Any:  # noqa: ANN401 - names, masks and slices, as of pandas
        """Returns columns or rows, as a `DataFrame` does.

        Raises:
            NoSuchNameError: There is no such column.
        """
        try:
            return super().__getitem__(key)
        except KeyError as error:
            if not isinstance(key, str):
                raise
            raise no_such("the table", "column", key, self.columns) from error


def with_units(table: pd.DataFrame, units: dict[str, str]) -> pd.DataFrame:
    """Returns a table with the units of its columns as `table.attrs["units"]`."""
    named = Table(table)
    named.attrs["units"] = {name: unit for name, unit in units.items() if name in table}
    return named


def read_csv(path: Path) -> pd.DataFrame:
    """Returns a table; its numbers have the same bits as those of the program that wrote it.

    Raises:
        RunError: There is no such file, or it is no table.
    """
    if not path.is_file():
        # A pipe would be waited for.
        raise RunError(f"{path}: no such file")
    return _parsed(path, path.read_bytes())


def column_units(path: Path) -> dict[str, str]:
    """Returns the units of the columns of a table, by the file beside it; empty without that file.

    Numbers without a unit have 1.
    """
    described = path.with_name(f"{path.name}-metadata.json")
    try:
        columns = json.loads(described.read_text())["tableSchema"]["columns"]
        return {column["name"]: column.get("schema:unitText", "") for column in columns}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def complete_lines(path: Path) -> pd.DataFrame:
    """Returns a table of numbers that is being written, without a last line that has no end.

    Raises:
        RunError: It is no table of numbers.
    """
    text = path.read_bytes()
    complete = text[: text.rfind(b"\n") + 1]
    if not complete:
        return Table()
    table = _parsed(path, complete)
    words = [name for name, kind in table.dtypes.items() if len(table) and kind.kind not in "iuf"]
    if words:
        raise RunError(f"{path}: is damaged: {words[0]} has other values than numbers")
    return table


def _parsed(path: Path, text: bytes) -> pd.DataFrame:
    try:
        return Table(pd.read_csv(io.BytesIO(text), **EXACT))
    except ValueError as error:
        raise RunError(f"{path}: is damaged, or no table: {error}") from error
