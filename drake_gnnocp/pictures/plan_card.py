"""A plan at a glance, for a notebook: its picture and a short table as one piece of HTML."""

from __future__ import annotations

import math
from base64 import b64encode
from collections.abc import Iterable
from html import escape
from io import BytesIO
from typing import TYPE_CHECKING

from drake_gnnocp.pictures import style
from drake_gnnocp.pictures.map_plot import plan_figure

if TYPE_CHECKING:
    from drake_gnnocp.planner import Attempt, Plan

WIDTH = 700  # pixels, of the picture


def plan_html(plan: Plan) -> str:
    """The map of a plan, what came out, and a row for every attempt, as HTML that needs no other file.

    Where nothing was solved, the map shows the guess, and the rows of what is not known are left out.
    """
    picture = BytesIO()
    figure = plan_figure(plan.scenario, plan.trajectory, plan.guess, fault=plan.first_fault, no_path=plan.no_path)
    style.write_figure(figure, picture, "png")
    source = b64encode(style.small_picture(picture, WIDTH)).decode()
    attempts = [("attempt", "iterations", "outcome"), *(_outcome(attempt) for attempt in plan.attempts)]
    return (
        '<div style="display: flex; flex-wrap: wrap; gap: 1em; align-items: flex-start">'
        f'<img alt="map of the plan" style="max-width: 100%" src="data:image/png;base64,{source}">'
        f"<div><strong>{escape(plan.scenario.name)}</strong>{_table(_facts(plan))}{_table(attempts)}</div></div>"
    )


def _facts(plan: Plan) -> list[tuple[str, str]]:
    """Names and values of what came out, with units."""
    rows = [("status", plan.status), ("guess", plan.guess_source)]
    if plan.trajectory is not None:
        rows.append(("duration", f"{plan.trajectory.duration:.1f} s"))
    if plan.cost is not None:
        rows.append(("cost J", f"{plan.cost.J:.2f}"))
    if plan.verification is not None:
        clearance = plan.verification.min_clearance_m
        rows.append(("clearance", f"{clearance:.2f} m" if math.isfinite(clearance) else "no obstacles"))
    return [*rows, ("total time", f"{plan.total_seconds:.2f} s")]


def _outcome(attempt: Attempt) -> tuple[str, str, str]:
    """Where the guess came from, how many iterations it took, and that it was verified or why it was given up."""
    return attempt.source, str(attempt.iterations), "verified" if attempt.verified else attempt.reason


def _table(rows: Iterable[tuple[str, ...]]) -> str:
    cells = ("".join(f'<td style="text-align: left">{escape(text)}</td>' for text in row) for row in rows)
    return "<table>" + "".join(f"<tr>{row}</tr>" for row in cells) + "</table>"
