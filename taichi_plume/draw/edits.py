"""Edits by a pointer: move, turn, resize, copy, delete and create objects; each returns the new text.

All raise EditError if the text cannot be edited so, and LineError if it is no YAML.
"""

from collections.abc import Sequence
from itertools import pairwise
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.draw.document import (
    EditError,
    add,
    data_of,
    delete,
    duplicate,
    parent_of,
    set_value,
    set_values,
    value_at,
)
from taichi_plume.draw.objects import Scene, scene
from taichi_plume.draw.parts import Plane, Point, Values, nearest_wall, pair
from taichi_plume.draw.quantities import differences, number, plain
from taichi_plume.scenario.changes import Data

BESIDE = 0.2  # m from an object to its copy, along x and y
LEAST = 0.05  # m: a shorter drag is a click
SPEED = 0.5  # m/s of a walker
BLANK = """\
# A room, drawn.
name: room
seed: 1
duration: 60 s
warm_up: 10 s
domain: {size: [4 m, 3 m], spacing: 5 cm, depth: 0.5 m}
wind:
  kind: cfd
  openings: []
obstacles: []
gas:
  kind: eulerian
  species: ethanol
  sources: []
robots: []
"""


def snapped(point: Point, step: float | None) -> Point:
    """Return a point moved to the nearest corner of a grid with this step [m]; None: not moved."""
    if not step:
        return point
    return round(point[0] / step) * step, round(point[1] / step) * step


def with_values(text: str, path: str, values: Values) -> str:
    """Return the text with new values [SI] of keys of a section, each spelled as the old one where it changed."""
    data, whole = data_of(text), {f"{path}.{key}": new for key, new in values.items()}
    return set_values(
        text, {at: v for key, new in whole.items() for at, v in differences(key, value_at(data, key), new)}
    )


def move_handle(text: str, of: Scene, path: str, handle: str, plane: Plane, to: Point) -> str:
    """Return the text once a handle of an object has been dragged to a point of a plane. of: the text's objects."""
    thing = of.thing(path)
    if thing is None or handle not in thing.handles(plane):
        raise EditError(f"{path or 'the scenario'}: has no handle '{handle}' there")
    assert thing.part is not None
    return with_values(text, path + thing.part.within, thing.part.moved(handle, plane, to))


def shift(text: str, of: Scene, path: str, by: Sequence[float]) -> str:
    """Return the text once an object has been moved by a vector [m]."""
    thing = of.thing(path)
    if thing is None or thing.part is None:
        raise EditError(f"{path or 'the scenario'}: cannot be moved")
    return with_values(text, path + thing.part.within, thing.part.shifted(np.resize([*by, 0.0, 0.0], 3)))


def turn(text: str, path: str, by: float) -> str:
    """Return the text once a box, a mesh, or the heading of robots has been turned by an angle [degrees]."""
    key = f"{path}.start.heading_deg" if path.startswith("robots[") else f"{path}.yaw_deg"
    kind = value_at(data_of(text), f"{path}.kind")
    if not path.startswith("robots[") and kind not in ("box", "mesh"):
        raise EditError(f"{path or 'the scenario'}: only boxes, meshes and robots can be turned")
    angle = value_at(data_of(text), key) or 0
    if not isinstance(angle, int | float):
        raise EditError(f"{key}: got {angle}; must be a number")
    return set_value(text, key, number((angle + by + 180) % 360 - 180))


def copy(text: str, path: str, folder: Path) -> tuple[str, str]:
    """Return the text with a copy of an object beside the object, and the path of the copy."""
    above, last = parent_of(path)
    if not last.isdecimal():
        raise EditError(f"{path or 'the scenario'}: cannot be copied")
    new = duplicate(text, path)
    copied = f"{above}[{len(value_at(data_of(new), above)) - 1}]"
    name = value_at(data_of(new), f"{copied}.name")
    if isinstance(name, str) or above == "robots":
        stem = name if isinstance(name, str) and name else "robots"
        new = set_value(new, f"{copied}.name", _free_name(new, above, stem))
    try:
        moved = shift(new, scene(new, folder), copied, (BESIDE, BESIDE))
    except EditError:
        moved = new  # such as a whole wall, which has nowhere to go
    return moved, copied


def remove(text: str, path: str) -> str:
    """Return the text without an object."""
    if not path or path == "domain":
        raise EditError("the room itself cannot be deleted")
    return delete(text, path)


def _free_name(text: str, path: str, name: str) -> str:
    items = value_at(data_of(text), path) or []
    taken = [item.get("name") for item in items if isinstance(item, dict)]
    stem = name.rstrip("0123456789") or "robots"
    return next(f"{stem}{n}" for n in range(2, len(items) + 3) if f"{stem}{n}" not in taken)


# ---------------------------------------------------------------- creation

KINDS = {
    "inlet": "Air that is blown in: drag along a wall",
    "outlet": "Air may leave here: drag along a wall",
    "honeycomb": "A flow straightener that blows parallel air: drag along a wall",
    "fan": "A round fan: drag along a wall",
    "box": "A box: drag from corner to corner",
    "cylinder": "A pillar: drag from its middle to its rim",
    "sphere": "A ball: drag from its middle to its rim",
    "polygon": "Walls with corners: click each corner, then double-click",
    "mesh": "A CAD model beside the scenario (STL, OBJ, PLY): click where its origin is",
    "map": "The walls of a map of ROS beside the scenario: click anywhere",
    "walker": "A person who walks: click the start and each way point, then double-click",
    "heater": "A warm thing: click",
    "source": "A gas source: click",
    "robots": "Robots at points: click; with a group selected, one more of its robots",
    "robot line": "Robots on a line: drag",
    "robot area": "Robots at random in an area: drag",
    "arena": "The part of the floor that robots may use: drag",
    "probe": "A point that measures: click",
    "probe line": "A line of measuring points: drag",
}
"""Kinds of objects that can be drawn, with a word on how."""
CLICKED = ("polygon", "walker")
"""Kinds that are drawn by several clicks; the others by a drag or a click."""
_ROBOT: dict[str, Any] = {
    "algorithm": {"kind": "casting", "threshold_ppm": 5},
    "sensors": {"gas": {"kind": "mox"}, "wind": {"kind": "ultrasonic"}},
}


def create(
    text: str, of: Scene, kind: str, points: Sequence[Point], selected: str = "", file: str = ""
) -> tuple[str, str]:
    """Return the text with a new object, and its path. of: the text's objects; points: of a drag, or of clicks [m].

    selected: path of the selected object; file: of a mesh or a map, relative to the scenario's folder.
    """
    if of.room is None:
        raise EditError("domain: is missing or has mistakes; without a room nothing can be drawn")
    if kind not in KINDS:
        raise EditError(f"no kind '{kind}'")
    points = [pair(point) for point in points]
    a, b = points[0], points[-1]
    if kind == "robots" and value_at(data_of(text), f"{selected}.start.kind") == "positions":
        text = add(text, f"{selected}.start.positions", plain(list(a)))
        count = len(value_at(data_of(text), f"{selected}.start.positions"))
        return set_value(text, f"{selected}.count", count), selected
    if kind == "arena":
        return set_value(text, "arena", plain(_box_of(a, b))), "arena"
    path, item = _item(text, kind, points, of.room, file)
    new = add(text, path, plain(item))
    return new, f"{path}[{len(value_at(data_of(new), path)) - 1}]"


def _box_of(a: Point, b: Point) -> dict[str, list[float]]:
    low, high = np.minimum(a, b), np.maximum(a, b)
    high = np.where(high - low < LEAST, low + 0.5, high)
    return {"low": [float(x) for x in low], "high": [float(x) for x in high]}


def _item(
    text: str, kind: str, points: Sequence[Point], room: tuple[float, ...], file: str
) -> tuple[str, dict[str, Any]]:
    """Return the path of the list and the keys of a new object."""
    data, a, b = data_of(text), points[0], points[-1]
    far, flat = hypot(b[0] - a[0], b[1] - a[1]), len(room) == 2
    low = [] if flat else [min(0.25, room[2] / 2)]  # a height above the floor
    if kind in ("inlet", "outlet", "honeycomb", "fan"):
        if value_at(data, "wind.kind") != "cfd":
            raise EditError("wind.kind: openings take a computed wind, kind: cfd")
        return "wind.openings", _opening(kind, a, b, room)
    if kind == "heater":
        if flat and value_at(data, "wind.buoyancy.gravity") is None:
            raise EditError("domain.size: a heater takes a third number, the height: its warm air rises")
        return "wind.buoyancy.heat.heaters", {"position": [*a, *low], "power": "50 W"}
    if kind == "source":
        return _list_of_sources(data), {"position": [*a, *low], "rate": "10 mg/s", "radius": "5 cm"}
    if kind in ("probe", "probe line"):
        ends = {"kind": "line", "start": [*a, *low], "end": [*b, *low], "count": 10}
        place = ends if kind == "probe line" else {"kind": "point", "at": [*a, *low]}
        return "probes.points", {"name": f"p{len(value_at(data, 'probes.points') or []) + 1}", **place}
    starts: dict[str, dict[str, Any]] = {
        "robots": {"kind": "positions", "positions": [[*a]]},
        "robot line": {"kind": "line", "begin": [*a], "end": [*b] if far >= LEAST else [a[0], a[1] + 1.0]},
        "robot area": {"kind": "area", **_box_of(a, b)},
    }
    if kind in starts:
        name = _free_name(text, "robots", "team") if value_at(data, "robots") else "team"
        return "robots", {
            "name": name,
            "count": 1 if kind == "robots" else 2,
            "start": starts[kind],
            **_ROBOT,
        }
    return "obstacles", _obstacle(kind, points, far if far >= LEAST else 0.05 * min(room[:2]), room, file)


def _obstacle(
    kind: str, points: Sequence[Point], radius: float, room: tuple[float, ...], file: str
) -> dict[str, Any]:
    """Return the keys of an obstacle; radius: of a round one [m]."""
    a, flat = points[0], len(room) == 2
    if kind in ("mesh", "map"):
        if not file:
            raise EditError(f"{kind}: there is no such file beside the scenario")
        return {"kind": kind, "file": file, **({"translate": [*a, 0.0]} if kind == "mesh" else {})}
    if kind == "box":
        low, high = (np.array(end) for end in _box_of(a, points[-1]).values())
        height = [] if flat else [min(0.5, room[2])]
        middle = [*((low + high) / 2).tolist(), *(h / 2 for h in height)]
        return {"kind": kind, "center": middle, "size": [*(high - low).tolist(), *height]}
    if kind == "polygon":
        if len(points) < 3:
            raise EditError("a polygon takes three corners or more")
        return {"kind": "prism", "vertices": [[*point] for point in points]}
    if kind == "walker":
        return _walker(points)
    height = [] if flat or kind == "cylinder" else [radius]
    return {"kind": kind, "center": [*a, *height], "radius": radius}


def _opening(kind: str, a: Point, b: Point, room: tuple[float, ...]) -> dict[str, Any]:
    """Return the keys of an opening on the wall nearest to a drag, as wide as the drag along the wall."""
    face = nearest_wall(pair((np.array(a) + b) / 2), room)
    axis = 1 if face[0] == "x" else 0
    low, high = sorted((a[axis], b[axis]))
    if high - low < LEAST:
        low, high = low - room[axis] / 10, high + room[axis] / 10
    low, high = max(low, 0.0), min(high, room[axis])
    if high - low < LEAST:
        raise EditError("an opening lies on a wall: drag along the wall")
    height = room[2:]
    middle = [(low + high) / 2, *(h / 2 for h in height)]
    size = {"diameter": min((high - low, *height))} if kind == "fan" else {"size": [high - low, *height]}
    speed = {} if kind == "outlet" else {"speed": "0.5 m/s"}
    return {"kind": kind, "face": face, "center": middle, **size, **speed}


def _walker(points: Sequence[Point]) -> dict[str, Any]:
    """Return the keys of a person who walks through the points and the same way back, again and again."""
    if len(points) < 2:
        raise EditError("a walker takes a start and one way point or more")
    way = [*points, *reversed(points[:-1])]
    time, path = 0.0, []
    for before, after in pairwise(way):
        time += max(0.1, hypot(after[0] - before[0], after[1] - before[1]) / SPEED)
        path.append([round(time, 1), *after])
    return {"kind": "cylinder", "center": [*points[0]], "radius": 0.2, "motion": {"path": path, "loop": True}}


def _list_of_sources(data: Data) -> str:
    if value_at(data, "gas.kind") == "gaussian_puff":
        raise EditError("gas.releases: a puff takes a time and a mass; add it in the text")
    return "gas.parts[0].sources" if value_at(data, "gas.parts[0]") else "gas.sources"
