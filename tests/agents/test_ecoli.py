"""E. coli against table 1 of Ferri et al. 2009."""

import numpy as np
import pytest
from arena import TICK, Run, Script

from taichi_plume.agents.ecoli import ACQUIRE, RUN, TUMBLE
from taichi_plume.scenario.listening import EColi

pytestmark = pytest.mark.usefixtures("taichi")


def steps(run, seconds):
    """Of one robot: the displacement of each step [m], and whether it was a run."""
    states, places = run.go(seconds)
    begins = np.flatnonzero((states[:-1, 0] == ACQUIRE) & (states[1:, 0] != ACQUIRE)) + 1
    ends = np.flatnonzero((states[:-1, 0] != ACQUIRE) & (states[1:, 0] == ACQUIRE)) + 1
    count = min(len(begins), len(ends))
    moves = places[ends[:count], 0] - places[begins[:count] - 1, 0]
    return moves, states[begins[:count], 0] == RUN


def test_it_runs_on_while_the_mean_rises():
    """A ppm more each second: after the first tumble every step goes on within 5 degrees."""
    run = Run(
        EColi(kind="ecoli"), Script(np.arange(200.0), 1.0), positions=((10.0, 10.0),), size=(20.0, 20.0)
    )
    moves, runs = steps(run, 60)
    assert runs.tolist() == [False] + [True] * (len(runs) - 1)
    assert len(runs) > 7
    lengths = np.linalg.norm(moves, axis=1)
    assert ((lengths > 0.2375 - 1e-3) & (lengths < 0.2625 + 1e-3)).all()
    turns = np.diff(np.arctan2(moves[:, 1], moves[:, 0]))
    assert np.abs((turns + np.pi) % (2 * np.pi) - np.pi).max() < np.radians(5) + 1e-3


def test_it_tumbles_in_still_gas():
    """Equal readings are no rise: the headings of many robots after one tumble are uniform."""
    positions = [(0.5 + x, 0.5 + y) for x in range(20) for y in range(20)]
    run = Run(EColi(kind="ecoli"), Script([3.0], 1.0), positions=positions, size=(21.0, 21.0))
    states, places = run.go(9)
    assert not (states == RUN).any()
    moved = np.array(positions) - places[-1]
    angles = np.arctan2(moved[:, 1], moved[:, 0])
    resultant = np.abs(np.exp(1j * angles).mean())
    assert resultant < 3 / np.sqrt(len(positions))
    assert run.swarm.hits.to_numpy().sum() == 0


@pytest.mark.parametrize("acquisition", [3.0, 30.0])
def test_acquisitions_take_their_time(acquisition):
    run = Run(EColi(kind="ecoli", acquisition=acquisition, settle=1.0), Script([3.0], 1.0))
    states, _ = run.go(acquisition + 2)
    first = np.flatnonzero(states[:, 0] == TUMBLE)[0]
    assert (first + 1) * TICK == pytest.approx(acquisition + 1.0, abs=TICK)
