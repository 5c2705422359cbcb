"""A trajectory: states and inputs at knots in time, between which the inputs are linear."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drake_gnnocp.files import read_text, write_atomically
from drake_gnnocp.scenario_files import LARGEST
from drake_gnnocp.vehicle import Input, State

LEAST_MOVE = 1e-3  # of the path's length: a shorter way between two changes of gear is the solver's trembling at a stop
COLUMNS = ("t", "x", "y", "theta", "v", "phi", "a", "w")


@dataclass(frozen=True)
class Trajectory:
    """States and inputs at N knots, kept as arrays of doubles.

    Raises:
        ValueError: the arrays do not belong together.
    """

    t: np.ndarray  # (N,) s, increasing
    states: np.ndarray  # (N, 5) x, y, theta, v, phi [m, m, rad, m/s, rad]
    inputs: np.ndarray  # (N, 2) a, w [m/s^2, rad/s]

    def __post_init__(self) -> None:
        for name in ("t", "states", "inputs"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), dtype=float))
        n = self.t.size
        if n < 2 or self.t.shape != (n,) or self.states.shape != (n, 5) or self.inputs.shape != (n, 2):
            raise ValueError(
                f"trajectory: t, states, inputs must be (N,), (N, 5), (N, 2) with N >= 2, not "
                f"{self.t.shape}, {self.states.shape}, {self.inputs.shape}"
            )

    def __len__(self) -> int:
        return len(self.t)

    @property
    def duration(self) -> float:
        """From the first knot to the last [s]."""
        return float(self.t[-1] - self.t[0])

    @property
    def path_length(self) -> float:
        """Length of the straight lines from knot to knot [m]."""
        return float(np.linalg.norm(np.diff(self.poses[:, :2], axis=0), axis=1).sum())

    @property
    def gear_changes(self) -> int:
        """How often it changes between forward and reverse."""
        v = self.states[:, State.V]
        steps = np.diff(self.t) * (v[1:] + v[:-1]) / 2
        least, gear, turn, changes = LEAST_MOVE * np.abs(steps).sum(), 0.0, 0.0, 0
        for at in np.cumsum(steps).tolist():  # m, forward less backward
            if gear * (at - turn) > 0:
                turn = at
            elif abs(at - turn) > least:
                changes += gear != 0
                gear, turn = math.copysign(1.0, at - turn), at
        return changes

    @property
    def poses(self) -> np.ndarray:
        """(N, 3) x, y, theta [m, m, rad]."""
        return self.states[:, : State.V]

    @property
    def flaw(self) -> str:
        """What keeps it from being driven first: a number that is not finite or too large, or time that runs back.

        Returns:
            One line that names the knot, empty where there is nothing.
        """
        if not all((np.abs(values) <= LARGEST).all() for values in (self.t, self.states, self.inputs)):  # NaN as well
            numbers = np.column_stack([self.t, self.states, self.inputs])
            knot, column = np.argwhere(~(np.abs(numbers) <= LARGEST))[0]
            value = numbers[knot, column]
            return f"{COLUMNS[column]} of knot {knot}: must be finite and at most {LARGEST:g}, not {value:g}"
        is_later = self.t[1:] > self.t[:-1]
        if not is_later.all():
            return f"t of knot {is_later.argmin() + 1}: must be larger than that of the knot before"
        return ""

    def column(self, which: State | Input) -> np.ndarray:
        """One state or input over the knots: (N,)."""
        return (self.states if isinstance(which, State) else self.inputs)[:, which]

    def resampled(self, n: int) -> Trajectory:
        """The trajectory at n knots equally spaced in time, linearly interpolated (as the paper does)."""
        t = np.linspace(self.t[0], self.t[-1], n)
        values = np.hstack([self.states, self.inputs])
        columns = np.stack([np.interp(t, self.t, column) for column in values.T], axis=1)
        return Trajectory(t, columns[:, :5], columns[:, 5:])

    def translated(self, dx: float, dy: float) -> Trajectory:
        """The trajectory moved by (dx, dy) [m]."""
        states = self.states.copy()
        states[:, State.X] += dx
        states[:, State.Y] += dy
        return Trajectory(self.t, states, self.inputs)

    def scaled(self, factor: float) -> Trajectory:
        """The trajectory as many times as large: positions, speeds and accelerations; angles and times stay."""
        if factor == 1.0:
            return self
        return Trajectory(self.t, self.states * (factor, factor, 1.0, factor, 1.0), self.inputs * (factor, 1.0))

    def save_csv(self, path: Path | str) -> None:
        """Write one row a knot with the header t,x,y,theta,v,phi,a,w; every double keeps its exact value."""
        rows = np.column_stack([self.t, self.states, self.inputs])
        lines = [",".join(COLUMNS), *(",".join(repr(float(value)) for value in row) for row in rows)]
        write_atomically(Path(path), "\n".join(lines) + "\n")

    @classmethod
    def load_csv(cls, path: Path | str) -> Trajectory:
        """Read what `save_csv` wrote.

        Raises:
            ValueError: the file cannot be read, or its header or a row is not that of a trajectory; the message names
                the file and the line.
        """
        try:
            lines = read_text(Path(path)).splitlines()
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None
        if lines[0].strip() != ",".join(COLUMNS):
            raise ValueError(f"{path}: header: must be {','.join(COLUMNS)}, not {lines[0]:.80}")
        rows = np.array([_row(f"{path}: line {i}", line) for i, line in enumerate(lines[1:], start=2)])
        if len(rows) < 2:
            raise ValueError(f"{path}: needs at least 2 rows, has {len(rows)}")
        return cls(rows[:, 0], rows[:, 1:6], rows[:, 6:])


def _row(where: str, line: str) -> list[float]:
    try:
        values = [float(cell) for cell in line.split(",")]
    except ValueError:
        values = []
    if len(values) != len(COLUMNS):
        raise ValueError(f"{where}: must be {len(COLUMNS)} numbers, not {line:.80}")
    return values
