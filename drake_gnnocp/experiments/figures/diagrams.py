"""Diagrams of boxes and arrows: the system, and the networks with the sizes of their configurations.

torch takes a second that other figures need not wait for: it is imported where a diagram asks for sizes.
"""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drake_gnnocp.experiments.figures.boxes import Box, diagram, draw_box, draw_frame, draw_note, draw_way
from drake_gnnocp.experiments.figures.plans import N_KNOTS, ROUNDS, Plans
from drake_gnnocp.experiments.figures.sheet import PAGE
from drake_gnnocp.pictures import style

SYSTEM_HEIGHT, NETWORK_HEIGHT = 3.75, 4.65  # inch
WEIGHTS_WAY = 3.15, 1.14  # inch, x and y of the weights' way from the training to the network
OURS, PAPERS = 4.55, 2.45  # inch, widths of the two networks


def framework_figure(plans: Plans) -> Figure:
    """The system: guess, optimal control, verification, and training.

    Planning is above, training below; dashed is what is done where the usual way gives no verified plan.
    """
    from drake_gnnocp.learning.configs import NetworkConfig

    figure, ax = diagram(PAGE, SYSTEM_HEIGHT)
    points = NetworkConfig().points
    scenario = Box(0.05, 1.95, 1.0, 0.75, "Scenario", ("polygons, bounds", "start and goal", "vehicle"))
    gnn = Box(1.5, 2.6, 1.4, 0.5, "GNN", (f"{points} points, spline to {N_KNOTS}",), style.PLAN)
    searched = Box(1.5, 2.0, 1.4, 0.5, "Hybrid A*", ("and speed planner",), style.GUESS, dashed=True)
    sampled = Box(1.5, 1.4, 1.4, 0.5, "RRT*", ("to compare with",), style.FRAME, dashed=True)
    steps = Box(3.4, 2.5, 1.4, 0.6, "SQP steps", ("quadratic programs", "near the guess"), style.START)
    constraints = ("direct collocation,", "triangle areas,", "separating lines")
    ipopt = Box(3.4, 1.4, 1.4, 0.75, "Ipopt", constraints, style.START)
    checks = ("driven again:", "footprint, limits,", "goal, bounds")
    check = Box(5.2, 1.85, 0.95, 0.95, "Verification", checks, style.GOAL)
    result = Box(6.4, 1.95, 0.75, 0.75, "Plan", ("trajectory", "pictures", "3D replay"))
    draw_frame(ax, 1.4, 1.3, 1.6, 2.05, "initial guess")
    draw_frame(ax, 3.3, 1.3, 1.6, 2.05, "optimal control (Drake)")
    for box in (scenario, gnn, searched, sampled, steps, ipopt, check, result):
        draw_box(ax, box)
    draw_way(ax, scenario.right, (1.4, scenario.right[1]))
    draw_way(ax, (3.0, 2.88), (3.4, 2.88))
    draw_way(ax, steps.bottom, ipopt.top)
    draw_way(ax, (4.9, 2.325), check.left)
    draw_way(ax, check.right, result.left)
    _draw_ways_back(ax, searched, ipopt, check)
    _draw_training(ax, gnn)
    return figure


def _draw_ways_back(ax: Axes, searched: Box, ipopt: Box, check: Box) -> None:
    """The refinement loop below, and the next guess above."""
    low, high = 1.13, 3.55
    draw_way(ax, check.bottom, (check.bottom[0], low), (ipopt.bottom[0], low), ipopt.bottom, color=style.GOAL)
    draw_note(ax, check.bottom[0] + 0.06, 1.45, f"too close: lines are added,\nat most {ROUNDS} rounds", align="left")
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


def network_figure(plans: Plans) -> Figure:
    """The default network and the paper's."""
    figure, ax = diagram(PAGE, NETWORK_HEIGHT)
    draw_default_network(ax)
    draw_paper_network(ax, PAGE - PAPERS)
    return figure


def draw_default_network(ax: Axes) -> Axes:
    """The network of the `default` configuration, from below to above."""
    from drake_gnnocp.learning.configs import NetworkConfig
    from drake_gnnocp.learning.network import DILATIONS, NEIGHBOURS

    c = NetworkConfig()
    draw_frame(ax, 0.02, 0.02, OURS, NETWORK_HEIGHT - 0.04, f"default network: {_weights('default')}")
    vectors = Box(0.12, 0.12, 1.95, 0.5, "Obstacle vectors", ("seen from start and from goal",))
    task = Box(2.3, 0.12, 1.4, 0.5, "Goal and vehicle", ("in the start's frame",))
    encoder = Box(0.12, 0.8, 1.95, 0.5, "Obstacle encoder", (f"2 MLPs with max: a token of {c.width}",), style.PLAN)
    token = Box(2.3, 0.8, 1.4, 0.5, "Task encoder", (f"MLP: a token of {c.width}",), style.PLAN)
    attention = f"{c.encoder_layers} layers, {c.heads} heads: the global graph"
    transformer = Box(0.12, 1.48, 3.58, 0.5, "Transformer over all tokens", (attention,), style.PLAN)
    queries = f"{c.hypotheses} queries, {c.proposer_layers} layers of attention to tokens"
    proposed = f"each: {c.points} points of x, y, θ, v, φ; a duration; a score"
    proposer = Box(0.12, 2.16, 3.58, 0.62, "Proposer", (queries, proposed), style.GUESS)
    around = f"nearest points of {NEIGHBOURS} obstacles, kinematic error,"
    waves = f"convolutions along the trajectory ({c.channels} channels, steps {', '.join(map(str, DILATIONS))})"
    refiner = Box(0.12, 2.96, 3.58, 0.7, f"{c.refinements} refiners", (around, waves), style.START)
    ordered = f"best first, clamped spline to {N_KNOTS} knots"
    guesses = Box(0.12, 3.84, 3.58, 0.5, f"{c.hypotheses} guesses", (ordered,))
    for box in (vectors, task, encoder, token, transformer, proposer, refiner, guesses):
        draw_box(ax, box)
    ways = ((vectors, encoder), (task, token), (transformer, proposer), (proposer, refiner), (refiner, guesses))
    for below, above in ways:
        draw_way(ax, below.top, above.bottom)
    for below in (encoder, token):
        draw_way(ax, below.top, (below.top[0], transformer.y))
    side = 3.86  # tokens pass the proposer
    draw_way(ax, transformer.right, (side, transformer.right[1]), (side, refiner.right[1]), refiner.right)
    draw_note(ax, side + 0.06, 2.45, "obstacles'\ntokens", align="left")
    return ax


def draw_paper_network(ax: Axes, x: float) -> Axes:
    """The network of the `paper` configuration, from below to above, with its left side at x [inch]."""
    from drake_gnnocp.learning.configs import PaperConfig
    from drake_gnnocp.vehicle import State

    c = PaperConfig()
    draw_frame(ax, x, 0.02, PAPERS - 0.02, NETWORK_HEIGHT - 0.04, f"paper's: {_weights('paper')}")
    states = (f"{c.points} points of x, y, θ, v, φ", "duration: length over speed")
    left, width = x + 0.12, PAPERS - 0.26
    rows = (
        ("Vectors", ("obstacles; start and goal",), 0.5, style.FRAME),
        ("Subgraphs", (f"{c.subgraph_layers} x MLP ({c.hidden}), joined with max",), 0.5, style.PLAN),
        ("Max pooling", ("one node a subgraph",), 0.5, style.PLAN),
        ("Global graph", (f"{c.graph_rounds} x MLP ({c.hidden}), joined with max",), 0.5, style.PLAN),
        (f"{len(State)} heads", states, 0.62, style.GUESS),
        ("1 guess", (f"interpolated to {N_KNOTS} knots",), 0.5, style.FRAME),
    )
    between = (NETWORK_HEIGHT - 0.43 - sum(height for _, _, height, _ in rows)) / (len(rows) - 1)  # as high as ours
    y, boxes = 0.12, []
    for title, lines, height, color in rows:
        boxes.append(Box(left, y, width, height, title, lines, color))
        draw_box(ax, boxes[-1])
        y += height + between
    for below, above in zip(boxes, boxes[1:], strict=False):
        draw_way(ax, below.top, above.bottom)
    return ax


def _weights(name: str) -> str:
    """How many weights the network of a configuration has."""
    from drake_gnnocp.learning.configs import config_of
    from drake_gnnocp.learning.trainable import new_network

    count = sum(weights.numel() for weights in new_network(config_of(name)).parameters())
    return f"{count / 1e6:.2f} million weights"
