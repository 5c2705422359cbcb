"""What a drawing shows, collected in the keys of the scenario's JSON format; coordinates in m, headings in rad."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from drake_gnnocp.polygons import NO_AREA, SMALLEST_AREA, TOO_FEW, polygons_of, signed_area

Points = list[list[float]]  # [x, y] each


@dataclass
class Drawing:
    """A drawing that is being read.

    Whatever is drawn is an obstacle, but for the special things below. The reader of the format checks that numbers are
    finite, and names what is wrong with a ring by its place in the file.
    """

    obstacles: list[Any] = field(default_factory=list)  # rings, or {"ring", "holes"}
    lines: list[Points] = field(default_factory=list)
    points: list[list[float]] = field(default_factory=list)  # [x, y], or [x, y, r] for a disc
    bounds: Points | None = None  # a ring
    start: list[Any] | None = None  # x, y, theta
    goals: list[list[Any]] = field(default_factory=list)  # x, y, theta; None for a free heading

    def add_area(self, ring: Points, holes: list[Points], where: str) -> None:
        """Add an obstacle; one without area is a line. `where` names it in an error."""
        try:
            polygons_of(np.array(ring))
        except ValueError as error:
            if not holes and str(error) in (NO_AREA, TOO_FEW) and abs(signed_area(np.array(ring))) < SMALLEST_AREA:
                self.lines.append([*ring, ring[0]])
                return
            raise ValueError(f"{where}: {error}") from None
        for i, hole in enumerate(holes):
            try:
                polygons_of(np.array(hole))
            except ValueError as error:
                raise ValueError(f"{where}: hole {i + 1}: {error}") from None
        self.obstacles.append({"ring": ring, "holes": holes} if holes else ring)

    def vertices(self) -> list[list[float]]:
        """All [x, y] there are."""
        found = [point for line in self.lines for point in line] + [point[:2] for point in self.points]
        for obstacle in self.obstacles:
            found += obstacle["ring"] if isinstance(obstacle, dict) else obstacle
        poses = self.goals if self.start is None else [*self.goals, self.start]
        return found + [pose[:2] for pose in poses] + (self.bounds or [])

    def set_bounds(self, ring: Points, where: str) -> None:
        """Say what the whole footprint stays inside of; `where` names it in an error."""
        if self.bounds is not None:
            raise ValueError(f"{where}: is a second one; there can be one polygon as bounds")
        self.bounds = ring

    def set_start(self, pose: list[Any], where: str) -> None:
        """Say where the motion starts; `where` names it in an error."""
        if self.start is not None:
            raise ValueError(f"{where}: is a second one; there can be one start")
        self.start = pose

    def keys(self) -> dict[str, Any]:
        """The drawing in the keys of the JSON format, those left out that it does not show."""
        several = len(self.goals) > 1
        found: dict[str, Any] = {
            "start": self.start,
            "goal": self.goals[0] if self.goals and not several else None,
            "goals": self.goals if several else None,
            "lines": self.lines or None,
            "points": self.points or None,
            "bounds": self.bounds,
        }
        return {"obstacles": self.obstacles, **{key: value for key, value in found.items() if value is not None}}


def without_closing(ring: Points) -> Points:
    """A ring without its last vertex, where that repeats the first."""
    return ring[:-1] if len(ring) > 1 and ring[0] == ring[-1] else ring
