"""The car of the replay: a body over the vehicle's rectangle and four wheels, the front ones steered.

The body leaves the wheels free, as on an open roadster, so that the steering can be seen from above. Its outline is
exactly the vehicle's footprint. Scene paths: car / {front,rear}_{left,right} (steered) / roll (turns about its axle).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely
from pydrake.geometry import Box, Cylinder, Meshcat, MeshcatAnimation, Rgba
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from drake_gnnocp.pictures.meshes import frustum, prism, upright
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import State, Vehicle

CAR = "car"
PAINT = Rgba(0.0, 0.36, 0.62)  # the plan's blue, a little darker: WebGL's lights brighten it
GLASS = Rgba(0.13, 0.18, 0.22)
TYRE = Rgba(0.07, 0.07, 0.07)
RIM = Rgba(0.75, 0.75, 0.78)
HEADLIGHT = Rgba(1.0, 0.95, 0.7)
TAILLIGHT = Rgba(0.75, 0.05, 0.05)


@dataclass(frozen=True)
class Proportions:
    """Sizes of the drawn parts, derived from the vehicle's."""

    wheel_radius: float  # m
    wheel_width: float  # m
    track: float  # m, between the middles of a pair of wheels
    core: float  # m, half the width of the body between the wheels

    @classmethod
    def of(cls, vehicle: Vehicle) -> Proportions:
        """Proportions that look like a car for any wheelbase and width."""
        wheel_width = 0.13 * vehicle.width
        return cls(
            wheel_radius=min(0.12 * vehicle.wheelbase, 0.2 * vehicle.width),
            wheel_width=wheel_width,
            track=vehicle.width - wheel_width - 0.04 * vehicle.width,
            core=0.31 * vehicle.width,
        )


def add_car(meshcat: Meshcat, vehicle: Vehicle) -> None:
    """Put the parts of a car into the scene; its frame is the middle of the rear axle on the ground."""
    size = Proportions.of(vehicle)
    _add_body(meshcat, vehicle, size)
    _add_cabin(meshcat, vehicle, size)
    _add_lights(meshcat, vehicle, size)
    for name, at in _wheels(vehicle, size).items():
        meshcat.SetTransform(f"{CAR}/{name}", RigidTransform(at))
        _add_wheel(meshcat, f"{CAR}/{name}/roll", size)


def place_car(meshcat: Meshcat, pose: np.ndarray) -> None:
    """Park the car at a pose (3,) x, y, theta [m, m, rad]."""
    meshcat.SetTransform(CAR, _pose(pose))


def animate_car(animation: MeshcatAnimation, vehicle: Vehicle, frames: Trajectory, hold: int = 0) -> None:
    """Let the car drive, its wheels steered by phi and rolling with v.

    Args:
        animation: gets one frame for every knot of `frames`.
        vehicle: its wheelbase is where the front wheels are.
        frames: knots at the rate of the animation.
        hold: how many frames the car rests at the end.
    """
    size = Proportions.of(vehicle)
    v, phi = frames.column(State.V), frames.column(State.PHI)
    distance = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(frames.t))])
    wheels = _wheels(vehicle, size)
    last = len(frames) - 1
    for frame, knot in [*((k, k) for k in range(last + 1)), (last + hold, last)]:
        animation.SetTransform(frame, CAR, _pose(frames.poses[knot]))
        roll = RigidTransform(RotationMatrix.MakeYRotation(distance[knot] / size.wheel_radius))
        for name, at in wheels.items():
            animation.SetTransform(frame, f"{CAR}/{name}/roll", roll)
            if name.startswith("front"):
                steer = RotationMatrix.MakeZRotation(phi[knot])
                animation.SetTransform(frame, f"{CAR}/{name}", RigidTransform(steer, at))


def _pose(pose: np.ndarray) -> RigidTransform:
    return RigidTransform(RotationMatrix.MakeZRotation(pose[State.THETA]), [pose[State.X], pose[State.Y], 0.0])


def _wheels(vehicle: Vehicle, size: Proportions) -> dict[str, list[float]]:
    half = size.track / 2
    axles = (("rear", 0.0), ("front", vehicle.wheelbase))
    sides = (("left", half), ("right", -half))
    return {f"{axle}_{side}": [x, y, size.wheel_radius] for axle, x in axles for side, y in sides}


def _add_body(meshcat: Meshcat, vehicle: Vehicle, size: Proportions) -> None:
    rear, front, half = -vehicle.rear_hang, vehicle.wheelbase + vehicle.front_hang, vehicle.width / 2
    r, wheelbase = size.wheel_radius, vehicle.wheelbase
    floor, belt = 0.6 * r, 2.5 * r  # m above the ground
    side = [[rear, 1.3 * floor], [front, 1.3 * floor], [front, 1.7 * r], [wheelbase * 0.78, belt], [rear, 2.35 * r]]
    core = upright(prism(shapely.Polygon(side), 0.0, 1.0), size.core)
    meshcat.SetTriangleMesh(f"{CAR}/core", *core, rgba=PAINT)
    room = 1.25 * r  # between an axle and the body before and behind its wheels
    for name, x0, x1, high in (
        ("tail", rear, -room, 2.2 * r),
        ("sills", room, wheelbase - room, 2.2 * r),
        ("nose", wheelbase + room, front, 1.6 * r),
    ):
        if x1 > x0:  # short hangs have no room for it
            block = frustum((x0, x1, half), (x0, x1, 0.94 * half), floor, high)
            meshcat.SetTriangleMesh(f"{CAR}/{name}", *block, rgba=PAINT)


def _add_cabin(meshcat: Meshcat, vehicle: Vehicle, size: Proportions) -> None:
    r, wheelbase, half = size.wheel_radius, vehicle.wheelbase, vehicle.width / 2
    rear, front = -0.1 * wheelbase, 0.74 * wheelbase
    low, high = 2.2 * r, 4.0 * r
    roof = (rear + 0.16 * wheelbase, front - 0.2 * wheelbase)
    glass = frustum((rear, front, 0.8 * half), (*roof, 0.62 * half), low, high)
    meshcat.SetTriangleMesh(f"{CAR}/glass", *glass, rgba=GLASS)
    top = frustum((*roof, 0.63 * half), (roof[0] + 0.05, roof[1] - 0.05, 0.58 * half), high, high + 0.15 * r)
    meshcat.SetTriangleMesh(f"{CAR}/roof", *top, rgba=PAINT)


def _add_lights(meshcat: Meshcat, vehicle: Vehicle, size: Proportions) -> None:
    rear, front = -vehicle.rear_hang, vehicle.wheelbase + vehicle.front_hang
    r, thickness = size.wheel_radius, 0.02  # m
    for name, x, z, color in (("head", front, 1.3 * r, HEADLIGHT), ("tail", rear, 1.7 * r, TAILLIGHT)):
        for side, y in (("left", 0.36 * vehicle.width), ("right", -0.36 * vehicle.width)):
            path = f"{CAR}/{name}light_{side}"
            meshcat.SetObject(path, Box(2 * thickness, 0.16 * vehicle.width, 0.35 * r), color)
            meshcat.SetTransform(path, RigidTransform([x, y, z]))


def _add_wheel(meshcat: Meshcat, path: str, size: Proportions) -> None:
    """A tyre with a rim and a bar across it, by which the rolling can be seen."""
    across = RigidTransform(RollPitchYaw(math.pi / 2, 0.0, 0.0), np.zeros(3))  # a cylinder's axis from z to y
    for name, shape, color in (
        ("tyre", Cylinder(size.wheel_radius, size.wheel_width), TYRE),
        ("rim", Cylinder(0.6 * size.wheel_radius, 1.04 * size.wheel_width), RIM),
        ("bar", Box(1.1 * size.wheel_radius, 0.2 * size.wheel_radius, 1.08 * size.wheel_width), TYRE),
    ):
        meshcat.SetObject(f"{path}/{name}", shape, color)
        meshcat.SetTransform(f"{path}/{name}", across)
