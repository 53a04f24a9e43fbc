"""Estimates of source terms: searches in plumes of closed form, teams, resuming, lag, and the keys' errors."""

import numpy as np
import pytest

from taichi_plume.assembly.assemble import assemble
from taichi_plume.scenario.scenario import Scenario

pytestmark = pytest.mark.usefixtures("taichi")

SOURCE, RATE = (1.0, 1.6), 2e-5


def scenario(algorithm=None, dim=2, **changes):
    """A uniform wind along x with a plume of closed form, whose diffusivity is 0.01 m²/s."""
    size = [5.0, 3.0] if dim == 2 else [5.0, 3.0, 1.6]
    z = [0.4] * (dim - 2)
    robot = {
        "name": "one",
        "count": 1,
        "trials": 1,
        "start": {"kind": "positions", "positions": [[4.4, 0.8]], "heading_deg": 90},
        "found": "declared",
        "algorithm": {"kind": "source_term", "threshold_ppm": 1, "acquisition": 2, "particles": 300}
        | (algorithm or {}),
        "sensors": {"gas": {"kind": "ideal", "height": 0.4 if dim == 3 else 0.1}},
    }
    return {
        "name": "test",
        "duration": 150,
        "domain": {"size": size, "spacing": 0.1, **({"depth": 0.5} if dim == 2 else {})},
        "wind": {"kind": "uniform", "velocity": [0.4, 0.0] + [0.0] * (dim - 2)},
        "gas": {
            "kind": "gaussian_plume",
            "species": "acetone",
            "diffusivity": 0.01,
            "sources": [{"position": [*SOURCE, *z], "rate": RATE}],
        },
        "robots": [robot | changes],
    }


def built(**keys):
    return assemble(Scenario.model_validate(scenario(**keys)))


@pytest.mark.slow
@pytest.mark.parametrize("dim", [2, 3])
def test_place_and_rate_of_a_plume(dim):
    sim = built(dim=dim)
    sim.run()
    (best,) = sim.teams[0].algorithm.estimates()[0]
    assert np.linalg.norm(best.place - SOURCE) < 0.3
    assert best.low < RATE < best.high
    assert abs(np.log(best.rate / RATE)) < np.log(2.0)
    rates = sim.swarm.declared_rate.to_numpy()[0]
    assert rates[1] < rates[0] < rates[2]
