"""Files: text and JSON read with errors of one line, and written whole or not at all."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any


def read_text(path: Path) -> str:
    """The text of a file.

    Raises:
        ValueError: it is missing, unreadable, empty or not UTF-8; the message is one line.
    """
    try:
        if path.is_dir():
            raise ValueError("file: is a folder")
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise ValueError(f"file: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ValueError("file: is not UTF-8 text") from None
    if not text.strip():
        raise ValueError("file: is empty")
    return text


def parse_json(text: str) -> Any:
    """What a JSON text says, all numbers as floats.

    Raises:
        ValueError: it is not JSON, or a key appears twice; the message is one line.
    """
    try:
        return json.loads(text, object_pairs_hook=_unique_keys, parse_int=float)  # int() fails on 5,000 digits
    except json.JSONDecodeError as error:
        raise ValueError(f"line {error.lineno}, column {error.colno}: is not JSON: {error.msg}") from None
    except RecursionError:
        raise ValueError("file: is nested too deeply") from None


def _unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    data = dict(pairs)
    if len(data) < len(pairs):
        keys = [key for key, _ in pairs]
        raise ValueError(f"{next(key for key in keys if keys.count(key) > 1)}: appears twice")
    return data


def write_atomically(path: Path, content: str | bytes) -> None:
    """Write content to a temporary file beside path, then rename: a killed run leaves no half-written file."""
    temporary = path.with_name(f".{path.name}.tmp{os.getpid()}")
    try:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def first_line(error: Exception) -> str:
    """What an error says, in one short line."""
    return (str(error).strip() or type(error).__name__).splitlines()[0][:200]
