"""Long ways in relation to the car: knots as near as turns need them, and plans that settle near the searched path."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from map_tasks import VEHICLES, draw_map

from drake_gnnocp import PlanOptions, Scenario, Vehicle, plan
from drake_gnnocp.budget import Budget
from drake_gnnocp.search.hybrid_astar import search

ROBOT = Vehicle(wheelbase=0.5, front_hang=0.2, rear_hang=0.2, width=0.6, v_max=1.0, a_max=0.6)


def hall(walls: int) -> Scenario:
    """A hall of 12 m by 36 m with walls across, whose gaps are left and right in turns."""
    y = np.linspace(0.0, 36.0, walls + 2)[1:-1]
    left = [np.array([[0.0, at], [10.5, at], [10.5, at + 0.3], [0.0, at + 0.3]]) for at in y]
    obstacles = tuple(ring if k % 2 else ring * (-1, 1) + (12.0, 0.0) for k, ring in enumerate(left))
    ends = np.array([6.0, 1.5, 0.0]), np.array([6.0, 34.5, 0.0])
    return Scenario("hall", *ends, obstacles, (0.0, 12.0, 0.0, 36.0), ROBOT)


def strip(length: float, posts: int, seed: int) -> Scenario:
    """A strip 60 m wide with squares on it at random angles, to be crossed lengthwise by a car."""
    rng = np.random.default_rng(seed)
    middle = rng.uniform((15.0, 0.0), (length - 15.0, 60.0), (posts, 2))
    half_diagonal, angle = rng.uniform(0.6, 3.5, posts), rng.uniform(0.0, np.pi / 2, posts)
    corners = angle[:, None] + np.arange(4) * np.pi / 2
    squares = middle[:, None] + half_diagonal[:, None, None] * np.stack([np.cos(corners), np.sin(corners)], axis=-1)
    ends = np.array([3.0, 30.0, 0.0]), np.array([length - 8.0, 30.0, 0.0])
    return Scenario("strip", *ends, tuple(squares), (0.0, length, 0.0, 60.0))


def test_a_search_may_take_more_for_a_longer_way() -> None:
    """Farther than the nodes that are enough for short ways reach."""
    way = strip(length=500.0, posts=300, seed=2)
    assert search(way, Budget.unlimited(), last_stage=2).status == "found"


def test_a_long_way_gets_knots_by_its_length_and_a_plan_at_the_first_attempt() -> None:
    scenario = hall(walls=3)
    made = plan(scenario, guess="hybrid_astar")
    assert made.verified and len(made.attempts) == 1 and made.trajectory is not None
    apart = np.linalg.norm(np.diff(made.trajectory.poses[:, :2], axis=0), axis=1)
    assert apart.max() < ROBOT.turning_radius / 2
    assert len(made.trajectory) > PlanOptions().knots


@pytest.mark.slow
def test_ipopt_stays_where_the_steps_converged() -> None:
    """On a large map, where it went astray for hundreds of iterations."""
    task_map, pair = draw_map(5), 6
    start, goal = task_map.pairs(VEHICLES["robot"], pair + 1)[pair]
    with TemporaryDirectory() as folder:
        scenario = Scenario.load(task_map.write(Path(folder)), start=start, goal=goal, vehicle=VEHICLES["robot"])
    made = plan(scenario, guess="hybrid_astar")
    assert made.verified and len(made.attempts) == 1 and made.attempt.iterations < 50
