"""Solvers for cases and benchmarks, made from the keys of a scenario: flow, uniform wind, gas on the grid, puffs."""

from collections.abc import Iterator
from math import ceil

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import Carrier, Wind
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.gases import EulerianGas, PuffGas
from taichi_plume.scenario.winds import CfdWind, UniformWind
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.gas import EulerianSolver
from taichi_plume.solvers.openings import periodic_axes
from taichi_plume.solvers.puffs import PuffSolver
from taichi_plume.solvers.uniform_wind import UniformSolver

Openings = list[dict] | tuple[dict, ...]


def cfd(openings: Openings, **keys: object) -> CfdWind:
    """Return the section of a computed wind with these openings; `keys`: further keys of the section."""
    return CfdWind.model_validate({"kind": "cfd", "openings": openings} | keys)


def tunnel(**inlet: object) -> dict[str, object]:
    """Return the section of the wind in a tunnel along x, periodic across; inlet: keys of the honeycomb that blows."""
    return {
        "kind": "cfd",
        "openings": [
            {"kind": "honeycomb", "face": "x-"} | inlet,
            {"kind": "honeycomb", "face": "x+"},
            {"kind": "periodic", "axis": "y"},
            {"kind": "periodic", "axis": "z"},
        ],
    }


def flow_on(wind: CfdWind, shape: tuple[int, ...], dx: float, seed: int = 0) -> FlowSolver:
    """Return the flow solver of a wind in an empty box of cells of edge `dx` [m]."""
    grid = Grid(shape, dx, periodic=periodic_axes(wind.openings, len(shape)))
    return FlowSolver(wind, grid, Air.everywhere(grid), seed=seed)


def uniform(grid: Grid, speed: float) -> UniformSolver:
    """Return a uniform wind of `speed` [m/s] along x."""
    return UniformSolver(UniformWind(kind="uniform", velocity=(speed,) + (0.0,) * (grid.dim - 1)), grid)


def ethanol(diffusivity: float) -> dict[str, float]:
    """Return the species section of a gas with the molar mass of ethanol and this diffusivity [m²/s]."""
    return {"molar_mass": 0.046, "diffusivity": diffusivity}


def gas_on(
    grid: Grid, wind: Carrier, air: Air | None = None, seed: int = 0, name: str = "gas", **keys: object
) -> EulerianSolver:
    """Return gas on the grid in a wind; `keys`: of the gas section. Without `sources` nothing is emitted."""
    sources = {"sources": [{"position": (0.5 * grid.dx,) * grid.dim, "rate": 0.0}]}
    model = EulerianGas.model_validate({"kind": "eulerian"} | sources | keys)
    return EulerianSolver(model, grid, wind, air or Air.everywhere(grid), 0.0, seed, name)


def puffs_on(
    grid: Grid, wind: Wind, air: Air | None = None, seed: int = 0, name: str = "gas", **keys: object
) -> PuffSolver:
    """Return gas as puffs in a wind; `keys`: of the gas section."""
    model = PuffGas.model_validate({"kind": "puffs"} | keys)
    return PuffSolver(model, grid, wind, air or Air.everywhere(grid), 0.0, seed, name)


def advance(flow: FlowSolver, end: float, start: float = 0.0) -> None:
    """Advance a flow from `start` to `end` [s] in time steps within the Courant limit."""
    t = start
    while end - t > 1e-9 * end:
        dt = (end - t) / ceil((end - t) / flow.stable_dt())
        flow.advance(t, dt)
        t += dt


def samples(flow: FlowSolver, start: float, every: float, count: int) -> Iterator[int]:
    """Advance a flow `count` times by `every` [s] from `start` [s] on; yield the index of each sample."""
    for k in range(count):
        advance(flow, start + (k + 1) * every, start + k * every)
        yield k
