"""Minimum-effort timing of a path."""

import numpy as np
import pytest

from drake_gnnocp import Trajectory, Vehicle
from drake_gnnocp.search.path import GearedPath
from drake_gnnocp.timing.minimum_effort import with_duration, with_minimum_effort
from drake_gnnocp.timing.speed_planner import plan_speed

EXACT = 1e-9  # closed forms in double precision
ON_KNOTS = 0.03  # m, a gear change lies between two knots of the new timing


def driven(stretches: list[tuple[float, int]]) -> Trajectory:
    """A straight line driven to and fro: (length [m], gear) a stretch."""
    x, gears = [0.0], [stretches[0][1]]
    for length, gear in stretches:
        n = int(length / 0.1)
        x.extend(x[-1] + gear * length / n * (np.arange(n) + 1))
        gears.extend([gear] * n)
    poses = np.column_stack([x, np.zeros((len(x), 2))])
    return plan_speed(GearedPath(poses, np.array(gears), np.zeros(len(x))), Vehicle())


def test_one_section_gets_the_parabola_of_least_effort() -> None:
    timed = with_minimum_effort(driven([(10.0, 1)]), 20.0, Vehicle())
    t = timed.t
    np.testing.assert_allclose(timed.states[:, 3], 6 * 10.0 / 20.0**3 * t * (20.0 - t), atol=1e-3)
    effort = np.trapezoid(timed.inputs[1:-1, 0] ** 2, t[1:-1])
    assert effort == pytest.approx(12 * 10.0**2 / 20.0**3, rel=0.05)  # without the first and the last interval
    np.testing.assert_allclose(timed.poses[[0, -1]], [[0, 0, 0], [10, 0, 0]], atol=EXACT)


def test_a_long_way_is_driven_at_nearly_full_speed_and_never_above() -> None:
    timed = with_minimum_effort(driven([(50.0, 1)]), 24.0, Vehicle())
    assert timed.states[:, 3].max() == pytest.approx(0.98 * 2.5, rel=1e-6)
    assert np.abs(timed.inputs[:, 0]).max() <= Vehicle().a_max
    assert timed.poses[-1, 0] == pytest.approx(50.0, abs=EXACT)


def test_sections_share_the_time_by_the_root_of_their_lengths_and_keep_their_gears() -> None:
    timed = with_minimum_effort(driven([(8.0, 1), (2.0, -1)]), 21.0, Vehicle())
    x, v = timed.poses[:, 0], timed.states[:, 3]
    assert x.max() == pytest.approx(8.0, abs=ON_KNOTS)
    assert timed.t[np.argmax(x)] == pytest.approx(21.0 * np.sqrt(8) / (np.sqrt(8) + np.sqrt(2)), abs=21.0 / 119)
    assert v[: np.argmax(x)].min() >= 0 and v[np.argmax(x) + 1 :].max() <= 0
    assert x[-1] == pytest.approx(6.0, abs=EXACT)


def test_a_duration_too_short_for_least_effort_only_scales_the_motion() -> None:
    fast = driven([(10.0, 1)])
    timed = with_minimum_effort(fast, 3.0, Vehicle())
    np.testing.assert_array_equal(timed.states, with_duration(fast, 3.0).states)


def test_standing_still_stays_still() -> None:
    still = Trajectory(np.linspace(0, 1, 5), np.zeros((5, 5)), np.zeros((5, 2)))
    assert with_minimum_effort(still, 2.0, Vehicle()).duration == 2.0


def test_with_duration_scales_speeds_and_keeps_the_path() -> None:
    t = np.linspace(0, 4, 5)
    states = np.column_stack([t, t, t, np.ones(5), np.ones(5)])
    slower = with_duration(Trajectory(t, states, np.ones((5, 2))), 8.0)
    assert slower.duration == 8.0
    np.testing.assert_array_equal(slower.poses, states[:, :3])
    np.testing.assert_allclose(slower.states[:, 3:], [[0.5, 1.0]] * 5)
    np.testing.assert_allclose(slower.inputs, [[0.25, 0.5]] * 5)
