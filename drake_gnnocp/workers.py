"""Processes that work side by side, one thread each: libraries read how many they may use when they are loaded."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager

from drake_gnnocp.files import first_line

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


@contextmanager
def workers(jobs: int, dask: str | None) -> Iterator[Executor]:
    """An executor of so many processes, or of a Dask cluster at an address; left by an error, it ends what is at work.

    Raises:
        ValueError: there is no cluster, or the extra `dask` is not installed.
    """
    if dask is None:
        with single_threaded_children(), _processes(jobs) as executor:
            yield executor
        return
    try:
        from distributed import Client  # an extra: most users need one machine

        client = Client(dask)
    except (ImportError, OSError, ValueError) as error:
        raise ValueError(f"--dask: {dask}: {first_line(error)}") from None
    with client:
        yield client.get_executor(pure=False)


@contextmanager
def _processes(jobs: int) -> Iterator[Executor]:
    context, others = multiprocessing.get_context("spawn"), set(multiprocessing.active_children())
    # Ctrl-C in a terminal reaches the workers as well, and ends them silently
    with ProcessPoolExecutor(jobs, context, signal.signal, (signal.SIGINT, signal.SIG_DFL)) as executor:
        try:
            yield executor
        except BaseException:
            executor.shutdown(wait=False, cancel_futures=True)
            for process in set(multiprocessing.active_children()) - others:
                process.terminate()
            raise
