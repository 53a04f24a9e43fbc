"""Infotaxis: its rates, beliefs and expectations against literal formulas, and a search in the world it believes in."""

import numpy as np
import pytest
from arena import Run, Script
from scipy.special import k0

from taichi_plume.agents.infotaxis import detection_rate
from taichi_plume.engine import ti
from taichi_plume.grid.kernels import Template
from taichi_plume.grid.rng import uniform4
from taichi_plume.scenario.belief_algorithms import Infotaxis, SpaceAwareInfotaxis

pytestmark = pytest.mark.usefixtures("taichi")

MODEL = Infotaxis(kind="infotaxis", cell=0.15)
SPACE_AWARE = "space_aware_infotaxis"


def rate_of_the_paper(model, dx, dy):
    """The published formula for a source at (dx, dy), the wind along x."""
    D, V, tau, a = model.diffusivity, model.wind_speed, model.lifetime, model.size
    reach = np.sqrt(D * tau / (1 + V**2 * tau / (4 * D)))
    r = np.maximum(np.hypot(dx, dy), a)
    return model.rate / np.log(reach / a) * np.exp(-V * dx / (2 * D)) * k0(r / reach)


def test_rate_of_detections():
    dx, dy = np.array([-1.0, -0.5, 0.2, -0.8]), np.array([0.0, 0.2, 0.1, -0.3])
    np.testing.assert_allclose(detection_rate(MODEL, dx, dy), rate_of_the_paper(MODEL, dx, dy), rtol=1e-6)


def entropy(p):
    p = p[p > 1e-12]
    return -(p * np.log(p)).sum()


@ti.kernel
def cost(algorithm: Template, x: float, y: float) -> float:
    return algorithm._cost(0, ti.Vector([x, y]))


class Bayes:
    """The belief of one robot in f64, with rates by the published formula on nodes half a cell apart."""

    def __init__(self, algorithm):
        self.cell, self.spacing = algorithm.belief_cell, algorithm.spacing
        centers = [(np.arange(n) + 0.5) * self.cell for n in algorithm.belief.cells]
        self.X, self.Y = np.meshgrid(*centers, indexing="ij")
        self.p = np.full(self.X.shape, 1.0 / self.X.size)

    def chance(self, p):
        on_node = [
            np.floor((c - q) / self.spacing + 0.5) * self.spacing for c, q in ((self.X, p[0]), (self.Y, p[1]))
        ]
        return -np.expm1(-rate_of_the_paper(MODEL, *on_node) * MODEL.acquisition)

    def is_off(self, p, reach):
        """Cells of which some part is farther than `reach`, by their corners."""
        half = self.cell / 2
        corners = [
            np.hypot(self.X + a - p[0], self.Y + b - p[1]) for a in (-half, half) for b in (-half, half)
        ]
        return np.max(corners, axis=0) > reach

    def learn(self, p, hit, reach):
        chance = self.chance(p)
        self.p *= (chance if hit else 1 - chance) * self.is_off(p, reach)
        self.p /= self.p.sum()

    def expected(self, p, reach, value):
        """Mean of `value` of the posteriors at p, 0 where the source is found."""
        left, chance = self.p * self.is_off(p, reach), self.chance(p)
        reported = 0.0
        for likelihood in (chance, 1 - chance):
            w = (left * likelihood).sum()
            reported += w * value(left * likelihood / w)
        return reported


REACH = 0.35


@pytest.mark.parametrize("found", ["reached", "declared"])
@pytest.mark.parametrize("kind", [Infotaxis, SpaceAwareInfotaxis])
def test_belief_and_expectation(kind, found):
    """After some acquisitions without and with gas, the belief is the product of the likelihoods."""
    levels = np.array([0.0, 9.0, 0.0, 9.0])
    model = kind(**MODEL.model_dump() | {"kind": SPACE_AWARE if kind is SpaceAwareInfotaxis else "infotaxis"})
    gas = Script(np.repeat(levels, 100), 0.05)
    run = Run(model, gas, positions=((1.5, 1.0),), found=found, reach=REACH)
    reach = REACH if found == "reached" else 0.0
    algorithm = run.algorithm
    bayes = Bayes(algorithm)
    done = hits = 0
    while done < 4:
        place = run.swarm.position.to_numpy()[0].astype(float)
        run.go(0.1)
        if run.swarm.acquisitions.to_numpy()[0] > done:
            done, before = done + 1, hits
            hits = run.swarm.hits.to_numpy()[0]
            bayes.learn(place, hits > before, reach)
    assert 0 < hits < 4
    np.testing.assert_allclose(algorithm.beliefs()[0], bayes.p, atol=2e-4 * bayes.p.max())
    there = np.array([1.1, 0.7])

    def steps_left(p):
        way = np.abs(bayes.X - there[0]) + np.abs(bayes.Y - there[1])
        places = np.exp(entropy(p)) * (MODEL.cell / MODEL.step) ** 2
        return np.log2((p * way).sum() / MODEL.step + places / 2 - 0.5)

    value = entropy if kind is Infotaxis else steps_left
    assert cost(algorithm, *there) == pytest.approx(bayes.expected(there, reach, value), rel=1e-3)
    assert not np.isclose(bayes.expected(there, 0.0, value), bayes.expected(there, REACH, value), rtol=2e-3)


class Patches(Script):
    """Gas that comes in patches, as often as the model says: 100 ppm, drawn anew every two seconds."""

    def __init__(self, source):
        super().__init__([0.0], 1.0)
        self.source = source
        places = (np.arange(161) - 80) * 0.05
        rate = detection_rate(MODEL, *np.meshgrid(places, places, indexing="ij"))
        self.chance = ti.field(ti.f32, rate.shape)
        self.chance.from_numpy(-np.expm1(-rate * MODEL.acquisition).astype(np.float32))

    @ti.func
    def ppm(self, x, t):
        k = ti.cast((self.source[0] - x[0]) / 0.05 + 80.5, ti.i32)
        m = ti.cast((self.source[1] - x[1]) / 0.05 + 80.5, ti.i32)
        where = ti.cast(x[0] * 1e4, ti.i32) + 40000 * ti.cast(x[1] * 1e4, ti.i32)
        u = uniform4(ti.u32(1), ti.u32(2), where, ti.cast(t / 2.0, ti.i32), 0)
        return ti.Vector([ti.select(u[0] < self.chance[k, m], 100.0, 0.0)])

    @ti.func
    def velocity(self, x, t):
        return ti.Vector([0.5, 0.0])


@pytest.mark.slow
def test_it_finds_the_source_in_the_world_it_believes_in():
    source = (0.6, 0.7)
    run = Run(MODEL, Patches(source), positions=((2.6, 1.6),), trials=40, sources=[source], reach=0.3)
    run.go(300)
    now = run.swarm.snapshot()
    assert now["found"].mean() >= 0.9
    assert np.nanmedian(now["path_length"]) < 4 * np.hypot(2.0, 0.9)
