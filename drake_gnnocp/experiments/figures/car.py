"""The car on the plane: L_w, both hangs and W measured, and x, y, theta, v and phi of the bicycle marked."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Polygon, Rectangle

from drake_gnnocp.experiments.figures.plans import Plans
from drake_gnnocp.experiments.figures.sheet import COLUMN, SMALL, TEXT, draw_arrow, draw_line, draw_text, new_sheet
from drake_gnnocp.pictures import style
from drake_gnnocp.vehicle import Vehicle

REAR, THETA = np.array([2.3, 1.75]), 0.42  # m, rad: the pose of the drawing
STEERING = 0.5  # rad, of the drawing
WHEEL = (0.62, 0.2)  # m, length and width of a wheel
INK = "#222222"


def vehicle_figure(plans: Plans) -> Figure:
    """The car's geometry and its kinematic bicycle."""
    figure, vehicle = new_sheet(COLUMN, 3.0), Vehicle()
    ax = figure.add_subplot()
    outline = vehicle.footprints(np.array([*REAR, THETA]))[0]
    ax.add_patch(Polygon(outline, facecolor="#EAF3F9", edgecolor=style.PLAN, lw=1.5))
    front, half = _world(vehicle.wheelbase), 0.8 * vehicle.width / 2
    for axle, steering in ((0.0, 0.0), (vehicle.wheelbase, STEERING)):
        draw_line(ax, _world(axle, -half), _world(axle, half), color=style.FRAME, lw=1.0)
        for side in (-half, half):
            _draw_wheel(ax, _world(axle, side), steering, "#BBBBBB")
    draw_line(ax, REAR, front, color=style.FRAME, lw=1.0)
    _draw_wheel(ax, REAR, 0.0, INK)
    _draw_wheel(ax, front, STEERING, INK)
    _draw_lengths(ax, vehicle)
    _draw_state(ax, front)
    low, high = outline.min(axis=0), outline.max(axis=0)
    ax.set(xlim=(-0.25, high[0] + 0.9), ylim=(min(-0.25, low[1] - 0.5), high[1] + 0.5), aspect="equal")
    ax.axis("off")
    return figure


def _direction(angle: float) -> np.ndarray:
    return np.array([np.cos(angle), np.sin(angle)])


def _world(along: float, across: float = 0.0) -> np.ndarray:
    """A point of the car's frame in the drawing (2,) [m]."""
    return REAR + along * _direction(THETA) + across * _direction(THETA + np.pi / 2)


def _draw_wheel(ax: Axes, middle: np.ndarray, steering: float, color: str) -> None:
    x, y = middle - np.array(WHEEL) / 2
    angle = float(np.degrees(THETA + steering))
    ax.add_patch(Rectangle((x, y), *WHEEL, angle=angle, rotation_point="center", fc=color, ec="none", zorder=3))


def _draw_lengths(ax: Axes, vehicle: Vehicle) -> None:
    """Hangs and wheelbase below the car, the width behind it."""
    half, side = vehicle.width / 2, -vehicle.width / 2 - 0.42
    marks = [-vehicle.rear_hang, 0.0, vehicle.wheelbase, vehicle.wheelbase + vehicle.front_hang]
    names = zip("rwf", (vehicle.rear_hang, vehicle.wheelbase, vehicle.front_hang), strict=True)
    for a, b, (letter, length) in zip(marks, marks[1:], names, strict=False):
        away = _direction(THETA - np.pi / 2) * 0.26
        _draw_measure(ax, _world(a, side), _world(b, side), f"$L_{letter}$ = {length:g} m", away)
    for mark in marks:
        end = -half if mark in (marks[0], marks[-1]) else -0.8 * half
        draw_line(ax, _world(mark, end), _world(mark, side - 0.1), color=style.OBSTACLE, lw=0.6)
    behind = marks[0] - 0.42
    for y in (-half, half):
        draw_line(ax, _world(marks[0], y), _world(behind - 0.1, y), color=style.OBSTACLE, lw=0.6)
    away = _direction(THETA) * -0.26
    _draw_measure(ax, _world(behind, -half), _world(behind, half), f"$W$ = {vehicle.width:g} m", away, np.pi / 2)


def _draw_measure(ax: Axes, a: np.ndarray, b: np.ndarray, text: str, away: np.ndarray, turned: float = 0.0) -> None:
    """A double arrow from a to b with a text beside its middle."""
    draw_arrow(ax, a, b, arrowstyle="<|-|>", color=INK, lw=0.8)
    angle = np.degrees(THETA + turned)
    angle -= 180.0 if angle > 90.0 else 0.0
    draw_text(
        ax, (a + b) / 2 + away, text, fontsize=TEXT, ha="center", va="center", rotation=angle, rotation_mode="anchor"
    )


def _draw_state(ax: Axes, front: np.ndarray) -> None:
    """Axes of the plane, the point (x, y), the heading, the speed and the steering angle."""
    for x, y, name in ((1.0, 0.0, "$x$"), (0.0, 1.0, "$y$")):
        draw_arrow(ax, (0.0, 0.0), (x, y), color=INK, lw=1.0)
        ax.text(x + 0.08, y + 0.08, name, fontsize=TEXT)
    draw_text(ax, REAR + [-0.55, 2.15], "$(x, y)$: middle of\nthe rear axle", fontsize=SMALL)
    draw_line(ax, REAR, REAR + [0.2, 2.05], color=style.OBSTACLE_EDGE, lw=0.7)
    ax.plot(*REAR, "o", color=style.GUESS, markersize=4.5, zorder=5)
    draw_line(ax, REAR, REAR + [2.1, 0.0], ls=":", color=style.GUESS, lw=1.0)
    _draw_angle(ax, REAR, (0.0, THETA), 1.75, "$\\theta$", style.GUESS)
    for angle, line in ((THETA, ":"), (THETA + STEERING, "--")):
        draw_line(ax, front, front + 2.0 * _direction(angle), ls=line, color=style.START, lw=1.0)
    _draw_angle(ax, front, (THETA, THETA + STEERING), 1.7, "$\\varphi$", style.START)
    draw_arrow(ax, REAR, _world(1.1), color=style.GUESS, lw=1.8)
    draw_text(ax, _world(0.75, 0.3), "$v$", color=style.GUESS, fontsize=TEXT)


def _draw_angle(
    ax: Axes, middle: np.ndarray, angles: tuple[float, float], radius: float, name: str, color: str
) -> None:
    """An arc between two directions [rad] with a name outside of it."""
    start, end = np.degrees(angles)
    ax.add_patch(Arc((middle[0], middle[1]), 2 * radius, 2 * radius, theta1=start, theta2=end, color=color))
    at = middle + (radius + 0.22) * _direction(float(np.mean(angles)))
    draw_text(ax, at, name, fontsize=TEXT + 1, color=color, ha="center", va="center", zorder=6)
