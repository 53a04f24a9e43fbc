"""Symmetry of the flow solver under reflection and rotation of a room, also at the rims of openings in a wall."""

from functools import partial

import numpy as np

from taichi_plume.scenario.winds import CfdWind
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.validation.case import Case, Expected
from taichi_plume.validation.flow_cases import SMALL_COURANT, SMALL_STEPS, Errors, both_steps
from taichi_plume.validation.setups import cfd, flow_on

SIZE = (2.4, 1.6, 1.2)  # m
DURATION = 1.0  # s
OPENINGS = (
    {"kind": "inlet", "face": "x-", "center": (0.5, 0.4), "size": (0.6, 0.4), "speed": 0.8},
    {"kind": "fan", "face": "x-", "center": (1.25, 0.75), "diameter": 0.5, "speed": 0.5},
    {"kind": "outlet", "face": "x+", "center": (1.1, 0.7), "size": (0.6, 0.6)},
    {"kind": "honeycomb", "face": "y+", "center": (1.5, 0.5), "size": (0.8, 0.4), "loss_coefficient": 3.0},
    {"kind": "wall", "face": "y-", "center": (1.0, 0.6), "size": (0.8, 0.6), "velocity": (0.5, 0.0, 0.0)},
)
FULL_FACES = (
    {"kind": "honeycomb", "face": "x-", "center": (0.8, 0.6), "size": (1.6, 1.2), "speed": 0.6},
    {"kind": "outlet", "face": "x+", "center": (0.8, 0.6), "size": (1.6, 1.2)},
)
"""Openings over whole faces, without a rim: inflow eddies end at the edges of the room."""


def _in_dimensions(opening: dict, dim: int) -> dict:
    """Return an opening of the room reduced to `dim` dimensions."""
    vectors = {"center": dim - 1, "size": dim - 1, "velocity": dim}
    return {key: value[: vectors[key]] if key in vectors else value for key, value in opening.items()}


def _mirrored(opening: dict, axis: int) -> dict:
    """Return an opening as it is in the room mirrored along an axis."""
    normal, result = "xyz".index(opening["face"][0]), dict(opening)
    if normal == axis:
        result["face"] = opening["face"][0] + ("-" if opening["face"][1] == "+" else "+")
    else:
        along = axis - (normal < axis)
        center = list(opening["center"])
        center[along] = SIZE[axis] - center[along]
        result["center"] = center
    if "velocity" in opening:
        result["velocity"] = [-v if a == axis else v for a, v in enumerate(opening["velocity"])]
    return result


def _transposed(opening: dict) -> dict:
    """Return an opening with x and y exchanged; together with a mirror image this rotates the room by 90 degrees."""
    result = opening | {"face": opening["face"].translate(str.maketrans("xy", "yx"))}
    if "velocity" in opening:
        first, second, *rest = opening["velocity"]
        result["velocity"] = [second, first, *rest]
    return result


def _steps(flow: FlowSolver) -> list[float]:
    """Advance a flow to DURATION and return the lengths of its time steps [s]."""
    t, steps = 0.0, []
    while t < DURATION:
        steps.append(min(flow.stable_dt(t), DURATION - t + 1e-9))
        flow.advance(t, steps[-1])
        t += steps[-1]
    return steps


def _velocity(flow: FlowSolver) -> list[np.ndarray]:
    """Return the velocity components on all faces of the room, an array per axis."""
    inner = [tuple(slice(*cells) for cells in flow.grid.faces(d)) for d in range(flow.dim)]
    return [u.to_numpy().astype(float)[part] for u, part in zip(flow.u, inner, strict=True)]


def _largest_difference(a: list[np.ndarray], b: list[np.ndarray]) -> float:
    """Return the largest difference of two velocity fields over their largest velocity."""
    difference = max(float(np.abs(x - y).max()) for x, y in zip(a, b, strict=True))
    return difference / max(float(np.abs(x).max()) for x in a)


def room(n: int, dim: int, openings: tuple[dict, ...]) -> Errors:
    """Return differences of a room's flow, n cells along y, from that in its mirror images and its rotation by 90°."""
    shape, dx = tuple(round(size / SIZE[1] * n) for size in SIZE[:dim]), SIZE[1] / n
    here = [_in_dimensions(part, dim) for part in openings]

    def errors(courant: float) -> Errors:
        def flow_of(placed: list[dict], cells: tuple[int, ...]) -> FlowSolver:
            return flow_on(cfd(placed, courant=courant, tolerance=1e-6), cells, dx)

        def at_end(placed: list[dict], cells: tuple[int, ...]) -> list[np.ndarray]:
            flow, t = flow_of(placed, cells), 0.0
            for dt in steps:
                flow.advance(t, dt)
                t += dt
            return _velocity(flow)

        original = flow_of(here, shape)
        steps = _steps(original)
        velocity, mirrored = _velocity(original), 0.0
        for axis in range(dim):
            image = at_end([_mirrored(part, axis) for part in here], shape)
            back = [np.flip(u, axis) * (-1.0 if d == axis else 1.0) for d, u in enumerate(image)]
            mirrored = max(mirrored, _largest_difference(velocity, back))
        turned = at_end([_transposed(_mirrored(part, 0)) for part in here], (shape[1], shape[0], *shape[2:]))
        back = [np.flip(u.swapaxes(0, 1), 0) for u in (turned[1], turned[0], *turned[2:])]
        back[0] = -back[0]
        return {"mirrored, largest": mirrored, "turned, largest": _largest_difference(velocity, back)}

    small = errors(SMALL_COURANT)
    usual = errors(CfdWind.model_fields["courant"].default)
    return usual | {norm + SMALL_STEPS: error for norm, error in small.items()}


def _case(name: str, what: str, dim: int, openings: tuple[dict, ...], fine: tuple[int, ...]) -> Case:
    norms = ("mirrored, largest", "turned, largest")
    return Case(
        f"symmetry_{name}{dim}d",
        what,
        "invariance of the equations under reflection and rotation",
        partial(room, dim=dim, openings=openings),
        evidence="exact",
        coarse=(12,) if name == "" else (),
        fine=fine,
        expected=both_steps(dict.fromkeys(norms, Expected(tolerance=1e-5))),
        discussion="What differs is rounding in single precision, which grows with the Courant number: with the usual "
        "steps and openings over whole walls to some 1e-5 of the largest speed within the second.",
    )


CASES = [
    _case("", "a room with openings in its walls, mirrored and turned", 2, OPENINGS, (12, 16, 24, 32)),
    _case("", "a room with openings in its walls, mirrored and turned", 3, OPENINGS, (12, 16, 24)),
    _case("full_", "a room with openings over whole walls, mirrored and turned", 3, FULL_FACES, (12, 16, 24)),
]
