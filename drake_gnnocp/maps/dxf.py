"""DXF drawings as scenarios: whatever is drawn in model space, on layers that are on and not frozen, is an obstacle.

Layers of some names, in capitals or not, hold other things:

    BOUNDS     one closed polyline (or circle, or ellipse) that the whole footprint stays inside of
    START      the pose where the motion starts: a LINE, or a polyline of two vertices, from the middle of the rear axle
               towards where the car looks; or an INSERT (of any block: its place and rotation)
    GOAL       the same; a POINT is a goal with a free heading; several are goals of which one is to be reached
    IGNORE...  nothing, and DEFPOINTS neither

Blocks are taken apart; what they hold on layer 0 is on the layer of their INSERT. Texts, dimensions, and kinds that are
not known here, are left out and counted in one line of the log. The unit is that of $INSUNITS.
"""

from __future__ import annotations

import logging
import math
import struct
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from drake_gnnocp.files import check_readable, first_line
from drake_gnnocp.maps.curves import ring_around, ring_around_ellipse
from drake_gnnocp.maps.drawing import Drawing
from drake_gnnocp.maps.dxf_shapes import ELLIPSES, add_shape, axes_of, outline_of, plane

UNITLESS = 0
METRES = {  # of a unit of $INSUNITS
    **{1: 0.0254, 2: 0.3048, 3: 1609.344, 4: 1e-3, 5: 1e-2, 6: 1.0, 7: 1e3, 8: 2.54e-8, 9: 2.54e-5, 10: 0.9144},
    **{13: 1e-6, 14: 0.1, 15: 10.0, 16: 100.0, 21: 1200 / 3937, 22: 100 / 3937, 23: 3600 / 3937},
}
BOUNDS, START, GOAL, OBSTACLE = "BOUNDS", "START", "GOAL", "OBSTACLE"
ANNOTATIONS = {
    *("TEXT", "MTEXT", "ATTDEF", "ATTRIB", "DIMENSION", "ARC_DIMENSION", "LARGE_RADIAL_DIMENSION", "LEADER"),
    *("MULTILEADER", "MLEADER", "TOLERANCE", "VIEWPORT", "ACAD_TABLE", "XLINE", "RAY", "IMAGE", "LIGHT", "SUN"),
}
TAKEN_APART = ("INSERT", "MLINE")
MOST_ENTITIES = 100_000  # blocks taken apart
DEEPEST = 20  # blocks within blocks

logger = logging.getLogger(__name__)


def read_dxf(path: Path, layers: Sequence[str] = ()) -> dict[str, Any]:
    """Read a drawing in the keys of the scenario's JSON format.

    Args:
        path: of a DXF file, text or binary.
        layers: only what is on these is an obstacle; without any, all but the special ones.

    Raises:
        ValueError: the file is missing, unreadable or damaged, or shows what is no scenario; the message is one line.
    """
    check_readable(path)
    try:
        import ezdxf
    except ModuleNotFoundError:
        raise ValueError("ezdxf is not installed: pip install -e .[dxf]") from None
    try:
        document = ezdxf.readfile(path)  # not ezdxf.recover: it leaves out what it cannot read
    except _errors() as error:
        raise ValueError(f"file: is no DXF drawing, or damaged: {_said(error)}") from None
    reader = _Reader(_metres(document), _Layers(document, layers))
    try:
        reader.read(document.modelspace())
    except _errors() as error:
        if isinstance(error, ValueError) and not isinstance(error, ezdxf.DXFError):
            raise  # it names the entity
        raise ValueError(f"file: is damaged: {_said(error)}") from None
    if document.header.get("$INSUNITS", UNITLESS) == UNITLESS:
        logger.warning("$INSUNITS: the drawing has no unit: it is taken to be in metres")
    reader.report()
    return {"name": path.stem, **reader.drawing.keys()}


def _errors() -> tuple[type[Exception], ...]:
    """What ezdxf raises of damaged things: much of an entity is looked at only when it is asked for."""
    from ezdxf import DXFError
    from ezdxf.math.transformtools import TransformError

    of_values = (ArithmeticError, AttributeError, LookupError, RuntimeError, TypeError, ValueError, struct.error)
    return (*of_values, OSError, EOFError, StopIteration, DXFError, TransformError)


def _said(error: Exception) -> str:
    """What an error of ezdxf says, in one line; it may quote the bytes of the file."""
    return "".join(letter if letter.isprintable() else "?" for letter in first_line(error))


def _metres(document: Any) -> float:
    """Metres per unit of the drawing."""
    unit = document.header.get("$INSUNITS", UNITLESS)
    if unit == UNITLESS:
        return 1.0
    if unit not in METRES:
        raise ValueError(f"$INSUNITS: must be the number of a unit of length, not {unit!r}")
    return METRES[unit]


class _Layers:
    """Which layers are shown, and what is on them."""

    def __init__(self, document: Any, chosen: Sequence[str]) -> None:
        self._seen = {layer.dxf.name for layer in document.layers}
        self._frozen = {layer.dxf.name.casefold() for layer in document.layers if layer.is_frozen()}
        self._hidden = self._frozen | {layer.dxf.name.casefold() for layer in document.layers if layer.is_off()}
        self._chosen = {name.casefold(): name for name in chosen}

    def is_frozen(self, layer: str) -> bool:
        """Whether not even the blocks that are inserted on a layer are shown."""
        return layer.casefold() in self._frozen and layer.casefold() not in self._chosen

    def role(self, layers: Sequence[str]) -> str | None:
        """What an entity is by its own layer and those of the blocks that it is in, its own last; None for nothing."""
        self._seen.update(layers)
        names = [layer.casefold() for layer in layers]
        if not self._chosen.keys().isdisjoint(names):
            return OBSTACLE
        if names[-1] in self._hidden or any(name.startswith("ignore") or name == "defpoints" for name in names):
            return None
        for special in (BOUNDS, START, GOAL):
            if names[-1] == special.casefold():
                return special
        return None if self._chosen else OBSTACLE

    def check_chosen(self) -> None:
        """Raise a ValueError where a chosen layer is not in the drawing."""
        seen = {name.casefold() for name in self._seen}
        for name in self._chosen:
            if name not in seen:
                there = ", ".join(sorted(self._seen))
                raise ValueError(f"--layers: there is no layer {self._chosen[name]!r}; there are {there}")


@dataclass
class _Reader:
    scale: float  # m per unit of the drawing
    layers: _Layers
    drawing: Drawing = field(default_factory=Drawing)
    ignored: Counter[str] = field(default_factory=Counter)
    n_entities: int = 0

    def read(self, modelspace: Iterable[Any]) -> None:
        for layers, entity in self._parts(modelspace, ()):
            role, kind = self.layers.role(layers), entity.dxftype()
            where = " ".join([kind, *([entity.dxf.handle] if entity.dxf.handle else []), f"on layer {layers[-1]!r}"])
            if role is None:
                continue
            if kind in ANNOTATIONS:
                self.ignored[kind] += 1
                continue
            try:
                self._add(role, entity, where)
            except ValueError as error:
                raise ValueError(f"{where}: {_said(error).removeprefix(where + ': ')}") from None
            except _errors() as error:
                raise ValueError(f"{where}: cannot be read: {_said(error)}") from None
        self.layers.check_chosen()

    def report(self) -> None:
        """Say in one line of the log what was left out; a warning where it may have been something to drive around."""
        if self.ignored:
            level = logging.INFO if set(self.ignored) <= ANNOTATIONS else logging.WARNING
            logger.log(level, "left out: %s", ", ".join(f"{n} {kind}" for kind, n in sorted(self.ignored.items())))

    def _parts(self, entities: Iterable[Any], outer: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any]]:
        """Entities, blocks taken apart, and the layers of each: those of the blocks that it is in, and its own."""
        for entity in entities:
            self.n_entities += 1
            if self.n_entities > MOST_ENTITIES:
                raise ValueError(f"file: has more than {MOST_ENTITIES} entities")
            if not hasattr(entity.dxf, "layer") or entity.dxf.get("invisible", 0):
                continue
            own = entity.dxf.layer
            layers = (*outer, outer[-1] if outer and own == "0" else own)
            if entity.dxftype() not in TAKEN_APART or self.layers.role(layers) in (START, GOAL):
                yield layers, entity
            elif not self.layers.is_frozen(layers[-1]):
                if len(layers) > DEEPEST:
                    raise ValueError(f"INSERT on layer {own!r}: has more than {DEEPEST} blocks within blocks")
                for one in self._repeated(entity, own):
                    yield from self._parts(self._exploded(one, own), layers)

    def _repeated(self, entity: Any, layer: str) -> Iterator[Any]:
        """The single INSERTs of one that has rows and columns; none of one of another file."""
        if entity.dxftype() == "MLINE":
            yield entity
            return
        block = entity.block()
        if block is None:
            raise ValueError(f"INSERT on layer {layer!r}: there is no block {entity.dxf.name!r}")
        if block.block.is_xref or block.block.is_xref_overlay:
            self.ignored["INSERT of another file"] += 1
        elif entity.mcount > MOST_ENTITIES:
            raise ValueError(f"file: has more than {MOST_ENTITIES} entities")
        else:
            yield from entity.multi_insert() if entity.mcount > 1 else [entity]

    def _exploded(self, entity: Any, layer: str) -> list[Any]:
        skipped: dict[str, Any] = {}
        if entity.dxftype() == "INSERT":
            skipped["skipped_entity_callback"] = lambda part, reason: self.ignored.update([part.dxftype()])
        try:
            return list(entity.virtual_entities(**skipped))
        except _errors() as error:
            raise ValueError(f"{entity.dxftype()} on layer {layer!r}: cannot be taken apart: {_said(error)}") from None

    def _add(self, role: str, entity: Any, where: str) -> None:
        if role == OBSTACLE:
            if not add_shape(self.drawing, entity, self.scale, where):
                self.ignored[entity.dxftype()] += 1
        elif role == BOUNDS:
            self._set_bounds(entity, where)
        else:
            pose = self._pose(entity)
            if role == GOAL:
                self.drawing.goals.append(pose)
            elif pose[2] is None:
                raise ValueError("shows no heading of the start: draw a LINE from the rear axle to the front")
            else:
                self.drawing.set_start(pose, where)

    def _set_bounds(self, entity: Any, where: str) -> None:
        if entity.dxftype() in ELLIPSES and (axes := axes_of(entity, self.scale)) is not None:
            self.drawing.set_bounds(ring_around_ellipse(*axes, outward=False), where)
            return
        outline = outline_of(entity, self.scale)
        if outline is None or not outline.is_closed:
            raise ValueError("must be a closed polyline, as bounds")
        self.drawing.set_bounds(ring_around(outline.vertices, outward=False), where)

    def _pose(self, entity: Any) -> list[Any]:
        kind = entity.dxftype()
        if kind == "POINT":
            return [*plane(entity.dxf.location, self.scale), None]
        if kind == "INSERT":
            matrix = entity.matrix44()
            ahead = matrix.transform_direction((1.0, 0.0, 0.0))
            return [*plane(entity.ocs().to_wcs(entity.dxf.insert), self.scale), math.atan2(ahead.y, ahead.x)]
        outline = outline_of(entity, self.scale)
        if outline is None or outline.is_closed or len(outline.vertices) != 2:
            raise ValueError("must be a LINE, an INSERT or (for a goal) a POINT, as a pose")
        (x, y), (u, v) = outline.vertices[:, :2].tolist()
        if not np.hypot(u - x, v - y) > 0:
            raise ValueError("has no length, and so no direction")
        return [x, y, math.atan2(v - y, u - x)]
