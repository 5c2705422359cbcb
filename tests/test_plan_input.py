"""What a user hands to `plan` from Python: what cannot be planned is one clear ValueError."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drake_gnnocp import (
    CostWeights,
    Fixed,
    Guess,
    GuessUnavailable,
    NoGuess,
    PlanOptions,
    Scenario,
    ScenarioError,
    Trajectory,
    plan,
)
from drake_gnnocp.budget import Budget
from drake_gnnocp.guesses.straight import straight_line

FIELD = Scenario("field", np.zeros(3), np.array([12.0, 4.0, 0.4]))  # no obstacles
LINE = straight_line(FIELD, 60)


@dataclass(frozen=True)
class Own:
    """A source that a user might write."""

    make: Callable[[], Iterator[Guess | NoGuess]]
    proposes_many: bool = False
    name: str = "own"

    def check_available(self) -> None:
        """Nothing is needed."""

    def guesses(self, scenario: Scenario, budget: Budget) -> Iterator[Guess | NoGuess]:
        """What it makes."""
        return self.make()


def with_nan() -> Trajectory:
    states = LINE.states.copy()
    states[3, 1] = np.nan
    return replace(LINE, states=states)


@pytest.mark.parametrize("guess", ["auto", "hybrid_astar", "straight"])
def test_a_field_without_obstacles_is_planned(guess: str) -> None:
    assert plan(FIELD, guess).verified


def test_a_guess_of_unequal_time_steps_is_resampled() -> None:
    result = plan(FIELD, replace(LINE, t=LINE.t**1.5))
    assert result.verified and result.guess is not None
    np.testing.assert_allclose(np.diff(result.guess.t), result.guess.t[1])


def test_a_trajectory_may_be_given_as_lists_of_whole_numbers() -> None:
    moved = Trajectory([0, 1], [[0] * 5] * 2, [[0, 0]] * 2).translated(0.5, 0.0)  # type: ignore[arg-type]
    assert moved.states[0, 0] == 0.5


@pytest.mark.parametrize(
    ("guess", "message"),
    [
        (with_nan(), "guess: y of knot 3: must be finite and at most 1e[+]12, not nan"),
        (replace(LINE, t=-LINE.t), "guess: t of knot 1: must be larger than that of the knot before"),
        (replace(LINE, t=0 * LINE.t), "guess: t of knot 1: must be larger"),
        (42, "guess: must be a name, a source or a trajectory, not 42"),
    ],
)
def test_a_guess_that_is_none_is_refused(guess: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        plan(FIELD, guess)


def test_a_source_whose_guess_no_solver_can_begin_with_is_named() -> None:
    for bad, message in (
        (with_nan(), "y of knot 3"),
        (replace(LINE, t=LINE.t**1.5), "'own': the knots must be equally"),
    ):
        with pytest.raises(ValueError, match=message):
            plan(FIELD, Own(lambda bad=bad: iter([Guess("own", bad)])))  # type: ignore[misc]


@pytest.mark.parametrize("horizon", ["guess", 20.0])
@pytest.mark.parametrize("proposes_many", [False, True])
def test_a_source_without_guesses_fails_with_a_reason(proposes_many: bool, horizon: Any) -> None:
    result = plan(FIELD, Own(lambda: iter([]), proposes_many), horizon)
    assert result.status == "failed"
    assert [(attempt.source, attempt.reason) for attempt in result.attempts][0] == ("own", "the source made no guess")


def test_an_error_in_a_source_is_not_hidden() -> None:
    def broken() -> Iterator[Guess | NoGuess]:
        raise RuntimeError("my mistake")
        yield

    with pytest.raises(RuntimeError, match="my mistake"):
        plan(FIELD, Own(broken))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("knots", value) for value in (-1, 0, 3, 60.5, True)),
        *(("margin", value) for value in (-0.1, np.nan, np.inf, "0.1")),
        *(("slack", value) for value in (0, 0.9, np.nan)),
        ("hypotheses", 0),
        ("seed", -1),
        *(("most_attempts", value) for value in (0, -1, 1.5)),
    ],
)
def test_an_option_out_of_its_range_is_named(name: str, value: Any) -> None:
    with pytest.raises(ValueError, match=rf"^options\.{name}: must be "):
        PlanOptions(**{name: value})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("lambda1", value) for value in (0, -1, np.nan, np.inf)),
        *(("lambda2", value) for value in (-1, np.nan)),
        *(("gamma", value) for value in (1, 0.5)),
        *(("time", value) for value in (0, -1)),
    ],
)
def test_a_weight_that_no_solver_can_use_is_named(name: str, value: Any) -> None:
    with pytest.raises(ValueError, match=rf"^cost\.{name}: must be "):
        CostWeights(**{name: value})


def test_the_weight_of_the_obstacles_may_be_zero(gate: Scenario) -> None:
    result = plan(gate, options=PlanOptions(cost=CostWeights(lambda2=0.0)))
    assert result.verified and result.cost is not None and result.cost.J == result.cost.J1


@pytest.mark.parametrize("seconds", ["soon", "3", None, True, 0, -1.0, np.nan, np.inf])
def test_a_horizon_that_is_no_duration_is_refused(seconds: Any) -> None:
    for refused in (lambda: Fixed(seconds), lambda: plan(FIELD, horizon=seconds)):
        with pytest.raises(ValueError, match="^horizon: must be 'guess', 'free' or 0 to 1000 seconds"):
            refused()


def test_a_horizon_may_be_a_number_of_numpy() -> None:
    result = plan(FIELD, "straight", horizon=np.int64(20))  # type: ignore[arg-type]
    assert result.trajectory is not None and result.trajectory.duration == pytest.approx(20.0)


@pytest.mark.parametrize("seconds", [0, -1, np.nan, "5", None, True])
def test_a_budget_that_is_none_is_refused(seconds: Any) -> None:
    with pytest.raises(ValueError, match="^max_seconds: must be positive"):
        plan(FIELD, max_seconds=seconds)


def test_a_scenario_may_be_a_path_and_must_be_one(tmp_path: Path) -> None:
    FIELD.save(tmp_path / "field.json")
    assert plan(tmp_path / "field.json").verified
    with pytest.raises(ValueError, match="^scenario: must be a Scenario, a bundled name or a file, not 42"):
        plan(42)  # type: ignore[arg-type]


def test_an_unknown_guess_is_refused() -> None:
    with pytest.raises(GuessUnavailable, match="guess: must be one of"):
        plan(Scenario.load("empty_field"), "nonsense")


def test_options_are_no_mapping() -> None:
    with pytest.raises(ValueError, match="^options: must be PlanOptions, not {'knots': 3}"):
        plan(FIELD, options={"knots": 3})  # type: ignore[arg-type]


class Parabola:
    """A source of a user: over the straight line, in a bow."""

    name = "parabola"
    proposes_many = False

    def check_available(self) -> None:
        """Nothing is needed."""

    def guesses(self, scenario: Scenario, budget: Budget) -> Iterator[Guess | NoGuess]:
        """One guess."""
        line = straight_line(scenario, 120)
        states = line.states.copy()
        states[:, 1] += 3.0 * (1 - np.linspace(-1.0, 1.0, len(line)) ** 2)
        yield Guess(self.name, Trajectory(line.t, states, line.inputs))


def test_a_source_of_guesses_of_ones_own_is_planned_with(gate: Scenario) -> None:
    result = plan(gate.translated(100.0, 50.0), Parabola())
    assert result.verified and result.guess_source == "parabola"
    assert result.guess is not None and result.guess.poses[0] == pytest.approx([100.0, 50.0, 0.0])


def test_a_trajectory_of_ones_own_is_a_guess_where_the_scenario_is(gate: Scenario) -> None:
    far = gate.translated(1e3, -2e3)
    first = plan(far, "hybrid_astar")
    assert first.trajectory is not None
    again = plan(far, first.trajectory)
    assert again.verified and again.guess_source == "given"
    assert again.attempt.iterations <= first.attempt.iterations
    assert again.trajectory is not None and again.trajectory.duration == pytest.approx(first.trajectory.duration)


def test_a_scenario_may_be_given_by_its_name() -> None:
    assert plan("empty_field").verified
    with pytest.raises(ScenarioError, match=r"typo: scenario: neither a \.json"):
        plan("typo")
