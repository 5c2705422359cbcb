r"""The car: its rectangle, its limits and its kinematic bicycle model.

The state (x, y, theta, v, phi) belongs to the middle of the rear axle and the inputs are the acceleration a and the
steering rate w (the paper's kinematic constraints):

    x' = v cos(theta),  y' = v sin(theta),  theta' = v tan(phi) / L_w,  v' = a,  phi' = w
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from enum import IntEnum
from reprlib import repr as shown
from typing import Any

import numpy as np

SMALLEST, LARGEST = 1e-3, 1e4  # what a car's parameters may be in m, m/s, rad ...: the rest are mistaken units


class State(IntEnum):
    """Columns of a state array."""

    X = 0  # m
    Y = 1  # m
    THETA = 2  # rad
    V = 3  # m/s
    PHI = 4  # rad


class Input(IntEnum):
    """Columns of an input array."""

    A = 0  # m/s^2
    W = 1  # rad/s


@dataclass(frozen=True)
class Vehicle:
    """Geometry and limits of a car; the defaults are the paper's table of basic parameters.

    Raises:
        ValueError: a parameter is not a number from SMALLEST (the hangs: 0) to LARGEST, or phi_max is not below pi/2.
    """

    wheelbase: float = 2.8  # m, L_w
    front_hang: float = 0.96  # m, front axle to front bumper
    rear_hang: float = 0.929  # m, rear axle to rear bumper
    width: float = 1.9  # m, W
    v_max: float = 2.5  # m/s
    a_max: float = 2.0  # m/s^2
    phi_max: float = 0.7  # rad
    w_max: float = 0.85  # rad/s

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            may_be_zero = name in ("front_hang", "rear_hang")
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise ValueError(f"vehicle.{name}: must be a number, not {shown(value)}")
            least = 0 if may_be_zero else SMALLEST
            if not least <= value <= LARGEST:  # NaN as well
                raise ValueError(f"vehicle.{name}: must be between {least:g} and {LARGEST:g}, not {shown(value)}")
        if self.phi_max >= math.pi / 2:
            raise ValueError(f"vehicle.phi_max: must be below pi/2, not {self.phi_max!r}")

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Vehicle:
        """Build a vehicle from some of its parameters; the rest keep their defaults.

        Raises:
            ValueError: an unknown key or an illegal value; the message names it.
        """
        allowed = [field.name for field in fields(cls)]
        for key in data:
            if key not in allowed:
                raise ValueError(f"vehicle.{key}: unknown key; allowed are {', '.join(allowed)}")
        return cls(**data)

    def to_dict(self) -> dict[str, float]:
        """Return all parameters by name."""
        return asdict(self)

    def scaled(self, factor: float) -> Vehicle:
        """The same vehicle as many times as large: lengths, speed and acceleration; angles and times stay."""
        lengths = ("wheelbase", "front_hang", "rear_hang", "width", "v_max", "a_max")
        scaled = object.__new__(
            type(self)
        )  # it need not be of a size that users mean; rounded, there and back is the same
        scaled.__dict__.update({k: round(factor * v, 12) if k in lengths else v for k, v in self.to_dict().items()})
        return scaled

    @property
    def length(self) -> float:
        """Bumper to bumper [m]."""
        return self.rear_hang + self.wheelbase + self.front_hang

    @property
    def size(self) -> float:
        """How many times as long as the default car it is."""
        return self.length / Vehicle().length

    @property
    def turning_radius(self) -> float:
        """Smallest radius the rear axle's middle can follow [m]."""
        return self.wheelbase / math.tan(self.phi_max)

    @property
    def corners(self) -> np.ndarray:
        """Corners in the body frame, counter-clockwise from rear right: (4, 2) [m]."""
        rear, front, half = -self.rear_hang, self.wheelbase + self.front_hang, self.width / 2
        return np.array([[rear, -half], [front, -half], [front, half], [rear, half]])

    def footprints(self, poses: np.ndarray) -> np.ndarray:
        """Corners of the car at each pose.

        Args:
            poses: (N, 3) x, y, theta [m, m, rad].

        Returns:
            (N, 4, 2) corners, counter-clockwise from rear right [m].
        """
        poses = np.asarray(poses, dtype=float).reshape(-1, 3)
        cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        rotation = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)  # (N, 2, 2)
        return poses[:, None, :2] + self.corners @ rotation.transpose(0, 2, 1)

    def rates(self, states: np.ndarray, inputs: np.ndarray) -> np.ndarray:
        """Time derivatives of the states by the bicycle model.

        Args:
            states: (..., 5) x, y, theta, v, phi [m, m, rad, m/s, rad].
            inputs: (..., 2) a, w [m/s^2, rad/s].

        Returns:
            (..., 5) per second.
        """
        theta, v, phi = states[..., State.THETA], states[..., State.V], states[..., State.PHI]
        pose_rates = [v * np.cos(theta), v * np.sin(theta), v * np.tan(phi) / self.wheelbase]
        return np.stack([*pose_rates, inputs[..., Input.A], inputs[..., Input.W]], axis=-1)

    def pose_rates(self, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The rates of x, y and theta, and their derivatives; those of v and phi are the inputs.

        Args:
            states: (N, 5) x, y, theta, v, phi [m, m, rad, m/s, rad].

        Returns:
            (N, 3) per second, and (N, 3, 5) with respect to the states.
        """
        theta, v, phi = states[:, State.THETA], states[:, State.V], states[:, State.PHI]
        cos, sin, tan = np.cos(theta), np.sin(theta), np.tan(phi)
        rates = np.empty((len(states), 3))
        rates[:, State.X], rates[:, State.Y], rates[:, State.THETA] = v * cos, v * sin, v * tan / self.wheelbase
        jacobian = np.zeros((len(states), 3, len(State)))
        jacobian[:, State.X, State.THETA], jacobian[:, State.X, State.V] = -rates[:, State.Y], cos
        jacobian[:, State.Y, State.THETA], jacobian[:, State.Y, State.V] = rates[:, State.X], sin
        jacobian[:, State.THETA, State.V] = tan / self.wheelbase
        jacobian[:, State.THETA, State.PHI] = v * (1 + tan**2) / self.wheelbase
        return rates, jacobian
