"""Files: text and JSON read with errors of one line, and written whole or not at all."""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from errno import EISDIR
from pathlib import Path
from typing import Any

# not importlib.resources: it would look into a folder of the package's name where python is started above a clone
PACKAGE = Path(__file__).resolve().parent
LARGEST_FILE = 1e8  # bytes, of text: what it says takes several times as much memory


def read_text(path: Path) -> str:
    """The text of a file.

    Raises:
        ValueError: it is missing, unreadable, empty or not UTF-8; the message is one line.
    """
    check_readable(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise ValueError(f"file: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ValueError("file: is not UTF-8 text") from None
    if not text.strip():
        raise ValueError("file: is empty")
    return text


def check_readable(path: Path) -> None:
    """See that a file is there, is one that ends, and is not huge.

    Raises:
        ValueError: it is not; the message is one line.
    """
    try:
        if path.is_dir():
            raise ValueError("file: is a folder")
        if path.exists() and not path.is_file():  # reading a pipe or a device may never end
            raise ValueError("file: is no regular file")
        if path.stat().st_size > LARGEST_FILE:
            raise ValueError(f"file: is larger than {LARGEST_FILE / 1e6:g} MB")
    except OSError as error:
        raise ValueError(f"file: cannot be read: {error.strerror}") from None


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


def check_writable(folder: Path, names: Sequence[str]) -> None:
    """Make a folder where it is missing, and see that files of some names can be written there.

    Raises:
        OSError: they cannot.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        if (folder / name).is_dir():
            raise IsADirectoryError(EISDIR, os.strerror(EISDIR), str(folder / name))
    with tempfile.TemporaryFile(dir=folder):
        pass


@contextmanager
def replaced_together(folder: Path, names: Sequence[str]) -> Iterator[Path]:
    """A temporary folder whose files take the places of those in a folder once all are written.

    Where writing fails, or is interrupted, the folder is left as it was.

    Args:
        folder: made where it is missing.
        names: of the files that belong together; those that are not written are removed from the folder.

    Raises:
        OSError: the folder cannot be written, or one of the names is a folder in it.
    """
    check_writable(folder, names)
    stage = Path(tempfile.mkdtemp(prefix=".tmp", dir=folder))
    try:
        yield stage
        for name in names:
            if (stage / name).exists():
                (stage / name).replace(folder / name)
            else:
                (folder / name).unlink(missing_ok=True)
    finally:
        shutil.rmtree(stage, ignore_errors=True)


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Work in a folder alone. The system takes the lock of a process that has died.

    Raises:
        ValueError: another process works there.
        OSError: the folder cannot be made or written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / ".lock").open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ValueError(f"{folder}: another run is at work here; wait for it, or choose another --out") from None
        yield


def first_line(error: Exception) -> str:
    """What an error says, in one short line."""
    return (str(error).strip() or type(error).__name__).splitlines()[0][:200]
