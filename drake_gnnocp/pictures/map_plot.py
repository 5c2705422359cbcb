"""The map of a plan: obstacles, the guess, the optimised path of the rear axle and the footprints along it."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path as FilePath
from textwrap import fill
from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PathCollection, PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Rectangle
from matplotlib.path import Path

from drake_gnnocp.pictures import style
from drake_gnnocp.pictures.scene import extent, goal_poses, readable_origin, relative_bounds, relative_poses
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.search.reachability import NoPath
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import State, Vehicle
from drake_gnnocp.verification import Finding

FOOTPRINT_SPACING = 1.5  # m of arc length between footprints
FOOTPRINTS = (6, 60)  # the least and the most of them
BORDER = 0.03  # of the larger side, free space around the drawing
MAP_SIZE = (6.6, 6.2)  # inch, the map fits into this ...
POINT = 3.0  # points, size of an obstacle that has none
LEGEND_WIDTH = 24  # characters
LEGEND_ROOM = (2.1, 0.8)  # inch, ... and legend, labels and title need this beside and above it


def draw_map(
    ax: Axes,
    scenario: Scenario,
    trajectory: Trajectory | None = None,
    guess: Trajectory | None = None,
    title: str | None = None,
    fault: Finding | None = None,
    no_path: NoPath | None = None,
    footprints: bool = True,
    labels: tuple[str, str] | None = None,
) -> Axes:
    """Draw a scenario from above with a plan in it, to scale.

    Maps far from zero are drawn relative to an origin near the start, which the axis labels give.

    Args:
        ax: axes to draw on; its limits, labels and legend (to the right of it) are set.
        scenario: obstacles, bounds, start and goals: the one that the plan ends at is solid, others are faint.
        trajectory: the optimised plan, None where nothing was found.
        guess: what the solver started from.
        title: written above the map.
        fault: of the plan, marked where it is; the plan is then not called optimised.
        no_path: why there is no path: where it is blocked is marked.
        footprints: whether the car is drawn along the plan.
        labels: of guess and trajectory in the legend, where they are something else.

    Returns:
        ax
    """
    origin = readable_origin(scenario)
    style.dress(ax)
    _draw_obstacles(ax, scenario, origin)
    if (bounds := relative_bounds(scenario, origin)) is not None:
        look: dict[str, Any] = {"fill": False, "ec": style.LIMIT, "ls": (0, (6, 2, 1, 2)), "label": "bounds"}
        ax.add_patch(Polygon(shapely.get_coordinates(bounds), **look))  # dash-dotted
    if trajectory is not None and footprints:
        _draw_footprints(ax, scenario.vehicle, relative_poses(trajectory.poses, origin))
    of_guess, of_plan = labels or ("initial guess", "optimised path" if fault is None else "unverified path")
    if guess is not None:
        ax.plot(*_path(guess, origin), "--", color=style.GUESS, linewidth=1.3, label=of_guess, zorder=4)
    if trajectory is not None:
        ax.plot(*_path(trajectory, origin), color=style.PLAN, linewidth=1.8, label=of_plan, zorder=5)
    _draw_car(ax, scenario.vehicle, relative_poses(scenario.start, origin), style.START, "start")
    _draw_goals(ax, scenario, trajectory, origin)
    if fault is not None:
        _draw_fault(ax, fault, origin)
    if no_path is not None and no_path.place is not None:
        x, y = np.array(no_path.place) - origin
        label = "blocked" if no_path.width is None else f"blocked: {no_path.width:.2f} m wide"
        ax.plot(x, y, "x", color=style.FAULT, markersize=12, markeredgewidth=2.5, label=label, zorder=7)
    _frame(ax, extent(scenario, (trajectory, guess), origin), origin)
    if title:
        ax.set_title(title, fontsize=style.TITLE_SIZE, parse_math=False)  # a name may hold dollar signs
    ax.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0, frameon=False, fontsize=style.LABEL_SIZE)
    return ax


def plan_figure(
    scenario: Scenario,
    trajectory: Trajectory | None = None,
    guess: Trajectory | None = None,
    title: str | None = None,
    fault: Finding | None = None,
    no_path: NoPath | None = None,
    labels: tuple[str, str] | None = None,
) -> Figure:
    """The map of a plan as a figure of its own, for a notebook or a file; see `draw_map`."""
    figure = style.new_figure(*map_size(scenario, (trajectory, guess)))
    draw_map(figure.add_subplot(), scenario, trajectory, guess, title, fault, no_path, labels=labels)
    return figure


def map_size(scenario: Scenario, trajectories: Iterable[Trajectory | None]) -> tuple[float, float]:
    """Width and height of a figure that the map fits into, with its legend and labels [inch]."""
    low, high = extent(scenario, trajectories, readable_origin(scenario))
    width, height = high - low
    scale = min(MAP_SIZE[0] / width, MAP_SIZE[1] / height)
    return max(width * scale, 2.5) + LEGEND_ROOM[0], max(height * scale, 1.6) + LEGEND_ROOM[1]


def save_plan_picture(
    path: FilePath | str,
    scenario: Scenario,
    trajectory: Trajectory | None,
    guess: Trajectory | None,
    title: str | None,
    fault: Finding | None = None,
    no_path: NoPath | None = None,
    labels: tuple[str, str] | None = None,
) -> None:
    """Write the map of a plan as a picture (PNG, or what the suffix says); see `draw_map`."""
    style.save_figure(plan_figure(scenario, trajectory, guess, title, fault, no_path, labels), path)


def _path(trajectory: Trajectory, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return trajectory.column(State.X) - origin[0], trajectory.column(State.Y) - origin[1]


def _draw_obstacles(ax: Axes, scenario: Scenario, origin: np.ndarray) -> None:
    shapes = scenario.shapes.mapped(lambda points: points - origin)
    if len(shapes.polygons):
        outlines = [_compound_path(polygon) for polygon in shapes.polygons]
        look: dict[str, Any] = {"fc": style.OBSTACLE, "ec": style.OBSTACLE_EDGE, "linewidths": 0.8}
        ax.add_collection(PathCollection(outlines, zorder=2, **look), autolim=False)
        ax.add_patch(Rectangle((0, 0), 0, 0, fc=style.OBSTACLE, ec=style.OBSTACLE_EDGE, lw=0.8, label="obstacles"))
    is_point = shapely.length(shapes.lines) == 0
    label = None if len(shapes.polygons) else "obstacles"
    if not is_point.all():
        lines = [shapely.get_coordinates(line) for line in shapes.lines[~is_point]]
        look = {"colors": style.OBSTACLE_EDGE, "linewidths": 1.6, "capstyle": "round", "label": label}
        ax.add_collection(LineCollection(lines, zorder=2, **look), autolim=False)
        label = None
    if is_point.any():
        x, y = shapely.get_coordinates(shapely.centroid(shapes.lines[is_point])).T
        look = {"color": style.OBSTACLE_EDGE, "markersize": POINT, "markeredgewidth": 0, "label": label}
        ax.plot(x, y, "o", zorder=2, **look)


def _compound_path(polygon: shapely.Polygon) -> Path:
    rings = shapely.get_rings(polygon)
    return Path.make_compound_path(*(Path(shapely.get_coordinates(ring), closed=True) for ring in rings))


def _draw_footprints(ax: Axes, vehicle: Vehicle, poses: np.ndarray) -> None:
    """Rectangles evenly spaced in arc length, light at the start and darker towards the end."""
    steps = np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    if not np.isfinite(arc[-1]) or arc[-1] == 0:
        return
    n = int(np.clip(round(arc[-1] / FOOTPRINT_SPACING), *FOOTPRINTS)) + 1
    at = np.linspace(0.0, arc[-1], n)
    shown = vehicle.footprints(np.stack([np.interp(at, arc, column) for column in poses.T], axis=1))
    age = np.linspace(0.0, 1.0, n)
    colors = np.tile(to_rgb(style.SWEPT), (n, 1))
    edges, faces = (np.column_stack([colors, a + b * age]) for a, b in ((0.55, 0.40), (0.04, 0.12)))
    cars = PolyCollection(list(shown), ec=edges, fc=faces, linewidths=0.7, label="footprints", zorder=3)
    ax.add_collection(cars, autolim=False)


def _draw_goals(ax: Axes, scenario: Scenario, trajectory: Trajectory | None, origin: np.ndarray) -> None:
    """All goals, faint those that a trajectory does not end at, and the box that a tolerance makes of each."""
    poses, reached = goal_poses(scenario, trajectory)
    poses, named = relative_poses(poses, origin), set[str]()
    for i, (pose, target) in enumerate(zip(poses, scenario.targets, strict=True)):
        name, color = ("goal", style.GOAL) if reached in (None, i) else ("other goals", style.FAINT_GOAL)
        label = None if name in named else name
        named.add(name)
        if np.isnan(pose[2]):
            look: dict[str, Any] = {"fill": False, "ec": color, "lw": 1.8, "zorder": 6, "label": label}
            ax.add_patch(Circle(pose[:2], scenario.vehicle.width / 2, **look))
        else:
            _draw_car(ax, scenario.vehicle, pose, color, label)
        half = target.half_sizes[:2]
        if half.any():
            corners = pose[:2] + (half * [[-1, -1], [1, -1], [1, 1], [-1, 1]]) @ target.axes
            ax.add_patch(Polygon(corners, fill=False, ec=color, lw=1.0, ls=":", zorder=6))


def _draw_car(ax: Axes, vehicle: Vehicle, pose: np.ndarray, color: str, label: str | None) -> None:
    """The car's outline, with an arrow from the rear axle to the front bumper as its heading."""
    outline = vehicle.footprints(pose)[0]
    ax.add_patch(Polygon(outline, facecolor=(*to_rgb(color), 0.18), edgecolor=color, lw=1.8, label=label, zorder=6))
    cos, sin = np.cos(pose[State.THETA]), np.sin(pose[State.THETA])
    front, half = vehicle.wheelbase + 0.6 * vehicle.front_hang, 0.21 * vehicle.width
    arrow = np.array([[0.0, 0.0], [front, 0.0], [front - 2.2 * half, half], [front - 2.2 * half, -half], [front, 0.0]])
    x, y = np.array([[cos, -sin], [sin, cos]]) @ arrow.T + pose[:2, None]
    ax.plot(x[:2], y[:2], color=color, linewidth=1.4, zorder=6, solid_capstyle="butt")
    ax.fill(x[1:], y[1:], color=color, zorder=6, linewidth=0)
    ax.plot(x[0], y[0], "o", color=color, markersize=3.5, zorder=6)


def _draw_fault(ax: Axes, fault: Finding, origin: np.ndarray) -> None:
    """A ring and a cross where the fault is, and its text in the legend."""
    x, y = np.array([fault.x, fault.y]) - origin
    look: dict[str, Any] = {"color": style.FAULT, "markeredgewidth": 2.0, "linestyle": "none", "zorder": 8}
    ax.plot(x, y, "o", mfc="none", markersize=16, **look)
    ax.plot(x, y, "x", markersize=8, label=fill(f"{fault.fault}, at {fault.t:.1f} s", LEGEND_WIDTH), **look)


def _frame(ax: Axes, box: np.ndarray, origin: np.ndarray) -> None:
    border = BORDER * float((box[1] - box[0]).max())
    (left, low), (right, high) = box[0] - border, box[1] + border
    ax.set(xlim=(left, right), ylim=(low, high), aspect="equal")
    ax.set_xlabel(_axis_label("x", origin[0]), fontsize=style.LABEL_SIZE)
    ax.set_ylabel(_axis_label("y", origin[1]), fontsize=style.LABEL_SIZE)


def _axis_label(name: str, offset: float) -> str:
    if offset == 0:
        return f"{name} [m]"
    sign = "\N{MINUS SIGN}" if offset > 0 else "+"
    return f"{name} {sign} {abs(offset):.0f} [m]"
