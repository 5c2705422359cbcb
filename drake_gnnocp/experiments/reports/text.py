"""What the reports of measurements share: Markdown tables, spreads, and the machine they were made on."""

from __future__ import annotations

import csv
import io
import os
import platform
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

import numpy as np

CPU_INFO = Path("/proc/cpuinfo")  # Linux: elsewhere the machine's own word for its processor has to do


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def csv_text(header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A CSV table; None is an empty cell."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([header, *rows])
    return text.getvalue()


def spread(values: Sequence[float], digits: int) -> str:
    """Median / 95th percentile; a dash where there is no value."""
    if not len(values):
        return "-"
    median, tail = np.percentile(values, [50, 95])
    return f"{median:.{digits}f} / {tail:.{digits}f}"


def machine(*packages: str) -> str:
    """One line on the processor, its cores, Python and the versions of those packages that are installed."""
    versions = []
    for package in packages:
        try:
            versions.append(f"{package} {metadata.version(package)}")
        except metadata.PackageNotFoundError:
            continue
    python = f"Python {platform.python_version()}"
    return f"{', '.join([python, *versions])}; {_processor()}, {os.cpu_count()} cores.\n"


def _processor() -> str:
    """Model and architecture of the processor."""
    model = platform.processor()
    if CPU_INFO.exists():
        named = [line.partition(":")[2].strip() for line in CPU_INFO.read_text().splitlines() if "model name" in line]
        model = named[0] if named else model
    return " ".join(dict.fromkeys(filter(None, [model, platform.machine()])))
