"""What every search algorithm does: it names its states, begins anew, goes on from a saved state, draws by trial."""

import sys

import numpy as np
import pytest
from arena import Run, Script

from taichi_plume.agents.search import ALGORITHMS
from taichi_plume.grid.kernels import compiled

pytestmark = pytest.mark.usefixtures("taichi")

SHORT = {"acquisition": 0.5, "sample_period": 0.1, "settle": 0.0}
QUICK = dict.fromkeys(("spiral", "ecoli", "infotaxis", "space_aware_infotaxis", "dapso", "hit_map"), SHORT)
QUICK |= {"lineup": {"listen": 0.5}, "hit_map": {"acquisition": 0.5, "settle": 0.0}}
NEEDY = {"least_known", "external", "casting_3d"}  # of a map, a driver, wings: see their own tests


KINDS = sorted(set(ALGORITHMS) - NEEDY)
LEVELS = np.random.default_rng(1).uniform(0.0, 20.0, 300)


def rivals(kind, **keys):
    """Teams of two robots, and where a class drives several groups lone ones too."""
    algorithm = {"algorithm": {"kind": kind, **QUICK.get(kind, {}), **keys}}
    mates = {"positions": ((1.5, 1.0), (1.0, 0.5)), "trials": 2, "communication": {"range": 2.0, "loss": 0.2}}
    return [one | algorithm for one in ([mates] if ALGORITHMS[kind].PER_GROUP else [mates, {"trials": 3}])]


@pytest.mark.parametrize("kind", ALGORITHMS)
def test_states_have_their_names(kind):
    modules = [vars(sys.modules[one.__module__]) for one in ALGORITHMS[kind].__mro__ if one is not object]
    for number, name in enumerate(ALGORITHMS[kind].STATE_NAMES):
        assert next((module[name] for module in modules if name in module), number) == number


@pytest.mark.parametrize("kind", KINDS)
def test_it_begins_anew_and_goes_on(kind):
    """To the bit, and without compiling anything."""
    run = Run(rivals(kind), Script(LEVELS, 0.3), heading_deg=None)
    run.begin(rivals(kind))
    _, tracks = run.go(8)
    restore = run.saved()
    _, rest = run.go(6)
    restore()
    assert (run.go(6)[1] == rest).all()
    count = compiled()
    run.begin(rivals(kind, speed=0.07))
    _, other = run.go(8)
    assert np.linalg.norm(np.diff(other, axis=0), axis=-1).max() < 0.0071
    assert (other != tracks).any()
    run.begin(rivals(kind))
    assert (run.go(8)[1] == tracks).all()
    assert compiled() == count


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_trial_alone_is_the_same_as_among_many(kind):
    several = rivals(kind)
    many = Run(several, Script(LEVELS, 0.3), heading_deg=None)
    alone = Run(
        [one | {"trials": 1, "first_trial": 1} for one in several], Script(LEVELS, 0.3), heading_deg=None
    )
    (_, among), (_, single) = many.go(20), alone.go(20)
    for n, one in enumerate(several):
        count = len(one.get("positions", "1"))
        assert (single[:, alone.of(n)] == among[:, many.of(n)][:, count : 2 * count]).all()
    assert (among[:, 0] != among[:, len(several[0]["positions"])]).any()
