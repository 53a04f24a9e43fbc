"""Shared readings: beliefs of a team beside Bayes' rule in f64 over the readings that arrive; range, loss and rate."""

import numpy as np
import pytest
from arena import Run, Script
from robots import NOWHERE, group
from scipy.special import k0

from taichi_plume.agents.members import Members
from taichi_plume.agents.parameters import Parameters
from taichi_plume.agents.shared_readings import SharedReadings
from taichi_plume.agents.swarm import Swarm
from taichi_plume.engine import ti
from taichi_plume.grid.clearance import ClearanceMap
from taichi_plume.scenario.belief_algorithms import HitMap, Infotaxis, SpaceAwareInfotaxis

pytestmark = pytest.mark.usefixtures("taichi")

SIZE, CELL, REACH = (3.0, 2.2), 0.2, 0.35
STARTS = ((0.5, 0.5), (1.5, 1.7), (2.5, 0.9))
USUAL = {"cell": CELL, "acquisition": 1.0, "settle": 0.2, "declare_spread": None, "share": "readings"}
MODELS = {
    "infotaxis": Infotaxis(kind="infotaxis", **USUAL),
    "space_aware_infotaxis": SpaceAwareInfotaxis(kind="space_aware_infotaxis", **USUAL),
    "hit_map": HitMap(kind="hit_map", **USUAL),
}


class Halves(Script):
    """Gas in the right half, and a wind that turns with the place."""

    def __init__(self):
        super().__init__([0.0], 1.0)

    @ti.func
    def ppm(self, x, t):
        return ti.Vector([ti.select(x[0] > 1.6, 9.0, 0.0)])

    @ti.func
    def velocity(self, x, t):
        return ti.Vector([0.5 - 0.2 * x[1], 0.3 * (x[0] - 1.0)])


def likelihood(model, spacing, place, wind, hit):
    """Likelihood (15, 11) of a hit or miss by the published formulas; 0 where the source would have been found."""
    places = CELL * (np.moveaxis(np.indices((15, 11)), 0, -1) + 0.5)
    off = np.linalg.norm(np.abs(places - place) + CELL / 2, axis=-1) > REACH
    if isinstance(model, HitMap):
        here = CELL * (np.floor(place / CELL) + 0.5)
        apart = places - here
        way = np.linalg.norm(apart, axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            angle = np.arccos(np.clip(-(apart @ wind) / (way * np.linalg.norm(wind)), -1, 1))
            variance = np.radians(model.spread_deg) ** 2 + CELL**2 / 6 / way**2
        share = np.where(way > 0, np.exp(-(angle**2) / (2 * variance) - way / model.fading), 0.0)
        share = np.maximum(share, np.exp(-(way**2) / (2 * model.near**2)))
        chance = model.false_alarm + (model.hit - model.false_alarm) * share
    else:
        D, V, tau, a = model.diffusivity, model.wind_speed, model.lifetime, model.size
        e, apart = wind / np.linalg.norm(wind), places - place
        along, across = apart @ e, apart @ np.array([-e[1], e[0]])
        along, across = (np.floor(r / spacing + 0.5) * spacing for r in (along, across))  # nodes of the table
        fades = np.sqrt(D * tau / (1 + V**2 * tau / (4 * D)))
        r = np.maximum(np.hypot(along, across), a)
        rate = model.rate / np.log(fades / a) * np.exp(-V * along / (2 * D)) * k0(r / fades)
        chance = 1 - np.exp(-rate * model.acquisition)
    return off * (chance if hit else 1 - chance)


def search(model, radio, seconds=12.0):
    """Search with three robots; the beliefs at the end, the readings of each robot, and the positions."""
    run = Run(model, Halves(), STARTS, size=SIZE, reach=REACH, communication=radio)
    readings = [[] for _ in STARTS]
    done, hits = np.zeros(3), np.zeros(3)
    positions = []
    for _ in range(round(seconds / 0.1)):
        place = run.swarm.position.to_numpy().astype(float)
        run.step()
        stops, now = run.swarm.acquisitions.to_numpy(), run.swarm.hits.to_numpy()
        for n in np.flatnonzero(stops > done):
            x, y = place[n]
            wind = np.array([0.5 - 0.2 * y, 0.3 * (x - 1.0)])
            if not isinstance(model, HitMap):
                wind = run.algorithm.downwind.to_numpy()[n].astype(float)
            readings[n].append((place[n], wind, now[n] > hits[n]))
        done, hits = stops, now
        positions.append(run.swarm.position.to_numpy())
    return run.algorithm, readings, np.array(positions)


def posterior(algorithm, model, readings):
    p = np.ones((15, 11))
    for reading in readings:
        p = p * likelihood(model, getattr(algorithm, "spacing", None), *reading)
    return p / p.sum()


KINDS = ["infotaxis", *(pytest.param(kind, marks=pytest.mark.slow) for kind in list(MODELS)[1:])]


@pytest.mark.parametrize("kind", KINDS)
def test_beliefs_with_all_readings(kind):
    """All robots have the same belief: the posterior of the readings of all, each counted once."""
    algorithm, readings, _ = search(MODELS[kind], {})
    assert min(map(len, readings)) >= 2
    outcomes = [hit for own in readings for *_, hit in own]
    assert any(outcomes)
    assert not all(outcomes)
    beliefs = algorithm.beliefs()
    assert (beliefs == beliefs[0]).all()
    expected = posterior(algorithm, MODELS[kind], [reading for own in readings for reading in own])
    np.testing.assert_allclose(beliefs[0], expected, atol=3e-3 * expected.max())


@pytest.mark.parametrize("kind", KINDS)
def test_beliefs_without_messages(kind):
    """Out of range, with a loss of 1 and without sharing each robot has the posterior of its own readings."""
    model = MODELS[kind]
    algorithm, readings, alone = search(type(model)(**USUAL | {"kind": kind, "share": "none"}), {})
    for radio in ({"range": 0.05}, {"loss": 1.0}):
        other, _, positions = search(model, radio)
        np.testing.assert_array_equal(positions, alone)
        np.testing.assert_array_equal(other.beliefs(), algorithm.beliefs())
    for belief, own in zip(algorithm.beliefs(), readings, strict=True):
        expected = posterior(algorithm, model, own)
        np.testing.assert_allclose(belief, expected, atol=3e-3 * expected.max())


class Exchange:
    """Teams of four robots a metre apart, which all end an acquisition in a tick."""

    def __init__(self, trials, **radio):
        places = np.tile([(1.0 + i, 1.0) for i in range(4)], (trials, 1))
        team = group(
            count=4,
            trials=trials,
            communication=radio,
            algorithm={"kind": "infotaxis", "declare_spread": None},
        )
        swarm = Swarm(
            (team,),
            places,
            np.zeros(len(places)),
            ClearanceMap([], (6.0, 2.0, 1.0), 0.1),
            NOWHERE,
            5,
            rivals=True,
        )
        members = Members(swarm, [0])
        numbers = Parameters(members, lambda one: SharedReadings.numbers(one, 0.1), radio="radio")
        self.readings = SharedReadings(members, numbers)
        self.taken = ti.field(ti.i32, (len(places), 4))

    @ti.kernel
    def _end(self, tick: int):
        for n in range(self.readings.size):
            self.readings.end(n, tick, 1.0, ti.Vector([0.0, 0.0]))

    @ti.kernel
    def _take(self, tick: int):
        for n, m in ti.ndrange(*self.taken.shape):
            self.taken[n, m] = ti.cast(self.readings.takes(n, m, tick), ti.i32)

    def at(self, tick):
        """Who takes whose reading, (trials, 4, 4)."""
        self._end(tick)
        self._take(tick)
        return self.taken.to_numpy().reshape(-1, 4, 4) == 1


def test_a_share_of_the_readings_is_lost():
    taken = Exchange(2000, loss=0.5).at(1)
    own = np.eye(4, dtype=bool)
    assert taken[:, own].all()
    assert taken[:, ~own].mean() == pytest.approx(0.5, abs=4 * np.sqrt(0.25 / (2000 * 12)))


def test_readings_go_as_far_as_the_range():
    apart = np.abs(np.subtract.outer(np.arange(4), np.arange(4)))
    assert (Exchange(1, range=1.5).at(1)[0] == (apart <= 1)).all()


def test_no_more_messages_than_the_rate():
    """With 0.5 messages a second a reading 1.9 s after the last message is not sent; the robot's own counts."""
    exchange = Exchange(1, rate=0.5)
    sent = [exchange.at(tick)[0].sum() == 16 for tick in (1, 20, 21, 30, 41)]
    assert sent == [True, False, True, False, True]
    assert (exchange.at(50)[0] == np.eye(4)).all()
