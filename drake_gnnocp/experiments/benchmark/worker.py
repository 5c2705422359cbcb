"""One process for all runs, with one thread."""

from __future__ import annotations

import gc
import multiprocessing
import signal
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

from drake_gnnocp.workers import single_threaded_children

START_SECONDS = 60.0  # s, allowed on top of a first call for starting the process


class WorkerDied(RuntimeError):
    """The process crashed, or did not answer in time and was ended."""


class WorkerNotStarted(ValueError):
    """The process ended, or was not ready in time, before its first call: nothing is known of any function."""


class Worker:
    """Calls functions in a process of its own, which is started again after a crash.

    Args:
        first: called once in every new process.
    """

    def __init__(self, first: Callable[[], object]) -> None:
        self._first = first
        self._process: Any = None
        self._pipe: Connection | None = None

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *_: object) -> None:
        self._stop()

    def call(self, function: Callable[..., Any], *arguments: Any, timeout: float) -> Any:
        """function(*arguments), what it raises included.

        Raises:
            WorkerDied: there was no answer in `timeout` [s], or the process ended.
            WorkerNotStarted: there was no process, and none could be made ready.
        """
        return self._answer(self._pipe or self._start(), function, arguments, timeout)

    def _answer(
        self, pipe: Connection, function: Callable[..., Any], arguments: tuple[Any, ...], timeout: float
    ) -> Any:
        try:
            pipe.send((function, arguments))
            if not pipe.poll(timeout):
                raise WorkerDied(f"no answer in {timeout:.0f} s")
            succeeded, value = pipe.recv()
        except (EOFError, OSError):
            self._stop()
            raise WorkerDied("the process ended") from None
        except WorkerDied:
            self._stop()
            raise
        if not succeeded:
            raise value
        return value

    def _start(self) -> Connection:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs,), daemon=True)
        with single_threaded_children():
            self._process.start()
        theirs.close()
        try:
            self._answer(self._pipe, self._first, (), START_SECONDS)
        except Exception as error:
            self._stop()
            raise WorkerNotStarted(f"a process for the runs could not be made ready: {error}") from error
        return self._pipe

    def _stop(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.join()
        if self._pipe is not None:
            self._pipe.close()
        self._process = self._pipe = None


def _serve(pipe: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interrupted benchmark finishes the runs under way
    with suppress(EOFError):
        while True:
            function, arguments = pipe.recv()
            gc.collect()  # what an earlier run left is not collected at this one's expense
            try:
                answer = (True, function(*arguments))
            except Exception as error:
                answer = (False, error)
            pipe.send(answer)
