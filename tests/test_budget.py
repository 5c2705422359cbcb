"""Budgets: what is left, what counts, and whether work was left undone, by a clock that the tests turn."""

import math

from drake_gnnocp.budget import RESERVE, Budget


class Clock:
    """A clock that stands still until it is turned."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        """The instant."""
        return self.now


def test_a_budget_runs_down_and_ends() -> None:
    clock = Clock()
    budget = Budget(10.0, clock)
    assert budget.left == 10.0 and budget.spent == 0.0 and not budget.is_over
    clock.now += 7.0
    assert budget.left == 3.0 and budget.spent == 7.0
    clock.now += 3.0
    assert budget.is_over and budget.left == 0.0
    clock.now += 50.0
    assert budget.left == 0.0


def test_a_budget_has_ended_work_only_where_work_was_left() -> None:
    clock = Clock()
    budget = Budget(10.0, clock)
    clock.now += 20.0
    assert not budget.ended  # nobody had more to do
    assert budget.is_over and budget.ended
    assert budget.ended_before("lunch") == "the budget of 10 s ended before lunch"


def test_a_budget_that_ended_work_stays_over() -> None:
    budget = Budget(10.0, Clock())
    budget.ended = True  # a solver said so
    assert budget.is_over


def test_a_part_is_kept_for_the_last_check() -> None:
    clock = Clock()
    assert Budget.of(10.0, clock).left == 10.0 - RESERVE
    assert 0.0 < Budget.of(RESERVE / 2, clock).left < RESERVE / 2


def test_what_is_done_while_a_budget_stands_still_does_not_count() -> None:
    clock = Clock()
    budget = Budget(10.0, clock)
    clock.now += 1.0
    with budget.standing_still():
        clock.now += 50.0
    assert budget.spent == 1.0 and budget.left == 9.0


def test_an_unlimited_budget_never_ends() -> None:
    unlimited = Budget.unlimited()
    assert unlimited.left == math.inf and not unlimited.is_over
