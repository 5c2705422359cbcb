"""Processes with one thread each: the libraries read how many threads they may use when they are loaded."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager

SINGLE_THREAD = {
    name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
}


_lock = threading.Lock()  # the environment is the whole process's


@contextmanager
def single_threaded_children() -> Iterator[None]:
    """Processes spawned meanwhile use one thread each."""
    with _lock:
        before = {name: os.environ.get(name) for name in SINGLE_THREAD}
        os.environ.update(SINGLE_THREAD)
        try:
            yield
        finally:
            for name, value in before.items():
                os.environ.pop(name) if value is None else os.environ.update({name: value})
