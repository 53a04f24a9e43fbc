"""Estimates of source terms: searches in plumes of closed form, teams, resuming, lag, and the keys' errors."""

import numpy as np
import pytest

from taichi_plume.assembly.assemble import assemble
from taichi_plume.grid.state import State
from taichi_plume.scenario.loading import ScenarioError, read_scenario

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
        "duration": 200,
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
    return assemble(read_scenario(scenario(**keys)))


@pytest.mark.slow
@pytest.mark.parametrize("dim", [2, 3])
def test_place_and_rate_of_a_plume(dim):
    sim = built(dim=dim, algorithm={"declare_spread": 0.25})
    sim.run()
    assert sim.swarm.declarations.to_numpy()[0] > 0
    (best,) = sim.teams[0].algorithm.estimates()[0]
    assert np.linalg.norm(best.place - SOURCE) < 0.3
    assert best.low < RATE < best.high
    assert abs(np.log(best.rate / RATE)) < np.log(2.0)
    rate, low, high = sim.swarm.declared_rate.to_numpy()[0]
    assert low < rate < high


@pytest.mark.slow
def test_state_goes_on_as_before():
    """A saved state, restored, leads to the same particles and poses."""
    sim = built()
    ends = []
    while sim.t < 12.0:
        sim.step()
    state = State(sim)
    saved = state.save()
    for _ in range(2):
        while sim.t < 30.0:
            sim.step()
        place = sim.teams[0].algorithm.posteriors[0].particles.place
        ends.append((place.copy(), sim.swarm.position.to_numpy()))
        state.restore(saved)
    for first, second in zip(*ends, strict=True):
        assert (first == second).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("radio", "share", "others"),
    [({}, "readings", 1), ({"loss": 1.0}, "readings", 0), ({"range": 0.5}, "readings", 0), ({}, "none", 0)],
)
def test_team_mates_exchange_readings(radio, share, others):
    """All measurements of both robots, or their own alone if messages are lost or do not reach, or by the key."""
    starts = {"kind": "positions", "positions": [[4.4, 0.8], [4.4, 2.2]], "heading_deg": 90}
    sim = built(count=2, start=starts, communication=radio, algorithm={"share": share})
    while sim.t < 12.0:
        sim.step()
    stops = sim.swarm.acquisitions.to_numpy()
    assert (stops > 0).all()
    for n, measured in enumerate(sim.teams[0].algorithm.measured):
        assert len(measured) == stops[n] + others * stops[1 - n]


def test_lag_is_deconvolved():
    """A linear sensor in constant gas: y = c (1 - exp(-t/T)) is far below c, its deconvolved samples are not."""
    sim = built(
        algorithm={"settle": 0.5, "acquisition": 2.0},
        sensors={"gas": {"kind": "ideal", "rise_time": 10, "decay_time": 10}},
        start={"kind": "positions", "positions": [[3.0, 1.6]], "heading_deg": 0},
    )
    algorithm = sim.teams[0].algorithm
    while not len(algorithm.measured[0]):
        sim.step()
    truth = sim.swarm.true_ppm.to_numpy()[0]
    assert algorithm.measured[0][0, 4] == pytest.approx(truth, rel=0.05)
    assert sim.swarm.measured.to_numpy()[0] < 0.3 * truth


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"rate": {"low": "1 mg/s", "high": "1 mg/s"}}, ("rate", "low", "high")),
        ({"rate": {"median": 0}}, ("median",)),
        ({"sources": 4}, ("sources", "3")),
        ({"cell": 0.005}, ("cell", "20000")),
        ({"diffusivity": [0.05, 0.005]}, ("diffusivity", "0.05")),
        ({"likelihood": "all"}, ("likelihood", "counts")),
    ],
)
def test_refused_keys(keys, words):
    with pytest.raises(ScenarioError) as error:
        assemble(read_scenario(scenario(algorithm=keys)))
    (line,) = error.value.lines
    for word in words:
        assert word in line


def test_sensor_that_does_not_respond():
    with pytest.raises(ScenarioError, match="acetone") as error:
        assemble(read_scenario(scenario(sensors={"gas": {"kind": "mox", "sensitivity": {"acetone": 0}}})))
    assert "robots[0]" in error.value.lines[0]


@pytest.mark.parametrize(
    "rate", [{}, {"low": "1 mg/s"}, {"median": "5 mg/s"}, {"median": "5 mg/s", "factor": 2}]
)
def test_written_scenarios_are_read_again(rate):
    """A scenario with all keys, as a run writes it, is the same."""
    first = read_scenario(scenario(algorithm={"rate": rate}))
    assert read_scenario(first.model_dump(mode="json")) == first
