"""The car: its geometry, its state, and the bicycle that moves it."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Polygon

from drake_gnnocp.experiments.figures.plans import Plans
from drake_gnnocp.experiments.figures.sheet import COLUMN, SMALL, TEXT, draw_arrow, new_sheet
from drake_gnnocp.pictures import style
from drake_gnnocp.vehicle import State, Vehicle

POSE = np.array([2.3, 1.75, 0.42])  # m, m, rad: of the drawing
STEERING = 0.5  # rad, of the drawing
WHEEL = (0.62, 0.2)  # m, length and width of a wheel
INK = "#222222"


def vehicle_figure(plans: Plans) -> Figure:
    """The car with its parameters."""
    figure = new_sheet(COLUMN, 3.0)
    draw_vehicle(figure.add_subplot(), Vehicle())
    return figure


def draw_vehicle(ax: Axes, vehicle: Vehicle) -> Axes:
    """A car on the plane with L_w, both hangs and W measured, and x, y, theta, v, phi marked."""
    outline = vehicle.footprints(POSE)[0]
    ax.add_patch(Polygon(outline, facecolor="#EAF3F9", edgecolor=style.PLAN, lw=1.5))
    rear, front = _world([0, 0]), _world([vehicle.wheelbase, 0])
    for axle in (0.0, vehicle.wheelbase):
        half = 0.8 * vehicle.width / 2
        _draw_line(ax, _world([axle, -half]), _world([axle, half]), color=style.FRAME, lw=1.0)
        for side in (-half, half):
            _draw_wheel(ax, _world([axle, side]), STEERING if axle else 0.0, "#BBBBBB")
    _draw_line(ax, rear, front, color=style.FRAME, lw=1.0)
    _draw_wheel(ax, rear, 0.0, INK)
    _draw_wheel(ax, front, STEERING, INK)
    _draw_lengths(ax, vehicle)
    _draw_state(ax, rear, front)
    low, high = outline.min(axis=0), outline.max(axis=0)
    ax.set_xlim(-0.25, high[0] + 0.9)
    ax.set_ylim(min(-0.25, low[1] - 0.5), high[1] + 0.5)
    ax.set_aspect("equal")
    ax.axis("off")
    return ax


def _world(point: list[float]) -> np.ndarray:
    """A point of the car's frame (2,) in the drawing [m]."""
    cos, sin = np.cos(POSE[State.THETA]), np.sin(POSE[State.THETA])
    return POSE[:2] + np.array([[cos, -sin], [sin, cos]]) @ np.array(point)


def _direction(angle: float) -> np.ndarray:
    return np.array([np.cos(angle), np.sin(angle)])


def _draw_wheel(ax: Axes, middle: np.ndarray, steering: float, color: str) -> None:
    along, across = _direction(POSE[State.THETA] + steering), _direction(POSE[State.THETA] + steering + np.pi / 2)
    signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    corners = [middle + i * WHEEL[0] / 2 * along + j * WHEEL[1] / 2 * across for i, j in signs]
    ax.add_patch(Polygon(corners, facecolor=color, edgecolor="none", zorder=3))


def _draw_lengths(ax: Axes, vehicle: Vehicle) -> None:
    """Hangs and wheelbase below the car, the width behind it."""
    side = -vehicle.width / 2 - 0.42
    marks = [-vehicle.rear_hang, 0.0, vehicle.wheelbase, vehicle.wheelbase + vehicle.front_hang]
    names = (
        f"$L_r$ = {vehicle.rear_hang:g} m",
        f"$L_w$ = {vehicle.wheelbase:g} m",
        f"$L_f$ = {vehicle.front_hang:g} m",
    )
    for a, b, name in zip(marks, marks[1:], names, strict=False):
        _draw_measure(ax, _world([a, side]), _world([b, side]), name, _direction(POSE[State.THETA] - np.pi / 2) * 0.26)
    for mark in marks:
        end = [mark, -vehicle.width / 2 if mark in (marks[0], marks[-1]) else -0.4 * vehicle.width]
        _draw_line(ax, _world(end), _world([mark, side - 0.1]), color=style.OBSTACLE, lw=0.6)
    behind, half = marks[0] - 0.42, vehicle.width / 2
    for y in (-half, half):
        _draw_line(ax, _world([marks[0], y]), _world([behind - 0.1, y]), color=style.OBSTACLE, lw=0.6)
    away = _direction(POSE[State.THETA]) * -0.26
    _draw_measure(ax, _world([behind, -half]), _world([behind, half]), f"$W$ = {vehicle.width:g} m", away, np.pi / 2)


def _draw_measure(ax: Axes, a: np.ndarray, b: np.ndarray, text: str, away: np.ndarray, turned: float = 0.0) -> None:
    """A double arrow from a to b with a text beside its middle."""
    draw_arrow(ax, a, b, arrowstyle="<|-|>", color=INK, lw=0.8)
    angle = np.degrees(POSE[State.THETA] + turned)
    angle -= 180.0 if angle > 90.0 else 0.0
    x, y = (a + b) / 2 + away
    ax.text(x, y, text, fontsize=TEXT, ha="center", va="center", rotation=angle, rotation_mode="anchor")


def _draw_state(ax: Axes, rear: np.ndarray, front: np.ndarray) -> None:
    """Axes of the plane, the point (x, y), the heading, the speed and the steering angle."""
    for x, y, name in ((1.0, 0.0, "$x$"), (0.0, 1.0, "$y$")):
        draw_arrow(ax, (0.0, 0.0), (x, y), color=INK, lw=1.0)
        ax.text(x + 0.08, y + 0.08, name, fontsize=TEXT)
    x, y = rear + [-0.55, 2.15]
    ax.text(x, y, "$(x, y)$: middle of\nthe rear axle", fontsize=SMALL)
    _draw_line(ax, rear, rear + [0.2, 2.05], color=style.OBSTACLE_EDGE, lw=0.7)
    ax.plot(*rear, "o", color=style.GUESS, markersize=4.5, zorder=5)
    theta = POSE[State.THETA]
    along, wheel, left = _direction(theta), _direction(theta + STEERING), _direction(theta + np.pi / 2)
    _draw_line(ax, rear, rear + [2.1, 0.0], ls=":", color=style.GUESS, lw=1.0)
    _draw_angle(ax, rear, (0.0, theta), 1.75, "$\\theta$", style.GUESS)
    _draw_line(ax, front, front + 2.0 * along, ls=":", color=style.START, lw=1.0)
    _draw_line(ax, front, front + 2.0 * wheel, ls="--", color=style.START, lw=1.0)
    _draw_angle(ax, front, (theta, theta + STEERING), 1.7, "$\\varphi$", style.START)
    draw_arrow(ax, rear, rear + 1.1 * along, color=style.GUESS, lw=1.8)
    x, y = rear + 0.75 * along + 0.3 * left
    ax.text(x, y, "$v$", color=style.GUESS, fontsize=TEXT)


def _draw_line(ax: Axes, a: np.ndarray, b: np.ndarray, **look: Any) -> None:
    ax.plot(*np.transpose([a, b]), **look)


def _draw_angle(
    ax: Axes, middle: np.ndarray, angles: tuple[float, float], radius: float, name: str, color: str
) -> None:
    """An arc between two directions [rad] with a name outside of it."""
    start, end = np.degrees(angles)
    ax.add_patch(Arc((middle[0], middle[1]), 2 * radius, 2 * radius, theta1=start, theta2=end, color=color))
    x, y = middle + (radius + 0.22) * _direction(float(np.mean(angles)))
    ax.text(x, y, name, fontsize=TEXT + 1, color=color, ha="center", va="center", zorder=6)
