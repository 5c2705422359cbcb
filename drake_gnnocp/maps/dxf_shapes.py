"""Entities of a DXF drawing as obstacles. What is closed is solid, what is open is a line; heights are left out.

Closed curves become polygons that cover what they enclose, and are at most FLATTENING larger (see `curves`); open ones
become chords at most that far from them. Hatches with curves are grown by another 0.03 % of their size.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
import shapely

from drake_gnnocp.maps.curves import (
    FLATTENING,
    polyline_along,
    polyline_along_ellipse,
    ring_around,
    ring_around_ellipse,
)
from drake_gnnocp.maps.drawing import Drawing, Points

LARGEST = 1e12  # m
LARGEST_CURVE = 1e4  # m, of a spline or a hatch with curves
MOST_POINTS = 20_000  # of a spline
CLOSED = 1e-6  # m, an open polyline whose ends are this near is closed
FULL_TURN = 2 * math.pi - 1e-9  # rad
FLAT = 1 - 1e-9  # of an extrusion's z: the entity lies in the plane of the drawing
BEZIER = 3e-4  # of the size of a hatch: an arc of a quarter and the cubic that stands for it differ by 2.7e-4 radii
IN_OWN_PLANE = {"LWPOLYLINE", "CIRCLE", "ARC", "SOLID", "TRACE", "HATCH", "MPOLYGON", "INSERT"}
TEXT_BOX, ALL_FILLED = 8, 2  # flag of a path around a hatch's text; style of a hatch without holes


class Outline(NamedTuple):
    """A polyline with arcs."""

    vertices: np.ndarray  # (N, 3) x, y [m], and the bulge of the arc to the next vertex
    is_closed: bool
    width: float = 0.0  # m, of the line


def add_shape(drawing: Drawing, entity: Any, scale: float, where: str) -> bool:
    """Add an entity as an obstacle.

    Args:
        drawing: is added to.
        entity: of ezdxf.
        scale: m per unit of the drawing.
        where: names the entity in an error.

    Returns:
        Whether it is of a kind that can be one.

    Raises:
        ValueError: it is of such a kind, but has no place in a plane, is too large or crosses itself.
    """
    kind = entity.dxftype()
    if kind == "POINT":
        drawing.points.append(plane(entity.dxf.location, scale))
    elif kind in ELLIPSES and (axes := axes_of(entity, scale)) is not None:
        drawing.add_area(ring_around_ellipse(*axes), [], where)
    elif kind == "ELLIPSE":
        drawing.lines.append(_partial_ellipse(entity, scale))
    elif kind == "SPLINE":
        _add_spline(drawing, entity, scale, where)
    elif kind in ("HATCH", "MPOLYGON"):
        _add_region(drawing, _hatched(entity, scale), where)
    elif (outline := outline_of(entity, scale)) is not None:
        _add_outline(drawing, outline, where)
    else:
        return False
    return True


def outline_of(entity: Any, scale: float) -> Outline | None:
    """An entity of straight lines and arcs as a polyline; None for other kinds."""
    read = OUTLINES.get(entity.dxftype())
    if read is None:
        return None
    _check_flat(entity)
    outline = read(entity, scale)
    if outline is None or outline.is_closed or len(outline.vertices) < 4:
        return outline
    if math.dist(outline.vertices[0, :2], outline.vertices[-1, :2]) <= CLOSED:
        return outline._replace(vertices=outline.vertices[:-1], is_closed=True)
    return outline


def axes_of(entity: Any, scale: float) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Centre and two half axes (2,) each [m] of a circle or of a whole ellipse; None for a part of one."""
    _check_flat(entity)
    if entity.dxftype() == "CIRCLE":
        r = abs(entity.dxf.radius) * scale
        return np.array(plane(entity.ocs().to_wcs(entity.dxf.center), scale)), np.array([r, 0.0]), np.array([0.0, r])
    if _turn(entity.dxf.start_param, entity.dxf.end_param) < FULL_TURN:
        return None
    return _axes(entity, scale)


def plane(point: Any, scale: float) -> list[float]:
    """A point of ezdxf in the plane [m]."""
    x, y = point.x * scale, point.y * scale
    if not (abs(x) <= LARGEST and abs(y) <= LARGEST):  # NaN as well
        raise ValueError(f"has a coordinate that is not finite or beyond {LARGEST:g} m")
    return [x, y]


def _check_flat(entity: Any) -> None:
    has_plane = entity.dxftype() in IN_OWN_PLANE or (entity.dxftype() == "POLYLINE" and entity.is_2d_polyline)
    if has_plane and not abs(entity.dxf.extrusion.z) >= FLAT * entity.dxf.extrusion.magnitude:
        raise ValueError("lies in a tilted plane: put it on a layer that is off or begins with IGNORE")


def _turn(begin: float, end: float) -> float:
    """The angle from one direction to another, counter-clockwise, in (0, 2 pi] [rad]."""
    if abs(end - begin) >= FULL_TURN:
        return 2 * math.pi
    return (end - begin) % (2 * math.pi) or 2 * math.pi


def _line(entity: Any, scale: float) -> Outline:
    ends = [plane(entity.dxf.start, scale), plane(entity.dxf.end, scale)]
    return Outline(np.column_stack([ends, np.zeros(2)]), is_closed=False)


def _arc(entity: Any, scale: float) -> Outline:
    begin = math.radians(entity.dxf.start_angle)
    angle = _turn(begin, math.radians(entity.dxf.end_angle))
    centre, r = entity.dxf.center, abs(entity.dxf.radius)
    at = [begin, begin + 0.5 * angle, begin + angle]  # in halves: one arc of a full turn has no bulge
    points = [centre + type(centre)(r * math.cos(a), r * math.sin(a)) for a in at]
    return _with_bulges(entity, points, np.full(3, math.tan(angle / 8)), scale, is_closed=False)


def _lwpolyline(entity: Any, scale: float) -> Outline:
    rows = np.array(list(entity.get_points("xyseb")), dtype=float).reshape(-1, 5)
    width = abs(entity.dxf.const_width) if entity.dxf.hasattr("const_width") else np.abs(rows[:, 2:4]).max(initial=0.0)
    points = list(entity.vertices_in_wcs())
    return _in_plane(entity, points, rows[:, 4], scale, entity.closed, float(width) * scale)


def _polyline(entity: Any, scale: float) -> Outline | None:
    if not (entity.is_2d_polyline or entity.is_3d_polyline):
        return None
    vertices = [vertex for vertex in entity.vertices if not vertex.dxf.flags & 16]  # frames of curves aside
    points = [vertex.dxf.location for vertex in vertices]
    if entity.is_3d_polyline:
        return _in_plane(entity, points, np.zeros(len(points)), scale, entity.is_closed)
    width = max((abs(value) for v in vertices for value in (v.dxf.start_width, v.dxf.end_width)), default=0.0)
    width = max(width, abs(entity.dxf.default_start_width), abs(entity.dxf.default_end_width))
    bulges = np.array([v.dxf.bulge for v in vertices])
    return _with_bulges(entity, points, bulges, scale, entity.is_closed, width * scale)


def _face(entity: Any, scale: float) -> Outline:
    points = entity.wcs_vertices()
    return _in_plane(entity, points, np.zeros(len(points)), scale, is_closed=True)


def _with_bulges(
    entity: Any, points: list[Any], bulges: np.ndarray, scale: float, is_closed: bool, width: float = 0.0
) -> Outline:
    """Points in the coordinate system of an entity as an outline."""
    return _in_plane(entity, list(entity.ocs().points_to_wcs(points)), bulges, scale, is_closed, width)


def _in_plane(
    entity: Any, points: list[Any], bulges: np.ndarray, scale: float, is_closed: bool, width: float = 0.0
) -> Outline:
    """Points in world coordinates as an outline. Seen from below, arcs turn the other way round."""
    if not np.isfinite([*bulges, width]).all():
        raise ValueError("has a bulge or a width that is not finite")
    if not points:
        raise ValueError("has no vertices")
    is_mirrored = entity.dxf.hasattr("extrusion") and entity.dxf.extrusion.z < 0
    flat = np.array([plane(point, scale) for point in points])
    return Outline(np.column_stack([flat, -bulges if is_mirrored else bulges]), bool(is_closed), width)


def _add_outline(drawing: Drawing, outline: Outline, where: str) -> None:
    vertices, has_arcs = outline.vertices, bool(outline.vertices[:, 2].any())
    if outline.is_closed:
        ring = ring_around(vertices)
        if outline.width and len(ring) > 2:
            _add_region(drawing, _grown(shapely.Polygon(ring), 0.5 * outline.width), where)
        else:
            _add_ring(drawing, ring, where)
        return
    line = polyline_along(vertices)
    if all(point == line[0] for point in line):
        drawing.points.append(line[0])
    elif outline.width:
        half = 0.5 * outline.width + (FLATTENING if has_arcs else 0.0)
        strip = shapely.LineString(line).buffer(half, cap_style="flat", join_style="mitre")
        _add_region(drawing, strip, where)
    else:
        drawing.lines.append(line)


def _add_ring(drawing: Drawing, ring: Points, where: str) -> None:
    different = [point for point, previous in zip(ring, ring[-1:] + ring[:-1], strict=True) if point != previous]
    if len(different) > 2:
        drawing.add_area(different, [], where)
    elif len(different) == 2:
        drawing.lines.append(different)
    else:
        drawing.points.append(ring[0])


def _axes(entity: Any, scale: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return tuple(np.array(plane(v, scale)) for v in (entity.dxf.center, entity.dxf.major_axis, entity.minor_axis))  # type: ignore[return-value]


def _partial_ellipse(entity: Any, scale: float) -> Points:
    begin = entity.dxf.start_param
    return polyline_along_ellipse(*_axes(entity, scale), begin, _turn(begin, entity.dxf.end_param))


def _add_spline(drawing: Drawing, entity: Any, scale: float, where: str) -> None:
    line = _spline_points(entity.construction_tool(), scale)
    if len(line) > 3 and (entity.closed or math.dist(line[0], line[-1]) <= CLOSED):
        _add_region(drawing, _grown(shapely.Polygon(line), 0.5 * FLATTENING), where)
    else:
        drawing.lines.append(line.tolist())


def _spline_points(tool: Any, scale: float) -> np.ndarray:
    """Points of a spline (N, 2) whose chords are within half of FLATTENING [m]."""
    _check_size(np.array([plane(point, scale) for point in tool.control_points]))
    knots = np.unique(tool.knots()[tool.order - 1 : tool.count + 1])  # a closed one has others before and after
    parts = 4
    while (len(knots) - 1) * parts <= MOST_POINTS:
        at = np.unique(np.concatenate([np.linspace(*ends, parts + 1) for ends in zip(knots, knots[1:], strict=False)]))
        points = np.array([plane(point, scale) for point in tool.points(at)])
        # the middle one of three is as far from the chord as the curve is; chords of half the length are 4 times nearer
        if parts > 4 and np.abs(points[1:-1] - 0.5 * (points[:-2] + points[2:])).max() <= FLATTENING:
            return points
        parts *= 2
    raise ValueError(f"is a spline that takes more than {MOST_POINTS} points: is the drawing's unit right?")


def _hatched(entity: Any, scale: float) -> shapely.Geometry:
    """The region of a hatch: what an odd number of its paths goes around."""
    from ezdxf.path import from_hatch_boundary_path

    _check_flat(entity)
    parts, growth = [], 0.0
    for boundary in entity.paths:
        if boundary.path_type_flags & TEXT_BOX:
            continue
        whole = from_hatch_boundary_path(boundary, entity.ocs(), entity.dxf.elevation.z)
        for path in whole.sub_paths() if whole.has_sub_paths else [whole]:
            corners = np.array([plane(point, scale) for point in path.control_vertices()])
            if len(corners) and path.has_curves:
                _check_size(corners)
                growth = max(growth, 0.5 * FLATTENING + BEZIER * float(np.linalg.norm(np.ptp(corners, axis=0))))
            flat = [plane(point, scale) for point in path.flattening(0.25 * FLATTENING / scale, segments=8)]
            if len(flat) > 2:
                parts.append(shapely.make_valid(shapely.Polygon(flat)))
    if entity.dxf.get("hatch_style", 0) == ALL_FILLED:
        return _grown(shapely.union_all(parts), growth)
    return _grown(reduce(shapely.symmetric_difference, parts, shapely.Polygon()), growth)


def _check_size(points: np.ndarray) -> None:
    if np.ptp(points, axis=0).max() > LARGEST_CURVE:
        raise ValueError(f"is a curve larger than {LARGEST_CURVE:g} m: is the drawing's unit right?")


def _grown(shape: shapely.Geometry, distance: float) -> shapely.Geometry:
    if not distance:
        return shape
    return shapely.make_valid(shape).buffer(distance, join_style="mitre", mitre_limit=2.0)


def _add_region(drawing: Drawing, region: shapely.Geometry, where: str) -> None:
    for part in shapely.get_parts(shapely.get_parts(region)):
        if isinstance(part, shapely.Polygon) and part.area > 0:
            outer, *holes = (
                [list(point[:2]) for point in ring.coords[:-1]] for ring in (part.exterior, *part.interiors)
            )
            drawing.add_area(outer, holes, where)


ELLIPSES = ("CIRCLE", "ELLIPSE")
OUTLINES: dict[str, Callable[[Any, float], Outline | None]] = {
    "LINE": _line,
    "ARC": _arc,
    "LWPOLYLINE": _lwpolyline,
    "POLYLINE": _polyline,
    "SOLID": _face,
    "TRACE": _face,
    "3DFACE": _face,
}
