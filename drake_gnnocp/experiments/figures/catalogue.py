"""All figures by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from matplotlib.figure import Figure

from drake_gnnocp.experiments.figures.car import vehicle_figure
from drake_gnnocp.experiments.figures.comparison import disparity_figure, states_figure
from drake_gnnocp.experiments.figures.errors import error_along_figure
from drake_gnnocp.experiments.figures.framework import framework_figure
from drake_gnnocp.experiments.figures.interpolation import interpolation_figure
from drake_gnnocp.experiments.figures.maps import overview_figure, process_figure, test_maps_figure
from drake_gnnocp.experiments.figures.network_diagram import network_figure
from drake_gnnocp.experiments.figures.plans import Plans
from drake_gnnocp.experiments.figures.triangles import triangle_area_figure
from drake_gnnocp.experiments.figures.vectors import vectorisation_figure


@dataclass(frozen=True)
class Entry:
    """A figure."""

    draw: Callable[[Plans], Figure]
    shows: str


FIGURES = {
    "framework": Entry(framework_figure, "the system: guess, optimal control, verification, and training"),
    "network": Entry(network_figure, "the default network and the paper's"),
    "vectorisation": Entry(vectorisation_figure, "a scene as vectors, subgraphs and the global graph"),
    "vehicle": Entry(vehicle_figure, "the car's geometry and its kinematic bicycle"),
    "triangle_area": Entry(triangle_area_figure, "the triangle-area method, P outside and inside"),
    "test_maps": Entry(test_maps_figure, "plans from the network's guess on map_a to map_d"),
    "process": Entry(process_figure, "predicted points, knots, optimum and both on map_a"),
    "states": Entry(states_figure, "path, heading, speed and steering of guess and optimum on map_a"),
    "disparity": Entry(disparity_figure, "cumulated difference of guess and optimum, for three sources of guesses"),
    "interpolation": Entry(interpolation_figure, "predicted points joined by lines and by the clamped spline"),
    "error_along": Entry(error_along_figure, "distance of prediction and optimum along the trajectory"),
    "overview": Entry(overview_figure, "scenario, guess and plan side by side"),
}
