"""The system: from a scenario over a guess and optimal control to a verified plan, and how the network is trained."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drake_gnnocp.experiments.figures.boxes import Box, diagram, draw_box, draw_frame, draw_note, draw_way
from drake_gnnocp.experiments.figures.plans import Plans
from drake_gnnocp.experiments.figures.sheet import PAGE
from drake_gnnocp.guesses.sources import GuessOptions
from drake_gnnocp.ocp.refine import RefineOptions
from drake_gnnocp.pictures import style

HEIGHT = 3.75  # inch
WEIGHTS_WAY = 3.15, 1.14  # inch, x and y of the weights' way from the training to the network


def framework_figure(plans: Plans) -> Figure:
    """The system as a diagram."""
    figure, ax = diagram(PAGE, HEIGHT)
    draw_framework(ax)
    return figure


def draw_framework(ax: Axes) -> Axes:
    """Planning above, training below; dashed is what is done where the usual way gives no verified plan."""
    from drake_gnnocp.learning.network import NetworkConfig  # torch takes a second that other figures need not wait for

    points, knots = NetworkConfig().points, GuessOptions().n_knots
    scenario = Box(0.05, 1.95, 1.0, 0.75, "Scenario", ("polygons, bounds", "start and goal", "vehicle"))
    gnn = Box(1.5, 2.6, 1.4, 0.5, "GNN", (f"{points} points, spline to {knots}",), style.PLAN)
    searched = Box(1.5, 2.0, 1.4, 0.5, "Hybrid A*", ("and speed planner",), style.GUESS, dashed=True)
    sampled = Box(1.5, 1.4, 1.4, 0.5, "RRT*", ("to compare with",), style.FRAME, dashed=True)
    convex = Box(3.4, 2.5, 1.4, 0.6, "Convex steps", ("quadratic programs", "near the guess"), style.START)
    ipopt = Box(
        3.4, 1.4, 1.4, 0.75, "Ipopt", ("direct collocation,", "triangle areas,", "separating lines"), style.START
    )
    check = Box(
        5.2, 1.85, 0.95, 0.95, "Verification", ("driven again:", "footprint, limits,", "goal, bounds"), style.GOAL
    )
    result = Box(6.4, 1.95, 0.75, 0.75, "Plan", ("trajectory", "pictures", "3D replay"))
    draw_frame(ax, 1.4, 1.3, 1.6, 2.05, "initial guess")
    draw_frame(ax, 3.3, 1.3, 1.6, 2.05, "optimal control (Drake)")
    for box in (scenario, gnn, searched, sampled, convex, ipopt, check, result):
        draw_box(ax, box)
    draw_way(ax, scenario.right, (1.4, scenario.right[1]))
    draw_way(ax, (3.0, 2.88), (3.4, 2.88))
    draw_way(ax, convex.bottom, ipopt.top)
    draw_way(ax, (4.9, 2.325), check.left)
    draw_way(ax, check.right, result.left)
    _draw_ways_back(ax, searched, ipopt, check)
    _draw_training(ax, gnn)
    return ax


def _draw_ways_back(ax: Axes, searched: Box, ipopt: Box, check: Box) -> None:
    """The refinement loop below, and the next guess above."""
    rounds = RefineOptions().max_rounds
    low, high = 1.13, 3.55
    draw_way(ax, check.bottom, (check.bottom[0], low), (ipopt.bottom[0], low), ipopt.bottom, color=style.GOAL)
    draw_note(ax, check.bottom[0] + 0.06, 1.45, f"too close: lines are added,\nat most {rounds} rounds", align="left")
    side = 1.22
    fallback = (check.top, (check.top[0], high), (side, high), (side, 2.2), (searched.x, 2.2))
    draw_way(ax, *fallback, color=style.GUESS, dashed=True)
    draw_note(ax, 3.6, high, "not verified: Hybrid A* instead of the network", style.GUESS)


def _draw_training(ax: Axes, gnn: Box) -> None:
    """Four boxes from right to left, and the weights' way up to the network."""
    draw_frame(ax, 0.05, 0.05, PAGE - 0.1, 0.85, "training")
    texts = (
        ("Training", ("weights that plan best", "on validation maps")),
        ("Dataset", ("verified trajectories", "of all maps")),
        ("Labels", ("Hybrid A*, optimal", "control, verification")),
        ("Random tasks", ("maps, car parks,", "yards")),
    )
    boxes = [Box(1.2 + 1.49 * i, 0.15, 1.3, 0.6, title, lines) for i, (title, lines) in enumerate(texts)]
    for box in boxes:
        draw_box(ax, box)
    for after, before in zip(boxes, boxes[1:], strict=False):
        draw_way(ax, before.left, after.right)
    x, y = WEIGHTS_WAY
    up, to = boxes[0].at(0.8, 1.0), gnn.at(1.0, 0.2)
    draw_way(ax, up, (up[0], y), (x, y), (x, to[1]), to, color=style.PLAN)
    draw_note(ax, x - 0.06, 1.0, "weights", style.PLAN, "right")
