"""E. coli against table 1 of Ferri et al. 2009."""

import numpy as np
import pytest
from arena import TICK, Run, Script

from taichi_plume.agents.ecoli import ACQUIRE, RUN, TUMBLE
from taichi_plume.scenario.search_algorithm import EColi

pytestmark = pytest.mark.usefixtures("taichi")

MODEL = EColi(kind="ecoli")
TIMES = (3.0, 30.0)  # s of an acquisition
MANY = 400
RIVALS = [
    {"algorithm": MODEL},
    {"algorithm": MODEL, "trials": MANY},
    *({"algorithm": EColi(kind="ecoli", acquisition=time, settle=1.0)} for time in TIMES),
]


@pytest.fixture(scope="module")
def run(taichi):
    """One robot, many, and one for each of TIMES."""
    return Run(RIVALS, Script([0.0], 1.0), positions=((10.0, 10.0),), size=(20.0, 20.0))


def steps(states, places):
    """Of one robot: the displacement of each step [m], and whether it was a run."""
    begins = np.flatnonzero((states[:-1] == ACQUIRE) & (states[1:] != ACQUIRE)) + 1
    ends = np.flatnonzero((states[:-1] != ACQUIRE) & (states[1:] == ACQUIRE)) + 1
    count = min(len(begins), len(ends))
    moves = places[ends[:count]] - places[begins[:count] - 1]
    return moves, states[begins[:count]] == RUN


def test_it_runs_on_while_the_mean_rises(run):
    """A ppm more each second: after the first tumble every step goes on within 5 degrees."""
    run.gas.tell(np.arange(200.0), 1.0)
    run.begin(RIVALS)
    states, places = run.go(60)
    moves, runs = steps(states[:, 0], places[:, 0])
    assert runs.tolist() == [False] + [True] * (len(runs) - 1)
    assert len(runs) > 7
    lengths = np.linalg.norm(moves, axis=1)
    assert ((lengths > 0.2375 - 1e-3) & (lengths < 0.2625 + 1e-3)).all()
    turns = np.diff(np.arctan2(moves[:, 1], moves[:, 0]))
    assert np.abs((turns + np.pi) % (2 * np.pi) - np.pi).max() < np.radians(5) + 1e-3


def test_it_tumbles_in_still_gas(run):
    """Equal readings are no rise: the headings of many robots after one tumble are uniform."""
    run.gas.tell([3.0], 1.0)
    run.begin(RIVALS)
    states, places = run.go(9)
    many = run.of(1)
    assert not (states[:, many] == RUN).any()
    moved = np.array([10.0, 10.0]) - places[-1, many]
    angles = np.arctan2(moved[:, 1], moved[:, 0])
    resultant = np.abs(np.exp(1j * angles).mean())
    assert resultant < 3 / np.sqrt(MANY)
    assert run.swarm.hits.to_numpy()[many].sum() == 0


def test_acquisitions_take_their_time(run):
    run.gas.tell([3.0], 1.0)
    run.begin(RIVALS)
    states, _ = run.go(max(TIMES) + 2)
    for rival, time in enumerate(TIMES, 2):
        first = np.flatnonzero(states[:, run.of(rival)][:, 0] == TUMBLE)[0]
        assert (first + 1) * TICK == pytest.approx(time + 1.0, abs=TICK), time


def test_a_search_that_is_over_counts_no_more():
    """Of two in rising gas one starts at the source."""
    places = ((4.0, 4.0), (1.0, 1.0))
    run = Run(MODEL, Script(np.arange(200.0), 1.0), places, size=(5.0, 5.0), sources=[(4.0, 4.0)], reach=0.2)
    run.go(30)
    reported = run.swarm.snapshot()
    assert reported["found"].tolist() == [True, False]
    assert reported["acquisitions"][0] == reported["hits"][0] == 0
    assert reported["acquisitions"][1] > reported["hits"][1] > 0
