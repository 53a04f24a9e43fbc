"""Edits by a pointer: move, turn, resize, copy, delete and create objects; each returns the new text.

All raise EditError if the text cannot be edited so, and LineError if it is no YAML.
"""

from collections.abc import Sequence
from itertools import count, pairwise
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.draw.bodies import Body
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
from taichi_plume.draw.parts import Plane, Point, Values, nearest_wall, pair, position_text, size_text
from taichi_plume.draw.quantities import differences, number, plain
from taichi_plume.grid.outlines import circle
from taichi_plume.report.theme import ABOVE
from taichi_plume.scenario.changes import Data, steps_of

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


def with_values(text: str, path: str, values: Values) -> str:
    """Return the text with new values [SI] of keys of a section, each spelled as the old one where it changed."""
    return _with_values(text, {f"{path}.{key}": new for key, new in values.items()})


def _with_values(text: str, values: Values) -> str:
    """Return the text with new values [SI] at paths."""
    data = data_of(text)
    whole = {at: v for path, new in values.items() for at, v in differences(path, value_at(data, path), new)}
    return set_values(text, whole)


def move_handle(text: str, of: Scene, path: str, handle: str, plane: Plane, to: Point) -> str:
    """Return the text once a handle of an object has been dragged to a point of a plane. of: the text's objects."""
    return move(text, of, [(path, handle, to)], plane)


Move = tuple[str, str, Point]
"""Path of an object, one of its handles, and the new position of that handle in a plane."""


def moves(of: Scene, paths: Sequence[str], plane: Plane, by: Point) -> list[Move]:
    """Return how each object that can be moved is moved by a vector [m] in a plane, openings along or between walls."""
    found = [(thing, thing.grip(plane)) for path in paths if (thing := of.thing(path)) is not None]
    places = [(thing.path, grip, thing.handles(plane)[grip]) for thing, grip in found if grip is not None]
    return [(path, grip, (x + by[0], y + by[1])) for path, grip, (x, y) in places]


def move(text: str, of: Scene, moves: Sequence[Move], plane: Plane) -> str:
    """Return the text once handles of objects have been moved; see `moves`."""
    values: Values = {}
    for path, handle, to in moves:
        thing = of.thing(path)
        if thing is None or handle not in thing.handles(plane):
            raise EditError(f"{path or 'the scenario'}: has no handle '{handle}' there")
        assert thing.part is not None
        section = path + thing.part.within
        values |= {f"{section}.{key}": new for key, new in thing.part.moved(handle, plane, to).items()}
    return _with_values(text, values)


def turn(text: str, paths: Sequence[str], by: float, of: Scene | None = None) -> str:
    """Return the text once boxes, meshes, or the headings of robots have been turned by an angle [degrees].

    of: the text's objects, by which meshes are turned about their middle, not about the origin of their file. Of
    several objects those that cannot be turned stay.
    """
    turnable = [path for path in paths if can_turn(data_of(text), path)]
    if not turnable:
        raise EditError(f"{(*paths, 'the scenario')[0]}: only boxes, meshes and robots can be turned")
    for path in turnable:
        key = f"{path}.start.heading_deg" if path.startswith("robots[") else f"{path}.yaw_deg"
        angle = value_at(data_of(text), key) or 0
        if not isinstance(angle, int | float):
            raise EditError(f"{key}: got {angle}; must be a number")
        angle = (angle + by + 180) % 360 - 180
        thing = of.thing(path) if of is not None else None
        if thing is not None and isinstance(thing.part, Body):
            text = with_values(text, path, thing.part.turned(angle))
        else:
            text = set_value(text, key, number(angle))
    return text


def can_turn(data: Data, path: str) -> bool:
    """Return whether an object is a box, a mesh or robots."""
    return path.startswith("robots[") or value_at(data, f"{path}.kind") in ("box", "mesh")


Clip = list[tuple[str, Any]]
"""Copied objects: the path of the list of each, and its keys and values."""


def clip(of: Scene, paths: Sequence[str]) -> Clip:
    """Return copies of objects for `paste`; what is not in a list, such as the room, is left out."""
    pairs = [(parent_of(path), value_at(of.data, path)) for path in paths if path]
    return [(above, item) for (above, last), item in pairs if last.isdecimal() and item is not None]


def paste(text: str, copied: Clip, folder: Path, to: Point | None = None) -> tuple[str, list[str]]:
    """Return the text with copied objects whose common middle is at a point or, without one, beside the originals.

    Also return the paths of the new objects.
    """
    paths = []
    for above, item in copied:
        text, path = _named(add(text, above, item), above)
        paths.append(path)
    return _placed(text, paths, folder, to), paths


def copy(text: str, paths: Sequence[str], folder: Path) -> tuple[str, list[str]]:
    """Return the text with copies of objects, spelled alike, beside them, and the paths of the copies."""
    copies = []
    for path in paths:
        above, last = parent_of(path) if path else ("", "")
        if not last.isdecimal():
            raise EditError(f"{path or 'the scenario'}: cannot be copied")
        text, new = _named(duplicate(text, path), above)
        copies.append(new)
    return _placed(text, copies, folder), copies


def _named(text: str, above: str) -> tuple[str, str]:
    """Return the text with a free name of the last object of a list, if it has a name, and the object's path."""
    items = value_at(data_of(text), above)
    path, name = f"{above}[{len(items) - 1}]", value_at(data_of(text), f"{above}[{len(items) - 1}].name")
    taken = [item.get("name") for item in items[:-1] if isinstance(item, dict)]
    if (isinstance(name, str) and name in taken) or (above == "robots" and not isinstance(name, str)):
        stem = name if isinstance(name, str) and name else "robots"
        text = set_value(text, f"{path}.name", _free_name(text, above, stem))
    return text, path


def _placed(text: str, paths: Sequence[str], folder: Path, to: Point | None = None) -> str:
    """Return the text with objects moved as one, by the usual distance or to a point; a whole wall stays."""
    of = scene(text, folder)
    places = [place for _, _, place in moves(of, paths, ABOVE, (0.0, 0.0))]
    if not places:
        return text
    low, high = np.min(places, axis=0), np.max(places, axis=0)
    by = (BESIDE, BESIDE) if to is None else pair(to - (low + high) / 2)
    return move(text, of, moves(of, paths, ABOVE, by), ABOVE)


def remove(text: str, paths: Sequence[str]) -> str:
    """Return the text without objects; the room itself stays."""
    if not [path for path in paths if path not in ("", "domain")]:
        raise EditError("the room itself cannot be deleted")
    for path in sorted(paths, key=_order, reverse=True):  # the last item first: the others keep their paths
        text = delete(text, path) if path not in ("", "domain") else text
    return text


def _order(path: str) -> list[tuple[int, str]]:
    """Return a key that sorts paths in the order of lists."""
    return [(int(step), "") if step.isdecimal() else (-1, step) for step in steps_of(path)] if path else []


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
OPENINGS, AREAS = ("inlet", "outlet", "honeycomb", "fan"), ("box", "robot area", "arena")
ROUND, LINES = ("cylinder", "sphere"), ("robot line", "probe line")
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


def sketch(kind: str, a: Point, b: Point, room: tuple[float, ...] | None) -> tuple[Sequence[Point], str]:
    """Return the line of an object that a drag from a to b draws, and its size or position as text."""
    far, points = hypot(b[0] - a[0], b[1] - a[1]), np.array([a, b])
    if kind in AREAS:
        return [a, (b[0], a[1]), b, (a[0], b[1]), a], size_text(np.subtract(b, a))
    if kind in OPENINGS and room is not None:
        face, *ends = on_wall(a, b, room)
        axis = 1 if face[0] == "x" else 0
        points[:, axis], points[:, 1 - axis] = ends, room[1 - axis] if face[1] == "+" else 0.0
        return [pair(point) for point in points], size_text([ends[1] - ends[0]])
    if kind in ROUND:
        rim = circle(np.array(a), far)
        return [pair(point) for point in [*rim, rim[0]]], f"radius {far:.2f} m"
    return ([a, b], size_text([far])) if kind in LINES else ([], position_text(ABOVE, a))


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
    if kind in OPENINGS:
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
        taken = [each.get("name") for each in value_at(data, "probes.points") or () if isinstance(each, dict)]
        return "probes.points", {"name": next(p for n in count(1) if (p := f"p{n}") not in taken), **place}
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


def on_wall(a: Point, b: Point, room: Sequence[float]) -> tuple[str, float, float]:
    """Return the wall nearest to a drag, and from where to where [m] along the wall an opening is that is drawn so.

    A drag that is not along that wall, or a click, makes an opening a fifth as wide as the wall.
    """
    face = nearest_wall(pair((np.array(a) + b) / 2), room)
    axis = 1 if face[0] == "x" else 0
    low, high = np.clip(sorted((a[axis], b[axis])), 0.0, room[axis])
    if high - low < LEAST:
        width = room[axis] / 5
        low = min(max((low + high - width) / 2, 0.0), room[axis] - width)
        high = low + width
    return face, float(low), float(high)


def _opening(kind: str, a: Point, b: Point, room: tuple[float, ...]) -> dict[str, Any]:
    """Return the keys of an opening on the wall nearest to a drag, as wide as the drag along the wall."""
    face, low, high = on_wall(a, b, room)
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
