"""Objects of a drawing: a function of the YAML text alone. A text with mistakes is drawn as far as it can be read."""

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import ValidationError

from taichi_plume.draw.bodies import Body
from taichi_plume.draw.document import data_of, parent_of, value_at
from taichi_plume.draw.parts import (
    Outline,
    Pane,
    Part,
    Plane,
    Point,
    Points,
    Rectangle,
    Room,
    Values,
    Wrapped,
    probe_part,
    start_part,
)
from taichi_plume.draw.quantities import metres, plain
from taichi_plume.grid.shapes import Shape, ShapeError
from taichi_plume.guard.safe_open import admit, gate
from taichi_plume.guard.yaml_text import LineError
from taichi_plume.report import theme
from taichi_plume.report.theme import ABOVE, FRONT, SIDE
from taichi_plume.scenario.changes import Data, changed
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.key_facts import models_in, own_kind
from taichi_plume.scenario.robots import Group
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.shapes import shape
from taichi_plume.scenario.vocabulary import Model

CACHED_SHAPES = 64
LISTS = (
    "wind.openings",
    "wind.screens",
    "obstacles",
    "wind.buoyancy.heat.walls",
    "wind.buoyancy.heat.heaters",
)
_ITEM = re.compile(
    r"(?<![\w.\]])(?P<path>[a-z_]+(\.[a-z_]+)*\[\d+\](\.?[a-z_0-9]+|\[\d+\])*)(?P<kind> \(\w+\))?"
)
PLACES = ("center", "position", "at", "start", "low", "translate")
"""Keys that say about where an object is which cannot be read otherwise."""


@dataclass(frozen=True)
class Thing:
    """An object of the drawing, or a section without a position. path: its section in the text; name: for lists.

    color: as "#rrggbb". part: None without a position, or if unreadable; mark: position of an unreadable object, if at
    least this can be read.
    """

    path: str
    name: str
    color: str
    part: Part | None = None
    mark: Point | None = None

    def outlines(self, plane: Plane) -> list[Outline]:
        """Return what is drawn in a plane."""
        return self.part.drawn(plane)[0] if self.part else []

    def handles(self, plane: Plane) -> dict[str, Point]:
        """Return the handles in a plane by their names."""
        return self.part.drawn(plane)[1] if self.part else {}

    def grip(self, plane: Plane) -> str | None:
        """Return the handle that moves the whole object: `center`, or the only handle; None without such a handle."""
        handles = self.handles(plane)
        return "center" if "center" in handles else next(iter(handles)) if len(handles) == 1 else None

    def place(self, plane: Plane = ABOVE) -> Point | None:
        """Return the position of a number in a plane."""
        handles = self.handles(plane)
        return handles.get("center") or next(iter(handles.values()), self.mark if plane == ABOVE else None)


class Section(NamedTuple):
    """Model, part and mark (see `Thing`) of a section of the text."""

    model: Model | None
    part: Part | None
    mark: Point | None


@dataclass(frozen=True)
class Scene:
    """All objects of a text, in the order of drawing. room: extent of the domain [m]; None if it cannot be read.

    sections: what has been read of each section, for the scene of the next text.
    """

    text: str
    data: Data
    room: tuple[float, ...] | None
    things: tuple[Thing, ...]
    sections: Mapping[object, "Section"] = field(default_factory=dict, repr=False, compare=False)

    @property
    def planes(self) -> list[Plane]:
        """Planes of the views: from above and, in 3-D, from both sides."""
        return _planes(self.room)

    def thing(self, path: str) -> Thing | None:
        """Return the object at a path; None if there is none."""
        return next((thing for thing in self.things if thing.path == path), None)

    def with_thing(self, thing: Thing) -> "Scene":
        """Return the scene with another object at its path, while it is dragged."""
        things = tuple(thing if other.path == thing.path else other for other in self.things)
        return replace(self, things=things)

    def named(self, line: str) -> str:
        """Return a line of the checks with the names of the plan; see `named`."""
        return named(line, {thing.path: thing.name for thing in self.things})

    def drawn_otherwise(self, other: "Scene") -> list[Thing]:
        """Return the objects with a position that another scene lacks, or has with other keys or values."""
        there = [section for _, section in other._drawn]
        alike = set(map(repr, there))  # found at once; other spellings are compared one by one
        return [
            thing for thing, section in self._drawn if repr(section) not in alike and section not in there
        ]

    @property
    def _drawn(self) -> list[tuple[Thing, tuple[str, Any]]]:
        """Objects with a position, each with its list or section in the text and its keys and values."""
        return [
            (thing, (parent_of(thing.path)[0], value_at(self.data, thing.path)))
            for thing in self.things
            if thing.part is not None
        ]

    def owner(self, path: str) -> str:
        """Return the path of the innermost object that contains a path of keys; "" (the experiment) for all others."""
        inside = [
            thing.path
            for thing in self.things
            if thing.path and f"{path}.".startswith((f"{thing.path}.", f"{thing.path}["))
        ]
        return max(inside, key=len, default="")


def scene(text: str, folder: Path, allow_outside: bool = False, last: Scene | None = None) -> Scene:
    """Return the objects of a text; folder: of its files; allow_outside: whether files may lie outside of it.

    last: scene of an earlier text; sections that are equal in both texts are not read again.
    """
    try:
        data = data_of(text)
    except LineError:
        return Scene(text, {}, None, ())
    domain = read(data, "domain")
    room = tuple(round(x, 9) for x in domain.extent) if isinstance(domain, Domain) else None
    by_path = names(data)
    things = [Thing(path, by_path[path], theme.FAINT) for path, *_ in _unplaced(data)]
    things += [Thing("domain", by_path["domain"], theme.INK, Room(domain, room) if room else None)]
    known, sections, where = {} if last is None else last.sections, {}, (room, folder, allow_outside)
    classes: dict[str, list[type[Model]]] = {}
    for path, *_ in _paths(data):
        above = path.rpartition("[")[0] or path
        if above not in classes:
            classes[above] = classes_at(data, path)
        values = value_at(data, path)
        file = values.get("file") if isinstance(values, dict) else None
        stamp = _stamp(folder / file) if isinstance(file, str) else None
        key = above, *classes[above], repr(values), stamp, *where
        if key not in sections:
            sections[key] = known.get(key) or _section(data, path, room, folder, allow_outside)
        model, part, mark = sections[key]
        if part is None and file is not None:
            del sections[key]  # a file beside that file may have been missing
        things.append(Thing(path, by_path[path], _color(data, path, model), part, mark))
    return Scene(text, data, room, tuple(things), sections)


def _planes(room: tuple[float, ...] | None) -> list[Plane]:
    return [ABOVE, SIDE, FRONT] if room is not None and len(room) == 3 else [ABOVE]


def _section(
    data: Data, path: str, room: tuple[float, ...] | None, folder: Path, allow_outside: bool
) -> Section:
    """Read the section of an object."""
    part, model = None, read(data, path)
    if room is not None:
        try:
            with gate(None if allow_outside else folder):
                part = _part(data, path, model, room, folder)
                for plane in _planes(room) if part is not None else ():
                    part.drawn(plane)
        except (ShapeError, OSError, ValueError, LookupError, TypeError):
            part = None  # such as a position with too few numbers, or a file that cannot be read
    return Section(model, part, None if part else _mark(data, path))


def stamps(text: str, folder: Path) -> tuple[object, ...]:
    """Return times and sizes of the files that obstacles of a text name."""
    try:
        named = [item.get("file") for item in _items(data_of(text), "obstacles") if isinstance(item, dict)]
    except LineError:
        return ()
    return tuple(_stamp(folder / name) for name in named if isinstance(name, str))


def _stamp(file: Path) -> tuple[int, int] | None:
    try:
        about = file.stat()
    except (OSError, ValueError):
        return None
    return about.st_mtime_ns, about.st_size


def preview(of: Scene, path: str, values: Values, folder: Path) -> Thing | None:
    """Return an object with other values of keys [SI], while it is dragged; None if it cannot be read then."""
    thing = of.thing(path)
    if thing is None or thing.part is None or of.room is None:
        return None
    data = changed(
        of.data, {f"{path}{thing.part.within}.{key}": plain(value) for key, value in values.items()}
    )
    model, room = read(data, path), of.room
    if isinstance(model, Domain):
        return replace(thing, part=Room(model, model.extent))
    with gate(None):
        return replace(thing, part=_part(data, path, model, room, folder))


def read(data: Mapping[str, Any], path: str) -> Model | None:
    """Return the section of the data at a path; None if it is absent or has mistakes."""
    values, kind = value_at(data, path), model_at(data, path)
    if kind is None or not isinstance(values, dict):
        return None
    try:
        return kind.model_validate(values)
    except ValidationError:
        return None


def model_at(data: Mapping[str, Any], path: str) -> type[Model] | None:
    """Return the class of the section at a path, by the kinds that the data name; None if it is not known."""
    values = value_at(data, path)
    if values is None and path:
        above, key = parent_of(path)
        owner = model_at(data, above)
        default = owner.model_fields[key].default if owner is not None and key in owner.model_fields else None
        if isinstance(default, Model):
            return type(default)
    classes, kind = classes_at(data, path), values.get("kind") if isinstance(values, Mapping) else None
    of_kind = [model for model in classes if isinstance(kind, str) and own_kind(model) == kind]
    return of_kind[-1] if of_kind else classes[0] if len(classes) == 1 else None


def classes_at(data: Mapping[str, Any], path: str) -> list[type[Model]]:
    """Return the classes that the section at a path may have, by the kinds of the sections around it."""
    if not path:
        return [Scenario]
    above, key = parent_of(path)
    if key.isdecimal():
        return classes_at(data, above)
    owner = model_at(data, above)
    if owner is None or key not in owner.model_fields:
        return []
    return list(dict.fromkeys(part for part, _ in models_in(owner.model_fields[key])))


def names(data: Mapping[str, Any]) -> dict[str, str]:
    """Return a name of each section and object by its path in the text, for plan, forms and messages.

    Objects of one kind are numbered from 1 in the order of the text: the only outlet is "outlet 1".
    """
    counts: Counter[str] = Counter()
    found: dict[str, str] = {}
    taken = set()
    for path, noun, name in [*_unplaced(data), ("domain", "room", "room"), *_paths(data)]:
        counts[noun] += 1
        numbered = f"{noun} {counts[noun]}"
        if name is None:
            name = numbered
        elif name in taken:
            name = f"{name} ({numbered})"
        taken.add(name)
        found[path] = theme.short("".join(c if c.isprintable() else "?" for c in name))
    return found


def named(line: str, by_path: Mapping[str, str]) -> str:
    """Return a line of the checks with the names of objects instead of their paths; by_path: see `names`.

    >>> named("obstacles[1].center: (9, 1) m is outside", {"obstacles[1]": "box 1"})
    'box 1, center: (9, 1) m is outside'
    """

    def replaced(match: re.Match[str]) -> str:
        path, kind = match["path"], match["kind"] or ""
        items = [path[: end.end()] for end in re.finditer(r"\]", path)]
        item = max((item for item in items if item in by_path), key=len, default="")
        if not item:
            return match[0]
        name, rest = by_path[item], path[len(item) :].lstrip(".")
        kind = "" if kind and name.startswith(kind[2:-1]) else kind  # not "box 1 (box)"
        return f"{name}, {rest}{kind}" if rest else f"{name}{kind}"

    return _ITEM.sub(replaced, line)


Entry = tuple[str, str, str | None]
"""Path of a section or object, the noun of its kind, and its own name; None if it is numbered."""


def _unplaced(data: Mapping[str, Any]) -> Iterator[Entry]:
    """Yield the sections that have no position in the room, the experiment itself first."""
    yield "", "experiment", "experiment"
    for key, about in Scenario.model_fields.items():
        if key in ("domain", "arena", "obstacles", "robots") or not any(models_in(about)):
            continue
        items = data.get(key)
        if isinstance(items, list):
            yield from ((f"{key}[{n}]", key.removesuffix("s"), None) for n in range(len(items)))
        elif key in data:
            yield key, key, key.replace("_", " ")
    parts = _items(data, "gas.parts")
    yield from ((f"gas.parts[{n}]", "gas part", f"gas {n + 1}") for n in range(len(parts)))


def _paths(data: Mapping[str, Any]) -> Iterator[Entry]:
    """Yield the objects in the order of drawing: what lies on top comes last."""
    if isinstance(data.get("arena"), dict):
        yield "arena", "arena", "arena"
    for key in LISTS:
        for n, item in enumerate(_items(data, key)):
            noun = {"wind.buoyancy.heat.heaters": "heater", "wind.buoyancy.heat.walls": "warm wall"}.get(key)
            yield f"{key}[{n}]", noun or _kind(item, key), None
    yield from _sources(data, "gas", data.get("gas"))
    for n, item in enumerate(_items(data, "probes.points")):
        name = _name(item)
        yield f"probes.points[{n}]", "probe", None if name is None else f"probe {name}"
    for n, item in enumerate(_items(data, "robots")):
        yield f"robots[{n}]", "robots", _name(item)


def _sources(data: Mapping[str, Any], path: str, gas: Any) -> Iterator[Entry]:
    if not isinstance(gas, dict):
        return
    for key in ("sources", "releases"):
        for n, _ in enumerate(_items(data, f"{path}.{key}")):
            yield f"{path}.{key}[{n}]", "source", None
    parts = gas.get("parts")
    for n, part in enumerate(parts if isinstance(parts, list) else ()):
        yield from _sources(data, f"{path}.parts[{n}]", part)


def _items(data: Mapping[str, Any], path: str) -> list[Any]:
    items = value_at(data, path)
    return items if isinstance(items, list) else []


def _kind(item: Any, key: str) -> str:
    kind = item.get("kind") if isinstance(item, dict) else None
    noun = {"obstacles": "obstacle", "wind.screens": "screen"}.get(key, "opening")
    return kind if isinstance(kind, str) else noun


def _name(item: Any) -> str | None:
    name = item.get("name") if isinstance(item, dict) else None
    return name if isinstance(name, str) else None


def _part(
    data: Mapping[str, Any], path: str, model: Any, room: tuple[float, ...], folder: Path
) -> Part | None:
    if path.startswith("robots["):
        start = read(data, f"{path}.start")
        return None if start is None else start_part(model if isinstance(model, Group) else None, start, room)
    if model is None:
        return None
    if path.startswith("obstacles["):
        return Body(model, room, shape_of(model, room, folder))
    if path.startswith("probes"):
        return probe_part(model, room)
    if path == "arena":
        return Rectangle(model, room)
    if path.startswith(("wind.openings", "wind.screens", "wind.buoyancy.heat.walls")):
        if vars(model).get("kind") == "periodic":
            return Wrapped(model, room)
        return Pane(model, room) if model.normal < len(room) else None
    return Points(model, room, ("position",))


def shape_of(model: Any, room: tuple[float, ...], folder: Path) -> Shape:
    """Return the shape of an obstacle; its file is read again only if it has changed. Raises ShapeError, OSError."""
    if "file" not in vars(model):
        return shape(model, Domain(size=room, spacing=min(room)), folder)
    file = folder / model.file
    admit(file)  # before the cache answers
    return _shape_of_file(model, room, folder, _stamp(file))


@lru_cache(CACHED_SHAPES)
def _shape_of_file(model: Any, room: tuple[float, ...], folder: Path, _: tuple[int, int] | None) -> Shape:
    return shape(model, Domain(size=room, spacing=min(room) / 100), folder)


def _mark(data: Mapping[str, Any], path: str) -> Point | None:
    """Return about where an unreadable object is, from above; None if no key says so."""
    for key in PLACES:
        value = value_at(data, f"{path}.{key}")
        if isinstance(value, list) and len(value) >= 2:
            try:
                return metres(value[0]), metres(value[1])
            except ValueError:
                continue
    return None


def _color(data: Mapping[str, Any], path: str, model: Any) -> str:
    if path.startswith("robots["):
        groups, number = _items(data, "robots"), int(path[7:-1])
        counts = [group.get("count") if isinstance(group, dict) else 1 for group in groups[:number]]
        return theme.robot(sum(count for count in counts if isinstance(count, int) and 0 < count < 1000))
    if path.startswith("wind.buoyancy.heat"):
        return theme.WARM
    if path.startswith("wind.") and hasattr(model, "color"):
        return "#" + "".join(f"{round(255 * part):02x}" for part in theme.darker(model.color))
    if path.startswith("probes"):
        return theme.PROBE
    return {"gas": theme.SOURCE, "arena": theme.FAINT}.get(path.partition(".")[0], theme.SOLID)
