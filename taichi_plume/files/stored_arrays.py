"""Arrays in files of other programs, opened but not read, with the names of their axes, coordinates and attributes.

The coordinate of an axis is the array of its name, or another one along it, such as x(i), also in a group above.
Axes without names get those of arrays beside, if their lengths fit in only one order. MATLAB's files have the axes of
an array in reverse.
"""

import itertools
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.files.conventions import (
    role_of,
    split_unit,
    text_of,
    unit_of,
    unpacked,
)
from taichi_plume.guard.terminal import visible

Values = Any
"""An array of zarr, h5py, SciPy or NumPy."""
MOST_ALONG = 10_000_000  # values of a coordinate
HELD = "biufUS"  # kinds of attributes that are read
GENERIC = re.compile(r"(phony_)?dim_?\d+", re.IGNORECASE)  # names of axes that say nothing
LISTS = ("dimensions", "dims", "axes", "dimension_names", "dimension_order")  # attributes with names of axes


class ArrayFileError(ValueError):
    """Error: a file holds no array that can be read; the message is one line and begins with the path."""


@dataclass(frozen=True)
class Beside:
    """Array beside another, as stored: values (n,) along an axis, its edges (n + 1,) or bounds (n, 2).

    axes: names of its own axes, () without names.
    """

    values: np.ndarray
    attributes: Mapping[str, Any] = field(default_factory=dict)
    axes: tuple[str, ...] = ()

    @property
    def is_number(self) -> bool:
        """Whether the values only number pixels or frames: a step of 1 without a unit."""
        return not unit_of(self.attributes) and bool((np.abs(np.diff(self.values.astype(float))) == 1).all())


@dataclass(frozen=True)
class Coordinate:
    """Positions (n,) along an axis, unpacked; empty without a coordinate. unit: as stated, or in the name.

    resolution: rounding error of the stored numbers, in the unit.
    """

    values: np.ndarray = field(default_factory=lambda: np.empty(0))
    unit: str = ""
    resolution: float = 0.0
    attributes: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Arrangement:
    """Order of the axes: role of each, "" for further ones of length 1. is_sure: names or lengths decide it."""

    roles: tuple[str, ...]
    is_sure: bool
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class StoredArray:
    """Array that is not read yet. chunks: shape of a chunk; a whole frame for arrays without chunks.

    attributes: of the array; of_file: of its groups and file. axes: name of each axis, "" where the file has none.
    beside: arrays that may be coordinates, by name. form: name of the format. name: of the array.
    """

    values: Values
    chunks: tuple[int, ...]
    form: str
    attributes: Mapping[str, Any] = field(default_factory=dict)
    of_file: Mapping[str, Any] = field(default_factory=dict)
    axes: tuple[str, ...] = ()
    beside: Mapping[str, Beside] = field(default_factory=dict)
    name: str = ""

    @property
    def shape(self) -> tuple[int, ...]:
        """Lengths of the axes."""
        return tuple(self.values.shape)

    def along(self, n: int) -> Coordinate:
        """Return the coordinate of axis n: centres, also from edges or bounds. Raises ConventionError."""
        name, count = self.axes[n], self.shape[n]
        found = self.beside.get(name)
        if found is None or found.values.ndim != 1 or len(found.values) not in (count, count + 1):
            return Coordinate()
        values, stored = unpacked(found.values, found.attributes), found.values
        bounds = self.beside.get(text_of(found.attributes.get("bounds", "")))
        if bounds is not None and bounds.values.shape == (count, 2):
            values = unpacked(bounds.values, {**found.attributes, **bounds.attributes}).mean(axis=1)
        elif len(values) == count + 1:
            values = (values[1:] + values[:-1]) / 2
        resolution = 0.0
        if stored.dtype.kind == "f" and len(stored):
            largest = np.nanmax(np.abs(stored), initial=0.0)
            resolution = float(np.spacing(stored.dtype.type(largest)))
            resolution *= abs(float(text_of(found.attributes.get("scale_factor", 1.0))))
        return Coordinate(
            values, unit_of(found.attributes) or split_unit(name)[1], resolution, found.attributes
        )

    def arranged(
        self, usual: Sequence[str], given: Sequence[str] | None = None
    ) -> tuple["StoredArray", Arrangement]:
        """Return the array with axes named by their coordinates, and their roles ("time", "y", "x").

        usual: roles, in the order that is assumed for axes without a known name. given: the order that the user gives,
        which counts where names and lengths leave several. Raises ArrayFileError, without the path, if the axes do not
        have each role once.
        """
        axes = self.axes
        if all(not axis or GENERIC.fullmatch(axis) for axis in axes):
            axes = _listed_axes(self.attributes, len(axes)) or axes
        known = _known_roles(axes, self.beside)
        single = [n for n, length in enumerate(self.shape) if length == 1 and known[n] not in usual]
        single.sort(key=lambda n: known[n] is None)
        dropped = single[: max(0, len(axes) - len(usual))]
        left = [n for n in range(len(axes)) if n not in dropped]
        orders = self._orders([(axes[n], self.shape[n], known[n]) for n in left], usual)
        first = tuple(given or usual)
        remarks = []
        if not orders:
            named = ", ".join(f"{name or '?'}: {n}" for name, n in zip(axes, self.shape, strict=True))
            if given is None or len(left) != len(usual):
                raise ArrayFileError(f"has the axes ({visible(named, 80)}); {', '.join(usual)} are wanted")
            remarks.append(
                f"axes: {', '.join(given)}, but the file has ({visible(named, 80)}); the key counts"
            )
            orders = {first: [None] * len(usual)}
        order = first if first in orders else next(iter(orders))
        if given and order != first:
            remarks.append(f"axes: {', '.join(given)}, but the file has {', '.join(order)}; the file counts")
        roles, names = [""] * len(axes), list(axes)
        for n, role, found in zip(left, order, orders[order], strict=True):
            roles[n] = role
            names[n] = found or axes[n] or (role if len(orders) == 1 else "")
            if axes[n] and not found and not known[n] and not GENERIC.fullmatch(axes[n]) and not given:
                remarks.append(f"its axis '{visible(axes[n], 40)}' counts as {role}")
        is_sure = len(orders) == 1 or order == given
        return replace(self, axes=tuple(names)), Arrangement(tuple(roles), is_sure, tuple(remarks))

    def _orders(
        self, axes: Sequence[tuple[str, int, str | None]], usual: Sequence[str]
    ) -> dict[tuple[str, ...], list[str | None]]:
        """Return the possible orders of roles, with the array that is the coordinate of each axis, if any."""
        if len(axes) != len(usual):
            return {}
        orders: dict[tuple[str, ...], list[str | None]] = {}
        for order in itertools.permutations(usual):
            if all(role in (known, known or role) for role, (_, _, known) in zip(order, axes, strict=True)):
                orders[order] = [
                    self._coordinate_of(axis, n, role) for role, (axis, n, _) in zip(order, axes, strict=True)
                ]

        def score(found: list[str | None]) -> tuple[int, int]:
            pairs = [(name, n) for name, (_, n, _) in zip(found, axes, strict=True) if name]
            return len(pairs), sum(len(self.beside[name].values) == n for name, n in pairs)

        best = max(map(score, orders.values()), default=(0, 0))
        return {order: found for order, found in orders.items() if score(found) == best}

    def _coordinate_of(self, axis: str, count: int, role: str) -> str | None:
        """Return the name of the array that is the coordinate of an axis in this role, if there is one."""
        found = []
        for name, other in self.beside.items():
            size = len(other.values)
            is_own = name == axis and size in (count, count + 1)
            if other.values.ndim != 1 or not (is_own or role_of(name, other.attributes) == role):
                continue
            fits = size == count and other.axes in ((), (axis,))
            edges = size == count + 1 and not {*other.axes} & {*self.axes}
            if is_own or fits or edges:
                found.append((size != count, other.is_number, not is_own, name))
        return min(found)[-1] if found else None


def stored_array(
    path: Path,
    form: str,
    opened: Mapping[str, Callable[[], Values]],
    about: Callable[[Values], tuple[tuple[str, ...], Mapping[str, Any]]],
    of_group: Callable[[str], Mapping[str, Any]],
    variable: str | None,
    usual: Sequence[str],
    scales: Callable[[Values], Mapping[str, str]] = lambda _: {},
) -> StoredArray:
    """Return the array that `chosen` names, with the arrays of its group and of those above that may be coordinates.

    opened: function that opens each array, by its path in the file; about: function that returns the names of an
    array's axes, () without names, and its attributes; of_group: attributes of a group; scales: paths of further
    coordinates of an array. Raises ArrayFileError, and the errors of `opened`.
    """
    given = (variable or "").strip("/") or None
    arrays = {name: each for name, function in opened.items() if (each := _if_readable(function)) is not None}
    shapes = {name: tuple(arrays[name].shape) if name in arrays else () for name in opened}
    name = chosen(path, sorted(shapes) if given else cubes(shapes), given, usual)
    array = opened[name]()
    axes, attributes = about(array)
    near, of_file = {}, {}
    for group in groups_of(name):
        of_file |= plain(of_group(group))
        near |= {each.rpartition("/")[2]: each for each in arrays if each.rpartition("/")[0] == group}
    beside = {}
    for own, whole in (near | dict(scales(array))).items():
        if (
            whole != name
            and is_beside(shapes[whole], array.shape, own in axes)
            and arrays[whole].dtype.kind in "fiu"
        ):
            along, stated = about(arrays[whole])  # before it is read: refuses arrays that lie in other files
            values = np.asarray(arrays[whole][...])
            values = values.ravel() if values.size == max(values.shape) else values  # MATLAB has (1, n)
            beside[own] = Beside(values, plain(stated), along)
    chunks = getattr(array, "chunks", None) or (1, *array.shape[1:])
    return StoredArray(
        array, chunks, form, plain(attributes), of_file, axes or ("",) * array.ndim, beside, name
    )


def _if_readable(opened: Callable[[], Values]) -> Values | None:
    try:
        return opened()
    except Exception:  # foreign arrays cause any error, which is reported if this array is chosen
        return None


def is_beside(other: Sequence[int], shape: Sequence[int], is_axis: bool) -> bool:
    """Return whether an array of shape `other` may be a coordinate of one of `shape`, edges or bounds.

    is_axis: it has the name of an axis.
    """
    size = math.prod(other)
    if not 0 < size <= MOST_ALONG:
        return False
    if size == max(other, default=0):
        return is_axis or (size > 1 and any(size in (n, n + 1) for n in shape))
    return len(other) == 2 and other[1] == 2 and other[0] in shape


def chosen(path: Path, names: list[str], variable: str | None, usual: Sequence[str]) -> str:
    """Return the variable to read among `names`: the given or the usual one. Raises ArrayFileError if there is none."""
    here = [name for each in usual for name in names if name.rpartition("/")[2].lower() == each]
    if variable is None and (len(here) == 1 or len(names) == 1):
        return (here or names)[0]
    if variable is None and here and "/" not in here[0]:
        return here[0]
    if variable in names:
        return variable
    held = f"its variables: {visible(', '.join(names[:10]), 200)}" if names else "it has no variable"
    names_of = " nor ".join(f"'{name}'" for name in usual) or "'array'"
    missing = f"no '{visible(variable, 40)}'" if variable else f"neither {names_of}"
    raise ArrayFileError(f"{path}: has {missing}; {held}; give the name of one")


def cubes(shapes: Mapping[str, tuple[int, ...]]) -> list[str]:
    """Return the names of the arrays with three axes or more, or else of all."""
    return sorted(name for name, shape in shapes.items() if len(shape) > 2) or sorted(shapes)


def groups_of(name: str) -> Iterator[str]:
    """Yield the paths of the groups that hold array `name`, from the root "" on."""
    parts = name.split("/")[:-1]
    for n in range(len(parts) + 1):
        yield "/".join(parts[:n])


def plain(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Return the attributes that are texts, numbers or lists of these; bytes as texts."""
    known = {}
    for key, value in attributes.items():
        value = value.decode("utf-8", "replace") if isinstance(value, bytes) else value
        if isinstance(value, np.ndarray) and value.dtype.kind in "SO":
            texts = [text_of(each) for each in value.ravel()]
            known[key] = np.array(texts) if texts else ""
        elif isinstance(value, np.ndarray | np.generic):
            if value.dtype.kind in HELD:
                known[key] = value
        elif isinstance(value, str | int | float | list | tuple):
            known[key] = value
    return known


def _known_roles(axes: Sequence[str], beside: Mapping[str, Beside]) -> list[str | None]:
    """Return the role of each axis by its name and its coordinate's attributes; a height beside a width is y."""
    known = [
        role_of(name, beside[name].attributes if name in beside else {}) if name else None for name in axes
    ]
    lower = [name.lower() for name in axes]
    if "width" in lower and "height" in lower and "y" not in known:
        known[lower.index("height")] = "y"
    return known


def _listed_axes(attributes: Mapping[str, Any], count: int) -> tuple[str, ...] | None:
    """Return the names of `count` axes in an attribute: a list, a text such as "time, x, y", or letters such as TYX."""
    lower = {name.lower(): value for name, value in attributes.items()}
    for name in LISTS:
        value = lower.get(name, ())
        if isinstance(value, dict):
            continue
        items = [
            item.get("name", "") if isinstance(item, dict) else text_of(item) for item in np.ravel(value)
        ]
        if len(items) == 1:
            items = [part for part in re.split(r"[\s,;()\[\]'\"]+", items[0]) if part]
        if len(items) == 1 and len(items[0]) == count:
            items = list(items[0])
        if len(items) == count and sum(role_of(item) is not None for item in items) > 1:
            return tuple(items)
    return None
