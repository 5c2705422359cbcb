"""The default network and the paper's, with the sizes of their configurations."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drake_gnnocp.experiments.figures.boxes import Box, diagram, draw_box, draw_frame, draw_note, draw_way
from drake_gnnocp.experiments.figures.plans import Plans
from drake_gnnocp.experiments.figures.sheet import PAGE
from drake_gnnocp.guesses.sources import GuessOptions
from drake_gnnocp.pictures import style

HEIGHT = 4.65  # inch
OURS, PAPERS = 4.55, 2.45  # inch, widths of the two


def network_figure(plans: Plans) -> Figure:
    """Both networks side by side."""
    figure, ax = diagram(PAGE, HEIGHT)
    draw_default_network(ax)
    draw_paper_network(ax, PAGE - PAPERS)
    return figure


def draw_default_network(ax: Axes) -> Axes:
    """The network of the `default` configuration, from below to above."""
    from drake_gnnocp.learning.checkpoint import config_of, new_network
    from drake_gnnocp.learning.network import DILATIONS, NEIGHBOURS, NetworkConfig

    c = NetworkConfig()
    weights = sum(each.numel() for each in new_network(config_of("default")).parameters())
    draw_frame(ax, 0.02, 0.02, OURS, HEIGHT - 0.04, f"default network: {weights / 1e6:.2f} million weights")
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
    ordered = f"best first, clamped spline to {GuessOptions().n_knots} knots"
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
    from drake_gnnocp.learning.checkpoint import config_of, new_network
    from drake_gnnocp.learning.paper_network import PaperConfig
    from drake_gnnocp.vehicle import State

    c = PaperConfig()
    weights = sum(each.numel() for each in new_network(config_of("paper")).parameters())
    draw_frame(ax, x, 0.02, PAPERS - 0.02, HEIGHT - 0.04, f"paper's: {weights / 1e6:.2f} million weights")
    left, width = x + 0.12, PAPERS - 0.26
    rows = (
        ("Vectors", ("obstacles; start and goal",), 0.5, style.FRAME),
        ("Subgraphs", (f"{c.subgraph_layers} x MLP ({c.hidden}), joined with max",), 0.5, style.PLAN),
        ("Max pooling", ("one node a subgraph",), 0.5, style.PLAN),
        ("Global graph", (f"{c.graph_rounds} x MLP ({c.hidden}), joined with max",), 0.5, style.PLAN),
        (
            f"{len(State)} heads",
            (f"{c.points} points of x, y, θ, v, φ", "duration: length over speed"),
            0.62,
            style.GUESS,
        ),
        ("1 guess", (f"interpolated to {GuessOptions().n_knots} knots",), 0.5, style.FRAME),
    )
    gap = (HEIGHT - 0.43 - sum(height for _, _, height, _ in rows)) / (len(rows) - 1)  # as high as ours
    y, boxes = 0.12, []
    for title, lines, height, color in rows:
        boxes.append(Box(left, y, width, height, title, lines, color))
        draw_box(ax, boxes[-1])
        y += height + gap
    for below, above in zip(boxes, boxes[1:], strict=False):
        draw_way(ax, below.top, above.bottom)
    return ax
