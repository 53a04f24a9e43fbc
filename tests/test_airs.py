"""Whether another seed makes other air is as the scenario says: looked up in the air itself."""

from typing import Any

import numpy as np
import pytest

from taichi_plume.assemble import assemble
from taichi_plume.grid import fields
from taichi_plume.scenario.scenario import Scenario

pytestmark = pytest.mark.usefixtures("taichi")

SOURCE = {"position": (0.3, 0.5), "rate": 1e-6}
EULERIAN = {"kind": "eulerian", "sources": [SOURCE]}
PUFFING = {"pulse": 0.2, "pause": 0.3}
STEADY = {"kind": "uniform", "velocity": (0.5, 0.0)}
GUSTS = STEADY | {"gusts": {"intensity": 0.2, "time": 0.5}}
INLET = {"kind": "inlet", "face": "x-", "speed": 0.5}
MEANDERING = {"kind": "meandering", "sources": [SOURCE]}


def cfd(inlet: dict[str, Any]) -> dict[str, Any]:
    return {"kind": "cfd", "openings": [inlet, {"kind": "outlet", "face": "x+"}]}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("wind", "gas", "drawn"),
    [
        (cfd(INLET), EULERIAN, False),
        (cfd(INLET | {"turbulence_intensity": 0.2}), EULERIAN, True),
        (STEADY, {"kind": "gaussian_plume", "intensity": 0.1, "sources": [SOURCE]}, False),
        (STEADY, {"kind": "eulerian", "sources": [SOURCE | {"puffing": PUFFING}]}, True),
        (STEADY, {"kind": "eulerian", "sources": [SOURCE | {"puffing": PUFFING | {"spread": 0.0}}]}, False),
        (STEADY, {"kind": "puffs", "sources": [SOURCE], "fluctuation": 0.0}, True),
        (STEADY, {"kind": "plumesim_meandering", "release_point": (0.3, 0.5)}, True),
        (STEADY, {"kind": "plumesim_gaussian", "release_point": (0.3, 0.5)}, False),
        (GUSTS, MEANDERING, True),
        ({"kind": "synthetic"}, EULERIAN, True),
    ],
)
def test_another_seed_makes_other_air_where_it_is_said_to(wind, gas, drawn):
    keys = {"duration": 2.0, "domain": {"size": (1.0, 1.0), "spacing": 0.1}, "wind": wind, "gas": gas}
    scenario = Scenario.model_validate(keys)
    assert scenario.air_by_chance == drawn
    sim = assemble(scenario)
    axis = np.linspace(0.05, 0.95, 19)
    points = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)

    def air() -> np.ndarray:
        sim.run()
        return fields.ppm_at(sim.gas, points, sim.t)

    first = air()
    assert first.max() > 0.0
    sim.reset(scenario.model_copy(update={"seed": 8}))
    assert np.array_equal(air(), first) != drawn
    sim.reset(scenario)
    assert np.array_equal(air(), first)
