"""Draw the paper's figures from the command line: `python -m drake_gnnocp.figures [NAME...]`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

from matplotlib.figure import Figure
from tqdm import tqdm

from drake_gnnocp.console import DONE, OneLineParser, failed, seconds
from drake_gnnocp.drake_log import log_to_stderr
from drake_gnnocp.experiments.figures.car import vehicle_figure
from drake_gnnocp.experiments.figures.comparison import disparity_figure, error_along_figure, states_figure
from drake_gnnocp.experiments.figures.diagrams import framework_figure, network_figure
from drake_gnnocp.experiments.figures.interpolation import interpolation_figure
from drake_gnnocp.experiments.figures.maps import overview_figure, process_figure, test_maps_figure
from drake_gnnocp.experiments.figures.plans import Plans, Skipped
from drake_gnnocp.experiments.figures.triangles import triangle_area_figure
from drake_gnnocp.experiments.figures.vectors import vectorisation_figure
from drake_gnnocp.experiments.options import one_of
from drake_gnnocp.guesses import GuessUnavailable
from drake_gnnocp.guesses.learned import load_network
from drake_gnnocp.pictures.style import save_figure

FORMATS = ("png", "pdf")
FIGURES: dict[str, Callable[[Plans], Figure]] = {  # the first line of their docstrings says what they show
    "framework": framework_figure,
    "network": network_figure,
    "vectorisation": vectorisation_figure,
    "vehicle": vehicle_figure,
    "triangle_area": triangle_area_figure,
    "test_maps": test_maps_figure,
    "process": process_figure,
    "states": states_figure,
    "disparity": disparity_figure,
    "interpolation": interpolation_figure,
    "error_along": error_along_figure,
    "overview": overview_figure,
}


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser(
        prog="python -m drake_gnnocp.figures",
        description="Draw the figures of the paper, each as PNG and PDF. What cannot be drawn here (without trained "
        "weights, or without OMPL) is skipped, with a line on stderr that says why.",
        epilog="Exit code: 0 done, however many figures were skipped; 2 bad input.",
    )
    add = parser.add_argument
    add("names", nargs="*", type=one_of(FIGURES), metavar="NAME", help="which figures, see --list (default: all)")
    add("--list", action="store_true", help="list the figures and exit")
    out = Path("artifacts") / "paper"
    add("--out", type=Path, default=out, metavar="DIR", help="folder to write (default: %(default)s)")
    add("--weights", type=Path, metavar="FILE", help="weights of the network (default: the package's)")
    dense = "weights of a network that predicts 120 points, for 'interpolation' (default: none, its part is left out)"
    add("--dense-weights", type=Path, metavar="FILE", help=dense)
    budget = "wall-clock budget of one plan in seconds (default: %(default)g)"
    add("--max-seconds", type=seconds, default=30.0, metavar="S", help=budget)
    return parser


def main(argv: list[str] | None = None) -> int:
    """Parse the arguments and draw; returns the exit code."""
    arguments = _parser().parse_args(argv)
    log_to_stderr()
    if arguments.list:
        for name, draw in FIGURES.items():
            print(f"{name:<14} {(draw.__doc__ or '').splitlines()[0]}")
        return DONE
    plans = Plans(arguments.weights, arguments.dense_weights, arguments.max_seconds)
    try:
        for weights in filter(None, (arguments.weights, arguments.dense_weights)):
            load_network(weights)
        arguments.out.mkdir(parents=True, exist_ok=True)
        drawn = draw_all(list(dict.fromkeys(arguments.names)) or list(FIGURES), plans, arguments.out)
    except (GuessUnavailable, OSError) as error:
        return failed(error, arguments.out)
    print(f"{len(drawn)} figures written to {arguments.out}: {', '.join(drawn) or 'none'}")
    return DONE


def draw_all(names: list[str], plans: Plans, folder: Path) -> list[str]:
    """Draw figures into a folder, and return the names of those that could be drawn."""
    drawn = []
    for name in tqdm(names, unit="figure", disable=None):  # no bar where nobody looks
        try:
            figure = FIGURES[name](plans)
        except Skipped as reason:
            tqdm.write(f"{name}: skipped: {reason}", file=sys.stderr)
            continue
        for suffix in FORMATS:
            save_figure(figure, folder / f"{name}.{suffix}")
        drawn.append(name)
    return drawn
