"""Arrays in files of other programs, opened but not read, with the names of their axes, coordinates and attributes.

Axes without names get those of coordinates beside the array, if their lengths fit in only one order. MATLAB's files
have the axes of an array in reverse.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.files.conventions import role_of
from taichi_plume.guard.terminal import visible

Values = Any
"""An array of zarr, h5py, SciPy or NumPy."""
Coordinate = tuple[np.ndarray, Mapping[str, Any]]
"""Values (n,) along an axis, and attributes."""
MOST_ALONG = 10_000_000  # values of a coordinate
HELD = "biufUS"  # kinds of attributes that are read


class ArrayFileError(ValueError):
    """Error: a file holds no array that can be read; the message is one line and begins with the path."""


@dataclass(frozen=True)
class StoredArray:
    """Array that is not read yet. chunks: shape of a chunk; a whole frame for arrays without chunks.

    attributes: of the array; of_file: of its group and file. axes: name of each axis, "" where the file has none.
    coordinates: values (n,) along an axis and their attributes, by the name of the axis. form: name of the format.
    """

    values: Values
    chunks: tuple[int, ...]
    form: str
    attributes: Mapping[str, Any]
    of_file: Mapping[str, Any]
    axes: tuple[str, ...]
    coordinates: Mapping[str, Coordinate]

    @property
    def shape(self) -> tuple[int, ...]:
        """Lengths of the axes."""
        return tuple(self.values.shape)

    def along(self, n: int) -> Coordinate:
        """Return the coordinate of axis n; empty without one."""
        return self.coordinates.get(self.axes[n], (np.empty(0), {}))

    def roles(self, usual: Sequence[str]) -> tuple[tuple[str, ...], bool]:
        """Return the role ("time", "y", "x") of each axis, "" for further ones of length 1, and whether it is stated.

        usual: roles, in the order that is assumed for axes without a known name. Raises ArrayFileError, without the
        path, if the axes do not have each role once.
        """
        known = [
            role_of(name, self.coordinates.get(name, (None, {}))[1]) if name else None for name in self.axes
        ]
        single = [n for n, length in enumerate(self.shape) if length == 1 and known[n] not in usual]
        single.sort(key=lambda n: known[n] is None)
        left = iter([role for role in usual if role not in known])
        roles = [role or "" for role in known]
        dropped = single[: max(0, len(known) - len(usual))]
        for n, role in enumerate(known):
            roles[n] = "" if n in dropped else role or next(left, "?")
        if sorted(role for role in roles if role) != sorted(usual):
            named = ", ".join(f"{name or '?'}: {n}" for name, n in zip(self.axes, self.shape, strict=True))
            raise ArrayFileError(f"has the axes ({visible(named, 80)}); {', '.join(usual)} are wanted")
        return tuple(roles), None not in [known[n] for n in range(len(known)) if n not in dropped]


def chosen(path: Path, names: list[str], variable: str | None, usual: Sequence[str]) -> str:
    """Return the variable to read among `names`: the given or the usual one. Raises ArrayFileError if there is none."""
    here = [name for each in usual for name in names if name.rpartition("/")[2] == each]
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


def among(name: str, names: Sequence[str]) -> dict[str, str]:
    """Return the arrays in the group of array `name` by their own names, other than it."""
    group = name.rpartition("/")[0]
    return {
        each.rpartition("/")[2]: each for each in names if each.rpartition("/")[0] == group and each != name
    }


def with_beside(
    axes: Sequence[str],
    shape: Sequence[int],
    usual: Sequence[str],
    beside: Mapping[str, Coordinate],
) -> tuple[str, ...]:
    """Return the names of axes; those without a name get that of a coordinate beside, if only one order fits."""
    if any(axes) or len(shape) != len(usual):
        return tuple(axes)
    by_role: dict[str, str] = {}
    for name, (_, attributes) in beside.items():
        role = role_of(name, attributes)
        if role is not None and role in usual:
            by_role.setdefault(role, name)

    def fits(order: Sequence[str]) -> bool:
        pairs = zip(order, shape, strict=True)
        return all(role not in by_role or len(beside[by_role[role]][0]) == n for role, n in pairs)

    orders = [usual] if fits(usual) else [order for order in itertools.permutations(usual) if fits(order)]
    return (
        tuple(by_role.get(role, role) for role in orders[0]) if by_role and len(orders) == 1 else tuple(axes)
    )


def plain(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Return the attributes that are texts, numbers or lists of these; bytes as texts."""
    known = {}
    for key, value in attributes.items():
        value = value.decode("utf-8", "replace") if isinstance(value, bytes) else value
        if isinstance(value, np.ndarray | np.generic) and value.dtype.kind in HELD:
            known[key] = value.astype("U") if value.dtype.kind == "S" else value
        elif isinstance(value, str | int | float | list | tuple):
            known[key] = value
    return known
