"""Edits of a room: sizes, counts, obstacles, openings and positions compile nothing once a room of the kind was run."""

import numpy as np
import pytest

from taichi_plume.assembly.assemble import assemble
from taichi_plume.engine import program
from taichi_plume.scenario.loading import scenario_from

pytestmark = pytest.mark.usefixtures("taichi")


def room(draws: np.random.Generator, dim: int, gas: str) -> dict:
    """A room with an inlet and an outlet beside walls, some obstacles, casters and a map of a gas of this kind."""
    size = [*np.round(draws.uniform(1.4, 2.6, 2), 1), 0.6][:dim]
    length, width = size[:2]
    across = [0.3][: dim - 2]

    def obstacle() -> dict:
        place = [float(length * draws.uniform(0.4, 0.7)), float(width * draws.uniform(0.3, 0.7)), *across]
        edges = [float(draws.uniform(0.15, 0.35)) for _ in place]
        return {"kind": "box", "center": place, "size": edges, "yaw_deg": float(draws.uniform(0, 80))}

    opening = {"kind": "honeycomb", "size": [0.3, *across]}
    inlets = [
        {**opening, "face": "x-", "center": [width * share, *across], "speed": float(draws.uniform(0.3, 0.6))}
        for share in ([0.5], [0.3, 0.7])[draws.integers(2)]
    ]
    return {
        "duration": 1,
        "seed": int(draws.integers(100)),
        "domain": {"size": [float(n) for n in size], "spacing": float(draws.choice([0.1, 0.08]))},
        "wind": {
            "kind": "cfd",
            "openings": [*inlets, {**opening, "face": "x+", "center": [width / 2, *across]}],
        },
        "obstacles": [obstacle() for _ in range(draws.integers(1, 4))],
        "gas": {"kind": gas, "sources": [{"position": [0.3, width / 2, *across], "rate": 2e-5}]},
        "robots": [
            {
                "count": int(draws.integers(1, 6)),
                "start": {"kind": "line", "begin": [length - 0.2, 0.2], "end": [length - 0.2, width - 0.2]},
                "algorithm": {"kind": "casting", "threshold_ppm": float(draws.uniform(1, 9))},
            }
        ],
        "maps": [{"kind": "kernel_dmv", "cell": float(draws.choice([0.1, 0.2]))}],
    }


@pytest.mark.parametrize(
    ("dim", "gas"), [(2, "eulerian"), (2, "puffs"), pytest.param(3, "eulerian", marks=pytest.mark.slow)]
)
def test_edits_of_a_room_compile_nothing(dim, gas):
    draws = np.random.default_rng(dim)
    before = None
    for _ in range(8):
        sim = assemble(scenario_from(room(draws, dim, gas)))
        for _ in range(2):
            sim.advance()
        assert sim.gas.is_finite()
        assert before in (None, program.compiled())
        before = program.compiled()
