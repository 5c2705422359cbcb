"""A plan as messages of ROS 2 in one MCAP file, for Foxglove, RViz (`ros2 bag play plan.mcap`) and scripts.

    /plan   nav_msgs/Path                     the poses of all rows, each with its time
    /tf     tf2_msgs/TFMessage                map -> base_link (middle of the rear axle), one for every row
    /cmd    geometry_msgs/TwistStamped        speed and yaw rate in base_link, one for every row
    /scene  visualization_msgs/MarkerArray    obstacles, bounds, start, goal, footprints, and the car in base_link
    /start, /goal (that is reached)  geometry_msgs/PoseStamped

What does not change is written once, at the beginning, and offered to those who come later (transient local). The clock
begins at 1 s: ROS reads the time 0 as "the latest". Types are those of ROS 2 Humble, which later ones read as well.
The extra `ros` installs rosbags, which serialises them without ROS.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely

from drake_gnnocp.pictures import style
from drake_gnnocp.pictures.meshes import prism
from drake_gnnocp.pictures.scene import goal_poses, relative_bounds
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import State, Vehicle

FRAME, CAR_FRAME = "map", "base_link"
BEGIN = 1.0  # s, time of the first row
WALL_HEIGHT, CAR_HEIGHT, PAINT = 1.0, 1.5, 0.08  # m, the last is the width of lines
FOOTPRINTS = 40  # at most, along the plan
HUMBLE: Final = 8  # version of the bags that it and all later ones read
ONCE = ("/plan", "/scene", "/start", "/goal")


class RosUnavailable(ValueError):
    """The library that writes the messages is not installed."""


def check_available() -> None:
    """See that messages can be written.

    Raises:
        RosUnavailable: they cannot; the message says what to install.
    """
    if find_spec("rosbags") is None:
        raise RosUnavailable("--format: mcap needs rosbags, which is not installed: pip install -e .[ros]")


def save_mcap(path: Path, scenario: Scenario, trajectory: Trajectory) -> None:
    """Write a plan as an MCAP file; see the module.

    Args:
        path: where to, a file with the suffix .mcap.
        scenario: obstacles, bounds, start, goal and car.
        trajectory: in the scenario's frame.

    Raises:
        RosUnavailable: rosbags is not installed.
        OSError: the file could not be written.
    """
    check_available()
    from rosbags.interfaces import QosDurability
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    messages = sorted(_Messages(store.types, scenario, trajectory).all(), key=lambda message: message[0])
    with tempfile.TemporaryDirectory(prefix=".tmp", dir=path.parent) as folder:
        bag = Path(folder) / path.stem  # a bag is a folder, its messages are one file in it
        with Writer(bag, version=HUMBLE, storage_plugin=StoragePlugin.MCAP) as writer:
            topics: dict[str, Any] = {}
            for time, topic, message in messages:
                if topic not in topics:
                    durability = QosDurability.TRANSIENT_LOCAL if topic in ONCE else QosDurability.VOLATILE
                    offered = [_quality(durability)]
                    kind = message.__msgtype__
                    topics[topic] = writer.add_connection(topic, kind, typestore=store, offered_qos_profiles=offered)
                writer.write(topics[topic], _nanoseconds(time), store.serialize_cdr(message, message.__msgtype__))
        (written,) = bag.glob("*.mcap")
        written.replace(path)


def _quality(durability: Any) -> Any:
    from rosbags.interfaces import Qos, QosHistory, QosLiveliness, QosReliability, QosTime

    never, automatic = QosTime(2147483647, 4294967295), QosLiveliness.AUTOMATIC
    return Qos(QosHistory.KEEP_LAST, 10, QosReliability.RELIABLE, durability, never, never, automatic, never, False)


def _nanoseconds(time: float) -> int:
    return round((BEGIN + time) * 1e9)


class _Messages:
    """Makes the messages of a plan from the classes of a store of types, by their names."""

    def __init__(self, types: dict[str, Any], scenario: Scenario, trajectory: Trajectory) -> None:
        self._types, self._scenario, self._trajectory = types, scenario, trajectory
        self._times = trajectory.t - trajectory.t[0]
        poses, reached = goal_poses(scenario, trajectory)
        self._goal = poses[reached or 0]

    def all(self) -> Iterator[tuple[float, str, Any]]:
        """Time since the beginning [s], topic and message."""
        poses, vehicle = self._trajectory.poses, self._scenario.vehicle
        stamped = [self._stamped_pose(t, pose) for t, pose in zip(self._times, poses, strict=True)]
        yield 0.0, "/plan", self._make("nav_msgs/msg/Path", header=self._header(0.0), poses=stamped)
        yield 0.0, "/scene", self._make("visualization_msgs/msg/MarkerArray", markers=list(self._markers()))
        yield 0.0, "/start", self._stamped_pose(0.0, self._scenario.start)
        yield 0.0, "/goal", self._stamped_pose(0.0, self._goal)
        for t, state in zip(self._times, self._trajectory.states, strict=True):
            yield t, "/tf", self._make("tf2_msgs/msg/TFMessage", transforms=[self._transform(t, state)])
            yield t, "/cmd", self._command(t, state, vehicle)

    def _make(self, kind: str, **fields: Any) -> Any:
        return self._types[kind](**fields)

    def _header(self, time: float, frame: str = FRAME) -> Any:
        seconds, rest = divmod(_nanoseconds(time), 10**9)
        stamp = self._make("builtin_interfaces/msg/Time", sec=seconds, nanosec=rest)
        return self._make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def _vector(self, x: float, y: float, z: float) -> Any:
        return self._make("geometry_msgs/msg/Vector3", x=float(x), y=float(y), z=float(z))

    def _point(self, x: float, y: float, z: float) -> Any:
        return self._make("geometry_msgs/msg/Point", x=float(x), y=float(y), z=float(z))

    def _turned(self, theta: float) -> Any:
        """The quaternion of a heading."""
        half = theta / 2
        return self._make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=math.sin(half), w=math.cos(half))

    def _pose(self, x: float, y: float, theta: float, z: float = 0.0) -> Any:
        return self._make("geometry_msgs/msg/Pose", position=self._point(x, y, z), orientation=self._turned(theta))

    def _stamped_pose(self, time: float, pose: np.ndarray) -> Any:
        return self._make("geometry_msgs/msg/PoseStamped", header=self._header(time), pose=self._pose(*pose))

    def _transform(self, time: float, state: np.ndarray) -> Any:
        x, y, theta = state[: State.V]
        moved = self._make(
            "geometry_msgs/msg/Transform", translation=self._vector(x, y, 0.0), rotation=self._turned(theta)
        )
        kind, header = "geometry_msgs/msg/TransformStamped", self._header(time)
        return self._make(kind, header=header, child_frame_id=CAR_FRAME, transform=moved)

    def _command(self, time: float, state: np.ndarray, vehicle: Vehicle) -> Any:
        v, phi = state[State.V], state[State.PHI]
        turn = v * math.tan(phi) / vehicle.wheelbase
        twist = self._make(
            "geometry_msgs/msg/Twist", linear=self._vector(v, 0.0, 0.0), angular=self._vector(0.0, 0.0, turn)
        )
        return self._make("geometry_msgs/msg/TwistStamped", header=self._header(time, CAR_FRAME), twist=twist)

    def _markers(self) -> Iterator[Any]:
        scenario, vehicle, kind = self._scenario, self._scenario.vehicle, self._types["visualization_msgs/msg/Marker"]
        if len(things := scenario.shapes.things):
            vertices, faces = prism(things, 0.0, WALL_HEIGHT)
            walls = vertices.T[faces.T.ravel()]
            yield self._marker("obstacles", 0, kind.TRIANGLE_LIST, style.OBSTACLE, 1.0, walls)
        if (bounds := relative_bounds(scenario, np.zeros(2))) is not None:
            corners = shapely.get_coordinates(bounds)
            yield self._marker("bounds", 0, kind.LINE_STRIP, style.LIMIT, 1.0, _on_ground(corners))
        for name, pose, color in (("start", scenario.start, style.START), ("goal", self._goal, style.GOAL)):
            rectangle = vehicle.footprints(pose)[0][[0, 1, 2, 3, 0]]
            yield self._marker(name, 0, kind.LINE_STRIP, color, 1.0, _on_ground(rectangle))
        shown = np.unique(np.linspace(0, len(self._trajectory) - 1, FOOTPRINTS).astype(int))
        edges = vehicle.footprints(self._trajectory.poses[shown])[:, [0, 1, 1, 2, 2, 3, 3, 0]].reshape(-1, 2)
        yield self._marker("footprints", 0, kind.LINE_LIST, style.SWEPT, 0.6, _on_ground(edges))
        yield self._car(kind)

    def _marker(self, name: str, number: int, shape: int, color: str, opacity: float, points: np.ndarray) -> Any:
        scale = (1.0, 1.0, 1.0) if shape == self._types["visualization_msgs/msg/Marker"].TRIANGLE_LIST else (PAINT,) * 3
        corners = [self._point(*point) for point in points]
        return self._drawn(FRAME, name, number, shape, self._pose(0.0, 0.0, 0.0), scale, (color, opacity), corners)

    def _car(self, kind: Any) -> Any:
        """A box that goes with base_link."""
        vehicle = self._scenario.vehicle
        ahead = (vehicle.wheelbase + vehicle.front_hang - vehicle.rear_hang) / 2
        pose, size = self._pose(ahead, 0.0, 0.0, CAR_HEIGHT / 2), (vehicle.length, vehicle.width, CAR_HEIGHT)
        return self._drawn(CAR_FRAME, "car", 0, kind.CUBE, pose, size, (style.PLAN, 0.8), [])

    def _drawn(
        self,
        frame: str,
        name: str,
        number: int,
        shape: int,
        pose: Any,
        scale: tuple[float, float, float],
        look: tuple[str, float],
        points: list[Any],
    ) -> Any:
        color, opacity = look
        red, green, blue = (int(color[i : i + 2], 16) / 255 for i in (1, 3, 5))
        header = self._header(0.0, frame)
        compressed = self._make("sensor_msgs/msg/CompressedImage", header=header, format="", data=np.zeros(0, np.uint8))
        nothing = np.zeros(0, np.uint8)
        return self._make(
            "visualization_msgs/msg/Marker",
            header=header,
            ns=name,
            id=number,
            type=shape,
            action=0,  # add
            pose=pose,
            scale=self._vector(*scale),
            color=self._make("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=opacity),
            lifetime=self._make("builtin_interfaces/msg/Duration", sec=0, nanosec=0),  # for ever
            frame_locked=True,
            points=points,
            colors=[],
            texture_resource="",
            texture=compressed,
            uv_coordinates=[],
            text="",
            mesh_resource="",
            mesh_file=self._make("visualization_msgs/msg/MeshFile", filename="", data=nothing),
            mesh_use_embedded_materials=False,
        )


def _on_ground(points: np.ndarray) -> np.ndarray:
    return np.column_stack([points, np.full(len(points), PAINT / 2)])
