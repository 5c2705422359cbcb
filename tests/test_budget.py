"""Budgets: what is left, shares of it, and time kept for later, by a clock that the tests turn."""

import math

from drake_gnnocp.budget import Budget


class Clock:
    """A clock that stands still until it is turned."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        """The instant."""
        return self.now


def test_a_budget_runs_down_and_ends() -> None:
    clock = Clock()
    budget = Budget.of(10.0, clock)
    assert budget.left == 10.0 and not budget.is_over
    clock.now += 7.0
    assert budget.left == 3.0
    clock.now += 3.0
    assert budget.is_over and budget.left == 0.0
    clock.now += 50.0
    assert budget.left == 0.0


def test_a_share_begins_now_and_is_of_what_is_left() -> None:
    clock = Clock()
    budget = Budget.of(10.0, clock)
    clock.now += 6.0
    share = budget.share(0.25)
    assert share.left == 1.0
    clock.now += 1.0
    assert share.is_over and budget.left == 3.0


def test_a_share_is_at_least_what_is_asked_for_but_never_more_than_there_is() -> None:
    budget = Budget.of(10.0, Clock())
    assert budget.share(0.1, at_least=5.0).left == 5.0
    assert budget.share(0.1, at_least=50.0).left == 10.0
    assert budget.at_most(20.0).left == 10.0


def test_time_kept_for_later_is_taken_from_the_end() -> None:
    clock = Clock()
    budget = Budget.of(10.0, clock)
    early = budget.without(2.0)
    clock.now += 8.0
    assert early.is_over and budget.left == 2.0


def test_an_unlimited_budget_and_its_parts() -> None:
    unlimited = Budget.unlimited()
    assert unlimited.left == math.inf and not unlimited.is_over
    assert unlimited.share(0.5).left == math.inf
    assert unlimited.at_most(1e9).left < math.inf
