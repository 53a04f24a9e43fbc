# ruff: noqa: D102
"""What a scenario's files and obstacles are made of, as its checks see it; `taichi_plume.prepare` makes it."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from taichi_plume.grid.shapes import Shape


class Film(Protocol):
    """A recorded run: shape, dx [m] and depth [m] are its grid's, times [s] those of its frames; wind and gas name what
    it holds of them.
    """

    @property
    def path(self) -> Path: ...
    @property
    def shape(self) -> tuple[int, ...]: ...
    @property
    def dx(self) -> float: ...
    @property
    def depth(self) -> float: ...
    @property
    def times(self) -> np.ndarray: ...
    @property
    def wind(self) -> list[str]: ...
    @property
    def gas(self) -> list[str]: ...


class Frames(Protocol):
    """Frames of points: their places (n, 2) [m], how far each reaches, `cell` [m], and how long one is shown [s]."""

    @property
    def path(self) -> Path: ...
    @property
    def period(self) -> float: ...
    @property
    def cell(self) -> float: ...
    @property
    def place(self) -> np.ndarray: ...
    def __len__(self) -> int: ...


class Cubes(Protocol):
    """The obstacles of an occupancy grid, cubes of `size` [m] between its corners `low` and `high` [m]."""

    @property
    def low(self) -> np.ndarray: ...
    @property
    def high(self) -> np.ndarray: ...
    @property
    def size(self) -> float: ...
    @property
    def solid(self) -> np.ndarray: ...
    def inside(self, points: np.ndarray, tie: float = 0.0) -> np.ndarray: ...
    def horizontal_distance(self, points: np.ndarray, low: float, high: float) -> np.ndarray: ...


class Points(Protocol):
    """The points of a file."""

    @property
    def path(self) -> Path: ...


class Site(Protocol):
    """Files of an imported wind, and how they lie in the domain; see files/site.py."""

    @property
    def files(self) -> Sequence[tuple[float, Path]]: ...
    @property
    def first(self) -> Points: ...
    @property
    def low(self) -> np.ndarray: ...
    @property
    def high(self) -> np.ndarray: ...
    @property
    def origin(self) -> np.ndarray: ...
    @property
    def slack(self) -> float: ...
    @property
    def levels(self) -> tuple[float, float]: ...
    @property
    def cubes(self) -> Cubes | None: ...


class Resources(Protocol):
    """What a scenario's files and obstacles are made of, each opened once, by the paths of the sections that name them.

    faults: what is wrong with those that cannot be used. shapes: of the obstacles without a fault, in their order.
    """

    @property
    def faults(self) -> Mapping[str, str]: ...
    @property
    def shapes(self) -> Mapping[str, Shape]: ...
    @property
    def films(self) -> Mapping[str, Film]: ...
    @property
    def frames(self) -> Mapping[str, Frames]: ...
    @property
    def site(self) -> Site | None: ...

    def unlike(self, path: str) -> int:
        """Number of cells whose air is not as in the film of that section."""
        ...

    def solid(self) -> np.ndarray:
        """Which cells of an imported wind's grid hold no air, where its outlets count as none."""
        ...
