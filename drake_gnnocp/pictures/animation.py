"""The plan as a short film: the car drives it on the map, as a GIF that repeats or as MP4.

A plan of more than LONGEST seconds is shown faster than it is, and the title says how much. The map is drawn once; for
every frame only the car and the way behind it are drawn on a copy of it.
"""

from __future__ import annotations

import math
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.patches import Polygon
from PIL import Image

from drake_gnnocp.pictures import style
from drake_gnnocp.pictures.map_plot import draw_map, map_size
from drake_gnnocp.pictures.scene import readable_origin, relative_poses
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import State, Vehicle
from drake_gnnocp.verification import Finding

LONGEST, PAUSE = 9.0, 1.0  # s, of the film: the drive at most, and the rest at the goal
GIF_RATE, MP4_RATE = 12.5, 25.0  # frames a second; players of GIFs know hundredths of a second only
GIF_DPI, MP4_DPI = 88, 110
GIF_COLOURS = 128
WHEEL = np.array([0.7, 0.24])  # m, length and width, of a car of the default length
CLOCK = "{:6.1f} s\n{:6.2f} m/s"
DRIVEN = "#003F63"  # the plan's blue, darker: the way behind the car
MOVING = 10  # zorder of what is drawn for every frame
CAR: dict[str, Any] = {"fc": (*to_rgb(style.PLAN), 0.85), "ec": DRIVEN, "lw": 1.4, "zorder": MOVING + 1}


class FilmUnavailable(ValueError):
    """What makes films of a kind is not there."""


def check_mp4() -> None:
    """See that films can be written as MP4.

    Raises:
        FilmUnavailable: there is no ffmpeg.
    """
    if shutil.which("ffmpeg") is None:
        raise FilmUnavailable("--mp4: needs ffmpeg on the PATH; --gif needs nothing")


def save_gif(
    path: Path | str, scenario: Scenario, trajectory: Trajectory, title: str | None = None, fault: Finding | None = None
) -> None:
    """Write the film of a plan as a GIF that repeats, of less than 2 MB for maps of usual size."""
    frames = _frames(scenario, trajectory, title, fault, GIF_RATE, GIF_DPI)
    pictures = [Image.fromarray(frame) for frame in frames]
    # one palette for all, made of the first and the last picture: what does not move keeps its colours
    width, height = pictures[0].size
    both = Image.new("RGB", (width, 2 * height))
    both.paste(pictures[0], (0, 0))
    both.paste(pictures[-1], (0, height))
    palette = both.quantize(GIF_COLOURS, dither=Image.Dither.NONE)
    small = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    shown = [1000 / GIF_RATE] * (len(small) - 1) + [1000 * PAUSE]
    path = Path(path)
    with style.beside(path) as temporary:
        small[0].save(temporary, "gif", save_all=True, append_images=small[1:], duration=shown, loop=0, disposal=1)


def save_mp4(
    path: Path | str, scenario: Scenario, trajectory: Trajectory, title: str | None = None, fault: Finding | None = None
) -> None:
    """Write the film of a plan as MP4 (H.264), by ffmpeg.

    Raises:
        FilmUnavailable: there is no ffmpeg.
        OSError: it fails; the message has its last line.
    """
    check_mp4()
    frames = list(_frames(scenario, trajectory, title, fault, MP4_RATE, MP4_DPI))
    frames += [frames[-1]] * round(PAUSE * MP4_RATE)
    height, width = (size // 2 * 2 for size in frames[0].shape[:2])  # the format wants even sizes
    given = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{MP4_RATE:g}", "-i", "-"]
    coded = ["-c:v", "libx264", "-preset", "veryfast", "-crf", "23", "-pix_fmt", "yuv420p"]
    made = [*coded, "-movflags", "+faststart", "-f", "mp4"]
    with style.beside(Path(path)) as temporary:
        command = ["ffmpeg", "-loglevel", "error", "-y", *given, *made, str(temporary)]
        pixels = b"".join(np.ascontiguousarray(frame[:height, :width]).tobytes() for frame in frames)
        done = subprocess.run(command, input=pixels, capture_output=True, check=False)
        if done.returncode != 0:
            said = done.stderr.decode(errors="replace").strip().splitlines()
            raise OSError(f"ffmpeg: {said[-1] if said else done.returncode}")


def _frames(
    scenario: Scenario, trajectory: Trajectory, title: str | None, fault: Finding | None, rate: float, dpi: float
) -> Iterator[np.ndarray]:
    """Pictures (height, width, 3) of bytes, one after the other; each is drawn on a copy of the map."""
    speed = max(1.0, trajectory.duration / LONGEST)
    n = max(2, math.ceil(trajectory.duration / speed * rate) + 1)
    origin = readable_origin(scenario)
    driven = trajectory.resampled(n)
    poses, steering = relative_poses(driven.poses, origin), driven.column(State.PHI)
    figure = style.new_figure(*map_size(scenario, (trajectory,)))
    figure.set_layout_engine("constrained")
    figure.set_dpi(dpi)
    canvas, ax = FigureCanvasAgg(figure), figure.add_subplot()
    faster = f", {speed:.1f} times as fast" if speed > 1 else ""
    title = f"{title or scenario.name}{faster}"
    draw_map(ax, scenario, trajectory, None, title, fault, footprints=False)
    (way,) = ax.plot([], [], color=DRIVEN, linewidth=2.8, zorder=MOVING, animated=True)
    parts = [Polygon(np.zeros((3, 2)), animated=True, **look) for look in _looks()]
    for part in parts:
        ax.add_patch(part)
    look: dict[str, Any] = {"va": "bottom", "family": "monospace", "fontsize": style.LABEL_SIZE}
    clock = ax.text(1.02, 0.0, CLOCK.format(0, 0), transform=ax.transAxes, animated=True, **look)  # below the legend
    canvas.draw()
    background = canvas.copy_from_bbox(figure.bbox)
    for k in range(n):
        canvas.restore_region(background)
        way.set_data(poses[: k + 1, 0], poses[: k + 1, 1])
        for part, outline in zip(parts, _outlines(scenario.vehicle, poses[k], steering[k]), strict=True):
            part.set_xy(outline)
        clock.set_text(CLOCK.format(driven.t[k] - driven.t[0], driven.states[k, State.V]))
        for artist in (way, *parts, clock):
            ax.draw_artist(artist)
        yield np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _looks() -> list[dict[str, Any]]:
    """Of the four wheels, the body and the windscreen."""
    wheel = {"fc": "#222222", "ec": "none", "zorder": MOVING + 0.5}
    return [wheel] * 4 + [CAR, {"fc": "white", "ec": "none", "alpha": 0.8, "zorder": MOVING + 2}]


def _outlines(vehicle: Vehicle, pose: np.ndarray, phi: float) -> list[np.ndarray]:
    """Outlines (N, 2) of the wheels (the front ones steered), the body and the windscreen [m]."""
    side, wheel = vehicle.width / 2, WHEEL * vehicle.size
    wheels = []
    for x, angle in ((0.0, 0.0), (vehicle.wheelbase, phi)):
        for y in (-side, side):
            turned = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
            wheels.append(np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * wheel / 2 @ turned.T + [x, y])
    front = vehicle.wheelbase
    screen = np.array([[0.62 * front, -0.82 * side], [0.9 * front, -0.7 * side], [0.9 * front, 0.7 * side]])
    screen = np.vstack([screen, [0.62 * front, 0.82 * side]])
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    placed = np.array([[cos, -sin], [sin, cos]])
    return [outline @ placed.T + pose[:2] for outline in (*wheels, vehicle.corners, screen)]
