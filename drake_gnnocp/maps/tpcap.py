"""The CSV format of the TPCAP competition.

A file is one row of numbers without names,

    x0,y0,th0, xf,yf,thf, n, count_1..count_n, x,y of every vertex

in m and rad. The vehicle is that of the competition.
"""

from __future__ import annotations

import math
from itertools import islice
from reprlib import repr as shown  # short, and shallow where the value is nested
from typing import Any

from drake_gnnocp.vehicle import Vehicle

TPCAP_VEHICLE = Vehicle(width=1.942, v_max=2.5, a_max=1.0, phi_max=0.75, w_max=0.5)
N_FIRST = 7  # numbers of a row before the vertex counts: start, goal, number of obstacles


def parse_tpcap(text: str, name: str) -> dict[str, Any]:
    """Turn a TPCAP row into the keys of the JSON format.

    Args:
        text: the row; it may be broken into lines.
        name: of the scenario, which the format does not hold.

    Raises:
        ValueError: something is not a finite number, or the counts do not fit.
    """
    lines = [line.strip().strip(",") for line in text.splitlines()]
    cells = ",".join(line for line in lines if line).split(",")
    values = [_cell(i, cell.strip()) for i, cell in enumerate(cells, start=1)]
    if len(values) < N_FIRST:
        raise ValueError(f"start, goal, number of obstacles: needs {N_FIRST} numbers, has {len(values)}")
    n = _count("number of obstacles", values[N_FIRST - 1], least=0)
    if len(values) < N_FIRST + n:
        raise ValueError(f"vertex counts: there must be {n:g}, there are {len(values) - N_FIRST}")
    counts = [_count(f"vertex count of obstacles[{j}]", values[N_FIRST + j], least=3) for j in range(n)]
    flat = values[N_FIRST + n :]
    if len(flat) != 2 * sum(counts):
        asked = 2.0 * sum(map(float, counts))
        raise ValueError(f"vertices: the counts ask for {asked:g} numbers, there are {len(flat)}")
    vertices = zip(flat[::2], flat[1::2], strict=True)
    rings = [list(islice(vertices, count)) for count in counts]
    vehicle = TPCAP_VEHICLE.to_dict()
    return {"name": name, "start": values[:3], "goal": values[3:6], "obstacles": rings, "vehicle": vehicle}


def _cell(i: int, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        raise ValueError(f"number {i} of the row: must be a number, not {shown(cell)}") from None
    if not math.isfinite(value):
        raise ValueError(f"number {i} of the row: must be finite, not {cell}")
    return value


def _count(what: str, value: float, least: int) -> int:
    if value != int(value) or value < least:
        raise ValueError(f"{what}: must be a whole number of at least {least}, not {value:g}")
    return int(value)
