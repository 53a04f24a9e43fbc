"""Laws of every search algorithm: states, restarts, saved states, trials and parts of the floor."""

import sys

import numpy as np
import pytest
from arena import Run, Script

from taichi_plume.agents.algorithm_table import ALGORITHMS
from taichi_plume.engine.program import compiled

pytestmark = pytest.mark.usefixtures("taichi")

SHORT = {"acquisition": 0.5, "sample_period": 0.1, "settle": 0.0}
QUICK: dict[str, dict] = dict.fromkeys(
    ("spiral", "ecoli", "infotaxis", "space_aware_infotaxis", "dapso", "hit_map"), SHORT
)
QUICK |= {"lineup": {"listen": 0.5}, "hit_map": {"acquisition": 0.5, "settle": 0.0}}
KINDS = sorted(
    set(ALGORITHMS) - {"external", "casting_3d"}
)  # these need a driver and wings: see their own tests
LEVELS = np.random.default_rng(1).uniform(0.0, 20.0, 300)
LOW = (1.0, 0.5)  # of a part of the floor, exact in f32
PLACES = ((1.5, 1.0), (1.0, 0.5))


def teams(**keys):
    """Two trials of a team of two for each kind of algorithm; the teams neither see nor touch each other."""
    mates = {"positions": PLACES, "trials": 2, "communication": {"range": 2.0, "loss": 0.2}}
    return [mates | {"algorithm": {"kind": kind, **QUICK.get(kind, {}), **keys}} for kind in KINDS]


def made(groups, low=(0.0, 0.0), heading_deg=None):
    return Run(groups, Script(LEVELS, 0.3), low=low, heading_deg=heading_deg)


@pytest.fixture(scope="module")
def run(taichi):
    return made(teams())


def same(one, other):
    """Whether the tracks (ticks, robots, 2) of each kind are equal."""
    parts = zip(np.split(one, len(KINDS), axis=1), np.split(other, len(KINDS), axis=1), strict=True)
    return {kind: bool((a == b).all()) for kind, (a, b) in zip(KINDS, parts, strict=True)}


@pytest.mark.parametrize("kind", ALGORITHMS)
def test_states_have_their_names(kind):
    modules = [vars(sys.modules[one.__module__]) for one in ALGORITHMS[kind].__mro__ if one is not object]
    for number, name in enumerate(ALGORITHMS[kind].STATE_NAMES):
        assert next((module[name] for module in modules if name in module), number) == number


@pytest.mark.slow
def test_they_begin_again_and_continue_from_a_saved_state(run):
    """To the bit, and without compiling anything."""
    run.begin(teams())
    _, tracks = run.go(8)
    restore = run.saved()
    _, rest = run.go(6)
    restore()
    assert same(run.go(6)[1], rest) == dict.fromkeys(KINDS, True)
    count = compiled()
    run.begin(teams(speed=0.07))
    _, other = run.go(8)
    assert np.linalg.norm(np.diff(other, axis=0), axis=-1).max() < 0.0071
    assert same(other, tracks) == dict.fromkeys(KINDS, False)
    run.begin(teams())
    assert same(run.go(8)[1], tracks) == dict.fromkeys(KINDS, True)
    assert compiled() == count


@pytest.mark.slow
def test_a_trial_alone_is_the_same_as_among_many(run):
    run.begin(teams())
    alone = made([one | {"trials": 1, "first_trial": 1} for one in teams()])
    among = run.go(20)[1].reshape(200, len(KINDS), 2, 2, 2)
    second = among[:, :, 1].reshape(200, -1, 2)
    assert same(alone.go(20)[1], second) == dict.fromkeys(KINDS, True)
    assert (among[:, :, 0] != among[:, :, 1]).any()


@pytest.mark.slow
def test_a_part_of_the_floor_is_a_room_of_its_own(run):
    """Robots search there as in a room of that size, and its edges stop them."""
    moved = {"positions": [(x + LOW[0], y + LOW[1]) for x, y in PLACES]}
    part = made([one | moved for one in teams()], LOW)
    run.begin(teams())
    within, room = part.go(20)[1] - LOW, run.go(20)[1]
    apart = np.abs(within - room).max(axis=(0, 2)).reshape(len(KINDS), -1).max(axis=1)
    rounded = [kind != "source_term" for kind in KINDS]  # whose Metropolis steps decide by the last digits
    assert apart[rounded].max() < 0.02  # positions are rounded differently
    assert np.ptp(room, axis=0).max() > 0.5
    later = part.go(40)[1] - LOW
    assert (later >= 0.085).all()
    assert (later <= np.array([3.0, 2.1]) - 0.085).all()
    assert later.min() < 0.09
