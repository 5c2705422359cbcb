"""The stages of plans: their times add up, and measuring leaves nothing behind."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from drake_gnnocp.experiments.benchmark.tasks import named_tasks
from drake_gnnocp.experiments.reports.stages import STAGES, main, timed_plans
from drake_gnnocp.experiments.stopwatch import Stopwatch
from drake_gnnocp.ocp import refine
from drake_gnnocp.ocp.ipopt import solve


def test_what_a_stage_takes_does_not_count_for_the_stage_around_it() -> None:
    watch = Stopwatch()
    inner = watch.timed("inner", lambda: time.sleep(0.05))

    def around() -> None:
        inner()
        time.sleep(0.02)
        inner()

    watch.timed("outer", around)()
    assert watch.calls == {"inner": 2, "outer": 1}
    assert 0.1 <= watch.seconds["inner"] < 0.15 and 0.02 <= watch.seconds["outer"] < 0.05
    watch.reset()
    assert not watch.seconds


def test_stages_are_parts_of_a_plan_and_are_not_measured_afterwards() -> None:
    built, solved = refine.build, refine.ipopt.solve
    (made,) = timed_plans(named_tasks(["map_c"]), 60.0)
    assert made.verified and made.own
    assert {"Ipopt", "certificate", "program", "SQP: quadratic programs", "formulation"} <= set(made.stages)
    assert sum(made.stages.values()) < made.seconds and set(made.stages) <= set(STAGES)
    assert refine.build is built and refine.ipopt.solve is solved is solve


def test_the_command_writes_its_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["empty_field", "map_c", "--out", str(tmp_path / "new")]) == 0
    text = (tmp_path / "new" / "stages.md").read_text("utf-8")
    assert "2 tasks" in text and "| Ipopt |" in text and "| all |" in text and "Verified 100.0%" in text
    assert text in capsys.readouterr().out
    assert main(["no_such", "--out", str(tmp_path)]) == 2
