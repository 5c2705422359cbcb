"""CSV files of measurements: one row a run, appended as it ends, so that a run that was killed goes on later.

A row is a frozen dataclass of texts, numbers and booleans; its fields are the columns.
"""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Callable
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, TypeVar

Row = TypeVar("Row")
PARSERS: dict[str, Callable[[str], object]] = {"str": str, "int": int, "float": float, "bool": "True".__eq__}
HEADER_MISMATCH = "is not a file of runs of this version; choose another --out or remove it"


class RunsError(ValueError):
    """A file that does not hold runs; the message is one line."""


def read_rows(path: Path, row: type[Row]) -> list[Row]:
    """All complete rows; none where there is no file. A last line that a kill cut off is dropped from the file.

    Raises:
        RunsError: the header is another one, or a row is not that of a run.
        OSError: the file cannot be read.
    """
    if not path.exists():
        return []
    text = path.read_bytes().decode("utf-8", errors="replace")
    complete = text[: text.rfind("\n") + 1]
    header = ",".join(_names(row)) + "\n"
    if not complete.startswith(header) and not header.startswith(text):  # the latter is a header that was cut off
        raise RunsError(f"{path}: {HEADER_MISMATCH}")
    if complete != text:
        os.truncate(path, len(complete.encode()))
    lines = list(csv.reader(io.StringIO(complete)))
    return [_row(path, row, number, cells) for number, cells in enumerate(lines[1:], start=2)]


def append_row(path: Path, row: Any) -> None:
    """Append a row, after the header where the file is new, in one write."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    if not path.exists() or path.stat().st_size == 0:
        writer.writerow(_names(type(row)))
    writer.writerow(asdict(row).values())
    with path.open("ab", buffering=0) as file:
        file.write(text.getvalue().encode())
        os.fsync(file.fileno())


def _names(row: Any) -> list[str]:
    return [field.name for field in fields(row)]


def _row(path: Path, row: Any, number: int, cells: list[str]) -> Any:
    columns = fields(row)
    if len(cells) != len(columns):
        raise RunsError(f"{path}: line {number}: has {len(cells)} cells, not {len(columns)}")
    values: dict[str, Any] = {}
    for field, cell in zip(columns, cells, strict=True):
        try:
            values[field.name] = PARSERS[str(field.type)](cell)
        except ValueError:
            raise RunsError(f"{path}: line {number}: {field.name}: {cell!r} is not a number") from None
    return row(**values)
