"""What every search algorithm does: it begins anew with other numbers, and goes on from a saved state."""

import numpy as np
import pytest
from arena import Run, Script
from pydantic import TypeAdapter

from taichi_plume.agents.search import ALGORITHMS
from taichi_plume.grid.kernels import compiled
from taichi_plume.grid.state import State
from taichi_plume.scenario.algorithms import Algorithm
from taichi_plume.scenario.robots import Communication

pytestmark = pytest.mark.usefixtures("taichi")

SHORT = {"acquisition": 0.5, "sample_period": 0.1, "settle": 0.0}
QUICK = dict.fromkeys(("spiral", "ecoli", "infotaxis", "space_aware_infotaxis", "dapso"), SHORT) | {
    "lineup": {"listen": 0.5}
}


NEEDY = {
    "least_known",
    "external",
    "casting_3d",
}  # of a map, of what drives them, of wings: see their own tests


def model(kind, **keys):
    return TypeAdapter(Algorithm).validate_python({"kind": kind, **QUICK.get(kind, {}), **keys})


@pytest.mark.parametrize("kind", sorted(set(ALGORITHMS) - NEEDY))
def test_it_begins_anew_and_goes_on(kind):
    """To the bit, and without compiling anything."""
    teams = {"positions": ((1.5, 1.0), (1.0, 0.5)), "trials": 2, "communication": Communication(range=2.0)}
    rivals = [teams] if ALGORITHMS[kind].PER_GROUP else [teams, {"trials": 3}]
    first = [{"algorithm": model(kind)} | rival for rival in rivals]
    slower = [{"algorithm": model(kind, speed=0.07)} | rival for rival in rivals]
    levels = np.random.default_rng(1).uniform(0.0, 20.0, 300)
    run = Run(first, Script(levels, 0.3), heading_deg=None)
    run.begin(first)
    _, tracks = run.go(8)
    state = State(run)
    saved, tick = state.save(), run.tick
    _, rest = run.go(6)
    state.restore(saved)
    run.tick = tick
    assert (run.go(6)[1] == rest).all()
    count = compiled()
    run.begin(slower)
    _, other = run.go(8)
    assert np.linalg.norm(np.diff(other, axis=0), axis=-1).max() < 0.0071
    assert (other != tracks).any()
    run.begin(first)
    assert (run.go(8)[1] == tracks).all()
    assert compiled() == count
