"""Small winds, gases and obstacles that the tests of several solvers share."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import Gas
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.gases import EulerianGas
from taichi_plume.scenario.winds import CfdWind
from taichi_plume.solvers.flow import FlowSolver

TUNNEL = [{"kind": "honeycomb", "face": "x-", "speed": 0.7}, {"kind": "honeycomb", "face": "x+"}]
LAMINAR: dict[str, Any] = {"turbulence": {"kind": "none"}}


def cfd(openings: Sequence[dict] = (), **keys: Any) -> CfdWind:
    return CfdWind.model_validate({"kind": "cfd", "openings": openings} | keys)


def eulerian(position: Sequence[float] = (0.5, 0.1), rate: float = 0.0, **keys: Any) -> EulerianGas:
    """Gas on the grid of one source; keys: of the gas, and the source's radius."""
    source = {"position": position, "rate": rate} | {k: keys.pop(k) for k in ("radius",) if k in keys}
    return EulerianGas.model_validate({"kind": "eulerian", "sources": [source]} | keys)


def blocks(shape: tuple[int, ...], *cells: Any) -> np.ndarray:
    """Which cells are solid: those of each index."""
    solid = np.zeros(shape, bool)
    for index in cells:
        solid[index] = True
    return solid


def air_in(grid: Grid, solid: np.ndarray | None = None) -> Air:
    return Air.everywhere(grid) if solid is None else Air.of(solid, grid)


def flow_in(grid: Grid, wind: CfdWind, solid: np.ndarray | None = None, **parts: Any) -> FlowSolver:
    return FlowSolver(wind, grid, air_in(grid, solid), **parts)


def march(which: int | tuple[int, int], dt: float, *parts: Any) -> None:
    """Advance parts, one after the other, by so many steps of dt [s], or by those from one number to another."""
    for n in range(*(which if isinstance(which, tuple) else (which,))):
        for part in parts:
            part.advance(n * dt, dt)


def through_faces(wind: Any) -> list[np.ndarray]:
    """Velocity [m/s] through every face of the domain of a wind on the grid, times the open fraction of the face."""
    grid, result = wind.grid, []
    for d, u in enumerate(wind.u):
        inner = tuple(slice(1, n + 1 + (a == d)) for a, n in enumerate(grid.shape))
        share = 1.0 if wind.area is None else grid.read(wind.area[d], 1)[inner]
        result.append(grid.read(u, 1)[inner].astype(float) * share)
    return result


def divergence(wind: Any) -> float:
    """Largest net flow out of a cell over the largest flow through a face."""
    u = through_faces(wind)
    net = sum(np.diff(v, axis=d) for d, v in enumerate(u))
    return float(np.abs(net).max() / max(np.abs(v).max() for v in u))


def largest_outflow(wind: Any) -> float:
    """Largest flow out of a cell over its volume [1/s]."""
    out = sum(
        np.maximum(np.delete(u, 0, axis=d), 0.0) - np.minimum(np.delete(u, -1, axis=d), 0.0)
        for d, u in enumerate(through_faces(wind))
    )
    return np.max(out) / wind.grid.dx


def missing(gas: Gas) -> float:
    """Mass that is neither in the domain nor gone through its faces, over that emitted."""
    budget = gas.budget()
    return (budget["emitted_kg"] - budget["in_domain_kg"] - budget["outflow_kg"]) / budget["emitted_kg"]


def assert_same(found: Iterable[np.ndarray], expected: Iterable[np.ndarray]) -> None:
    """All arrays are equal to the bit."""
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_array_equal(a, b)
