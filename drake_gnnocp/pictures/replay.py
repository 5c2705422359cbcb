"""The replay: a scene in three dimensions in which the car drives the plan in real time, as one HTML file.

Drake's Meshcat renders it with WebGL; the file carries the program and the scene and opens without server or network.
The scene's frame is the scenario's, moved so that the middle of the map is at zero (see `scene`; the sun looks there).
Its unit is that in which the car is as long as the default one: what stands around a small robot is low, too.
All obstacles are one mesh: Meshcat takes seconds to load thousands of objects.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from html import escape
from pathlib import Path

import numpy as np
import shapely
from pydrake.geometry import Box, Meshcat, MeshcatAnimation, MeshcatParams, Rgba
from pydrake.math import RigidTransform

from drake_gnnocp.drake_log import drake_lines
from drake_gnnocp.files import write_atomically
from drake_gnnocp.pictures.car_model import add_car, animate_car, place_car
from drake_gnnocp.pictures.meshes import prism
from drake_gnnocp.pictures.scene import extent, goal_poses, relative_bounds
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import Vehicle

FRAMES_PER_SECOND = 30.0
PAUSE = 1.0  # s, the car rests at the goal before the replay starts again
REPETITIONS = 10_000  # Meshcat has no endless loop
WALL_HEIGHT = 1.0  # m, lower than the car, so that it is seen behind obstacles
THIN = 0.03  # m, half the thickness that lines and points are shown with
KERB = 0.15  # m, width and height of the bounds
STROKE = 0.12  # m, width of the lines on the ground: WebGL's own lines are one pixel wide
PATH_HEIGHT, OUTLINE_HEIGHT = 0.03, 0.02  # m, thickness of the paint: the path covers the outlines
GRID, MOST_LINES = 5.0, 200  # m, between the lines on the ground, or more so that there are no more than this many
FIELD_OF_VIEW = 35.0  # degree, of the camera, upright
ELEVATION = math.radians(58.0)  # of the camera above the ground
ASPECT = 1.4  # width over height of the window the camera is set for: a narrow one; wider windows show more
PANEL_WIDTH = 200  # pixels, of the controls
SUN = np.array([-0.5, -0.35, 1.0])  # the direction the light comes from

GROUND = Rgba(0.88, 0.88, 0.87)
GRID_LINE = Rgba(0.72, 0.72, 0.71)
WALL = Rgba(0.50, 0.50, 0.52)
WALL_EDGE = Rgba(0.2, 0.2, 0.2)
PATH = Rgba(0.0, 0.45, 0.70)
START = Rgba(0.0, 0.62, 0.45)
GOAL = Rgba(0.80, 0.40, 0.65)
FAINT_GOAL = Rgba(0.86, 0.76, 0.81)

# The panel with the play button and the time slider opens beside the scene, not over it, without the long list of the
# scene's parts. In windows narrower than the camera was set for, zooming out keeps the sides in view.
OPEN_CONTROLS = f"""<script>
addEventListener("load", () => {{
  const fit = () => {{
    viewer.set_3d_pane_size();
    viewer.camera.zoom = Math.min(1, viewer.camera.aspect / {ASPECT});
    viewer.camera.updateProjectionMatrix();
    viewer.set_dirty?.();
  }};
  if (viewer.gui) {{
    viewer.gui.__folders?.Scene?.close();
    viewer.gui.width = {PANEL_WIDTH};
    viewer.gui.open();
    viewer.dom_element.style.width = "calc(100% - {PANEL_WIDTH}px)";
  }}
  addEventListener("resize", fit);
  fit();
}});
</script>
</body>"""


def save_replay(path: Path | str, scenario: Scenario, trajectory: Trajectory | None) -> None:
    """Write the replay of a plan as one HTML file of about 3 MB, most of it Meshcat itself.

    Args:
        path: where to.
        scenario: obstacles, bounds, start and goal.
        trajectory: what the car drives, None where nothing was found: it then stands at the start.
    """
    box = extent(scenario, (trajectory,), scenario.start[:2])
    x, y = -(scenario.start[:2] + box.mean(axis=0))
    scene = scenario.translated(x, y).in_car_lengths
    half_size, vehicle = (box[1] - box[0]) / (2 * scene.unit), scene.vehicle
    with _meshcat() as meshcat:
        _add_ground(meshcat, half_size)
        _add_obstacles(meshcat, scene)
        _add_outline(meshcat, "start", vehicle, scene.start, START)
        poses, reached = goal_poses(scenario, trajectory)
        for i, pose in enumerate((poses + (x, y, 0.0)) / (scene.unit, scene.unit, 1.0)):
            name, color = ("goal", GOAL) if reached == i or len(poses) == 1 else (f"goals/{i}", FAINT_GOAL)
            _add_outline(meshcat, name, vehicle, pose, color)
        add_car(meshcat, vehicle)
        place_car(meshcat, scene.start)
        if trajectory is not None:
            _add_motion(meshcat, vehicle, trajectory.translated(x, y).scaled(1 / scene.unit))
        _set_lights(meshcat, half_size)
        _set_camera(meshcat, half_size)
        html = meshcat.StaticHtml()
    html = html.replace("<title>Drake MeshCat</title>", f"<title>{escape(scenario.name)}: replay</title>", 1)
    if trajectory is not None:
        head, _, tail = html.rpartition("</body>")
        html = head + OPEN_CONTROLS + tail
    write_atomically(Path(path), html)


@contextmanager
def _meshcat() -> Iterator[Meshcat]:
    """A Meshcat of our own, closed with its last reference; it is a server, though nobody connects to it."""
    with drake_lines():  # it announces its address
        meshcat = Meshcat(MeshcatParams(host="localhost", port=0, show_stats_plot=False))  # 0: any free port
    meshcat.SetProperty("/Grid", "visible", False)
    meshcat.SetProperty("/Axes", "visible", False)
    meshcat.SetProperty("/Background/<object>", "top_color", [0.93, 0.96, 1.0])
    meshcat.SetProperty("/Background/<object>", "bottom_color", [1.0, 1.0, 1.0])
    yield meshcat


def _paint(meshcat: Meshcat, path: str, shape: shapely.Geometry, height: float, color: Rgba) -> None:
    """Extrude polygons from the ground to a height; rounding may leave loose lines in a union, which have no area."""
    parts = shapely.get_parts(shape)
    polygons = parts[shapely.get_type_id(parts) == shapely.GeometryType.POLYGON]
    if len(polygons):
        meshcat.SetTriangleMesh(path, *prism(polygons, 0.0, height), rgba=color)


def _plate_size(half_size: np.ndarray) -> np.ndarray:
    """Half the size (2,) of the ground: whole grid cells, with some room around the scene [m]."""
    grid = _grid(half_size)
    return grid * np.ceil(half_size / grid + 0.6)


def _grid(half_size: np.ndarray) -> float:
    """Between the lines on the ground [m]: more on a large one."""
    return GRID * max(1, math.ceil(2 * float(half_size.max()) / (GRID * MOST_LINES)))


def _add_ground(meshcat: Meshcat, half_size: np.ndarray) -> None:
    east, north = _plate_size(half_size)
    meshcat.SetObject("ground/plate", Box(2 * east, 2 * north, 0.1), GROUND)
    meshcat.SetTransform("ground/plate", RigidTransform([0.0, 0.0, -0.06]))
    grid = _grid(half_size)
    x, y = np.arange(-east, east + grid / 2, grid), np.arange(-north, north + grid / 2, grid)
    begin = [[a, -north, 0.0] for a in x] + [[-east, b, 0.0] for b in y]
    end = [[a, north, 0.0] for a in x] + [[east, b, 0.0] for b in y]
    meshcat.SetLineSegments("ground/grid", np.transpose(begin), np.transpose(end), 1.0, GRID_LINE)


def _add_obstacles(meshcat: Meshcat, scenario: Scenario) -> None:
    """The obstacles as walls with a dark upper edge, and the bounds as a kerb just outside of them."""
    shapes = scenario.shapes
    walls = np.append(shapes.polygons, shapely.get_parts(shapely.buffer(shapes.lines, THIN, quad_segs=2)))
    _paint(meshcat, "obstacles/walls", walls, WALL_HEIGHT, WALL)
    if len(walls):
        points, ring = shapely.get_coordinates(shapely.get_rings(walls), return_index=True)
        edge = np.column_stack([points, np.full(len(points), WALL_HEIGHT + 0.01)]).T
        follows = ring[1:] == ring[:-1]
        meshcat.SetLineSegments("obstacles/edges", edge[:, :-1][:, follows], edge[:, 1:][:, follows], 1.0, WALL_EDGE)
    if (bounds := relative_bounds(scenario, np.zeros(2))) is not None:
        kerb = bounds.buffer(KERB, join_style="mitre") - bounds  # far away, rounding may leave none
        _paint(meshcat, "bounds", kerb, KERB, WALL_EDGE)


def _add_outline(meshcat: Meshcat, name: str, vehicle: Vehicle, pose: np.ndarray, color: Rgba) -> None:
    """The car's rectangle on the ground, with an arrowhead at the front; a disc where its heading is free."""
    if math.isnan(pose[2]):
        _paint(meshcat, name, shapely.Point(pose[:2]).buffer(vehicle.width / 2), OUTLINE_HEIGHT, color)
        return
    rear_right, front_right, front_left, rear_left = vehicle.footprints(pose)[0]
    car = shapely.Polygon([rear_right, front_right, front_left, rear_left])
    nose, back = (front_right + front_left) / 2, 0.2 * (rear_right - front_right)
    arrow = shapely.Polygon([nose, front_left + back, front_right + back])
    frame = car - car.buffer(-STROKE, join_style="mitre")
    _paint(meshcat, name, shapely.union(frame, arrow), OUTLINE_HEIGHT, color)


def _add_motion(meshcat: Meshcat, vehicle: Vehicle, trajectory: Trajectory) -> None:
    """The driven path, and the animation: linear between the knots, as many frames as keep real time."""
    line = shapely.LineString(trajectory.poses[:, :2])
    _paint(meshcat, "path", line.buffer(STROKE / 2, quad_segs=2), PATH_HEIGHT, PATH)
    frames = trajectory.resampled(max(2, round(trajectory.duration * FRAMES_PER_SECOND) + 1))
    rate = (len(frames) - 1) / trajectory.duration
    animation = MeshcatAnimation(frames_per_second=rate)
    animation.set_autoplay(True)
    animation.set_loop_mode(MeshcatAnimation.LoopMode.kLoopRepeat)
    animation.set_repetitions(REPETITIONS)
    animate_car(animation, vehicle, frames, hold=round(PAUSE * rate))
    meshcat.SetAnimation(animation)


def _set_lights(meshcat: Meshcat, half_size: np.ndarray) -> None:
    """A sun that casts shadows, and light from everywhere; Meshcat's own lamps reach only a few metres."""
    radius = float(np.linalg.norm(_plate_size(half_size)))
    distance = 3 * radius
    for lamp in ("PointLightNegativeX", "PointLightPositiveX", "FillLight"):
        meshcat.SetProperty(f"/Lights/{lamp}", "visible", False)
    meshcat.SetProperty("/Lights/AmbientLight/<object>", "intensity", 1.5)
    meshcat.SetProperty("/Lights/SpotLight", "visible", True)
    sun = "/Lights/SpotLight/<object>"  # it looks at zero
    meshcat.SetProperty(sun, "position", list(distance * SUN / np.linalg.norm(SUN)))
    meshcat.SetProperty(sun, "castShadow", True)
    for name, value in (
        ("intensity", 3.0),
        ("decay", 0.0),  # with distance
        ("angle", 1.1 * math.atan2(radius, distance)),
        ("shadow.mapSize.width", 4096.0),
        ("shadow.mapSize.height", 4096.0),
        ("shadow.normalBias", 0.03),  # m, against a hatching of faces the light grazes
        ("shadow.camera.near", distance - 1.2 * radius),
        ("shadow.camera.far", distance + 1.2 * radius),
    ):
        meshcat.SetProperty(sun, name, value)


def _set_camera(meshcat: Meshcat, half_size: np.ndarray) -> None:
    """Look from the south, obliquely down, from just as far as shows the whole scene."""
    back = np.array([0.0, -math.cos(ELEVATION), math.sin(ELEVATION)])
    up = np.array([0.0, math.sin(ELEVATION), math.cos(ELEVATION)])
    (east, north), slope = half_size, math.tan(math.radians(FIELD_OF_VIEW) / 2)
    corners = np.array([[x, y, z] for x in (-east, east) for y in (-north, north) for z in (0.0, WALL_HEIGHT)])
    target, distance = np.zeros(3), 1.0
    for _ in range(10):  # far things look smaller: move the target until the rims above and below are equal
        seen = corners - target
        # a corner is in view when its offset across is at most slope (distance - depth)
        needed = np.maximum(np.abs(seen @ up), np.abs(seen[:, 0]) / ASPECT) / slope + seen @ back
        distance = 1.08 * float(needed.max())
        heights = (seen @ up) / (distance - seen @ back)
        target[1] += distance * (heights.min() + heights.max()) / 2
    camera = Meshcat.PerspectiveCamera(fov=FIELD_OF_VIEW, aspect=ASPECT, near=distance / 20, far=10 * distance)
    meshcat.SetCamera(camera)
    meshcat.SetCameraPose(target + distance * back, target)
