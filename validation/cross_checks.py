"""Conservation of volume at boundary conditions: inflow as prescribed, outflow equal to inflow, 2-D as a layer."""

from functools import partial
from math import pi

import numpy as np

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.grid import Grid
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.validation.case import Case, Expected
from taichi_plume.validation.flow_cases import Errors, advance, velocities
from taichi_plume.validation.setups import cfd

SLIP = [{"kind": "slip", "face": face} for face in ("z-", "z+")]


def room(shape: tuple[int, ...], dx: float, openings: list[dict]) -> FlowSolver:
    """Return the flow of a room with a box a third from the inflow; in 3-D the box stands on the floor."""
    solid = np.zeros(shape, bool)
    box = ((0.3, 0.4), (0.4, 0.7), (0.0, 0.6))[: len(shape)]
    solid[tuple(slice(round(a * n), round(b * n)) for n, (a, b) in zip(shape, box, strict=True))] = True
    grid = Grid(shape, dx, depth=dx)
    return FlowSolver(cfd(openings), grid, Air.of(solid, grid))


def air_balance(flow: FlowSolver, given: float) -> Errors:
    """Return relative errors of the flow rate through faces x = const against `given` [m³/s], and the divergence."""
    u = flow.u[0].to_numpy().astype(float)
    g, n = flow.grid.ghost, flow.grid.shape[0]
    inner = tuple(slice(begin, end) for begin, end in flow.grid.cells[1:])
    through = (
        u[(slice(g, g + n + 1), *inner)].reshape(n + 1, -1).sum(axis=1) * flow.grid.cell_volume / flow.grid.dx
    )
    return {
        "inflow": float(abs(through[0] / given - 1.0)),
        "net flow of the openings": float(abs(through[-1] - through[0]) / given),
        "flow through any section": float(np.abs(through / given - 1.0).max()),
        "divergence": flow.diagnostics()["max_divergence"],
    }


def honeycombs(n: int, dim: int) -> Errors:
    """Return errors of the air balance of a room, 4 x 3 (x 0.5) m, between two honeycomb walls; n cells along x."""
    speed = 0.7
    openings = [
        {"kind": "honeycomb", "face": "x-", "speed": speed},
        {"kind": "honeycomb", "face": "x+", "loss_coefficient": 2.0},
    ]
    flow = room((n, 3 * n // 4, n // 8)[:dim], 4.0 / n, openings)
    advance(flow, 1.0)
    face = flow.grid.cell_volume / flow.grid.dx * np.prod(flow.grid.shape[1:])
    return air_balance(flow, speed * float(face))


def fan(n: int) -> Errors:
    """Return errors of the air balance of a fan with swirl, 0.3 m wide, in a room of 1.2 x 1 x 0.8 m; n cells per
    metre.
    """
    speed, diameter = 2.0, 0.3
    blower = {"kind": "fan", "face": "x-", "center": (0.5, 0.4), "diameter": diameter, "speed": speed}
    blower |= {"swirl": 0.3, "turbulence_intensity": 0.1}
    openings = [blower, {"kind": "outlet", "face": "x+"}]
    flow = room((round(1.2 * n), n, round(0.8 * n)), 1.0 / n, openings)
    advance(flow, 0.2)
    return air_balance(flow, speed * pi / 4.0 * diameter**2)


def one_layer(n: int) -> Errors:
    """Return the difference of 2-D flow around an obstacle from a layer of 3-D cells between slip walls; n along x."""
    openings = [{"kind": "honeycomb", "face": "x-", "speed": 0.7}, {"kind": "honeycomb", "face": "x+"}]
    flows = [
        room((n, 3 * n // 4), 4.0 / n, openings),
        room((n, 3 * n // 4, 1), 4.0 / n, openings + SLIP),
    ]
    for flow in flows:
        for step in range(20):
            flow.advance(0.01 * step, 0.01)
    plane, layer = (velocities(flow) for flow in flows)
    apart = max(float(np.abs(a - b[..., 0]).max()) for a, b in zip(plane, layer[:2], strict=True))
    return {"u / u_max, largest": apart / flows[0].max_speed}


AIR_BALANCE = {
    "inflow": Expected(tolerance=1e-5),
    "net flow of the openings": Expected(tolerance=1e-6),
    "flow through any section": Expected(tolerance=1e-5),
    "divergence": Expected(tolerance=1e-4),
}


def _room(dim: int) -> Case:
    return Case(
        f"room_{dim}d",
        "from one honeycomb wall to the other, around a box",
        "conservation of mass",
        partial(honeycombs, dim=dim),
        evidence="exact",
        coarse=(40,) if dim == 2 else (16,),
        fine=(80,),
        expected=AIR_BALANCE,
    )


CASES = (
    _room(2),
    _room(3),
    Case(
        "fan",
        "a swirling jet through a room, around a box",
        "conservation of mass",
        fan,
        evidence="exact",
        coarse=(20,),
        fine=(40,),
        expected=AIR_BALANCE,
    ),
    Case(
        "one_layer",
        "2-D against one layer of cells in 3-D",
        "the same flow in 2-D",
        one_layer,
        evidence="exact",
        coarse=(20,),
        fine=(80,),
        expected={"u / u_max, largest": Expected(tolerance=2e-6)},
    ),
)
