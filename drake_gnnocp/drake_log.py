"""Drake's log lines: it warns of every solve that hits a limit and announces its servers, which results say better."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager

DRAKE = logging.getLogger("drake")
logger = logging.getLogger(__name__)


@contextmanager
def drake_lines() -> Iterator[None]:
    """What Drake says meanwhile goes to this module's logger, as details."""

    def redirect(record: logging.LogRecord) -> bool:
        logger.debug("%s", record.getMessage())
        return False

    DRAKE.addFilter(redirect)
    try:
        yield
    finally:
        DRAKE.removeFilter(redirect)


def log_to_stderr(level: int = logging.WARNING, form: str = "%(message)s") -> None:
    """Set up the logging of a command, in which Drake's own lines are left out."""
    logging.basicConfig(level=level, format=form)
    DRAKE.setLevel(logging.ERROR)
