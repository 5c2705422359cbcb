"""How finely Hybrid A* looks: first coarsely, then ever more finely."""

from __future__ import annotations

from dataclasses import dataclass, field

from drake_gnnocp.search.graph_search import Resolution
from drake_gnnocp.search.moves import Costs

TIGHT_POSITION = 0.07  # m, side of a cell around an end where every motion primitive is blocked
TIGHT_HEADING = 0.066  # rad, heading cell there: a move of 0.2 m at full lock turns the car by one cell
ROOM = 0.4  # m, around the car on a way that is no squeeze


@dataclass(frozen=True)
class Stage:
    """One entry of the schedule; lengths and angles are factors of those in the options or above."""

    position: float  # factor of the position resolution
    heading: float  # factor of the heading resolution
    length: float  # factor of the length of the motion primitives
    margin: float  # factor of the safety margin
    tight: float  # factor of TIGHT_POSITION and TIGHT_HEADING
    room: float | None  # m, what the states of the better, slower heuristic have around the car; None without it
    expansions: int  # most expansions of each of the two searches


SCHEDULE = (
    Stage(position=1.0, heading=1.0, length=1.0, margin=1.0, tight=1.0, room=None, expansions=150),
    Stage(position=1.0, heading=1.0, length=1.0, margin=1.0, tight=0.6, room=0.0, expansions=500),
    Stage(position=1.0, heading=1.0, length=1.0, margin=1.0, tight=0.6, room=ROOM, expansions=500),
    Stage(position=1.0, heading=1 / 3, length=0.7, margin=0.6, tight=0.3, room=0.0, expansions=1500),
    Stage(position=1.0, heading=1 / 6, length=0.5, margin=0.25, tight=0.3, room=0.0, expansions=3000),
    Stage(position=0.7, heading=1 / 9, length=0.4, margin=0.08, tight=0.3, room=0.0, expansions=15000),
    Stage(position=0.5, heading=1 / 15, length=0.3, margin=0.04, tight=0.2, room=0.0, expansions=30000),
)
# after a stage that exhausted the states of an end, where they are not few: long moves are worth more than fine cells
CONFINED = Stage(position=1.0, heading=1 / 6, length=1.0, margin=0.04, tight=0.3, room=0.0, expansions=3000)


@dataclass(frozen=True)
class HybridAStarOptions:
    """What a user may set; the resolutions are the paper's."""

    position_resolution: float = 0.2  # m
    heading_resolution: float = 0.785  # rad
    primitive_length: float = 1.0  # m, of the motion primitives
    steering_levels: int = 5  # from full left to full right
    margin: float = 0.12  # m, the car is grown by this on all sides
    heuristic_weight: float = 3.0  # above 1: faster, less cheap paths
    costs: Costs = field(default_factory=Costs)


def resolution_of(options: HybridAStarOptions, stage: Stage) -> Resolution:
    """The grid and the motion primitives of a stage."""
    return Resolution(
        position=stage.position * options.position_resolution,
        heading=stage.heading * options.heading_resolution,
        primitive_length=stage.length * options.primitive_length,
        steering_levels=options.steering_levels,
        weight=options.heuristic_weight,
        tight_position=stage.tight * TIGHT_POSITION,
        tight_heading=stage.tight * TIGHT_HEADING,
    )
