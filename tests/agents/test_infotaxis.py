"""Infotaxis: its rates, beliefs and expectations against literal formulas, and a search in the world it believes in."""

import numpy as np
import pytest
import taichi as ti
from arena import Run, Script
from scipy.special import k0

from taichi_plume.agents.infotaxis import detection_rate
from taichi_plume.grid.kernels import Template
from taichi_plume.grid.rng import uniform4
from taichi_plume.scenario.listening import Infotaxis

pytestmark = pytest.mark.usefixtures("taichi")

pytestmark = pytest.mark.usefixtures("taichi")

MODEL = Infotaxis(kind="infotaxis", cell=0.15)


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
def expect(algorithm: Template, x: float, y: float) -> float:
    return algorithm._expected_entropy(0, ti.Vector([x, y]))


def test_belief_and_expectation():
    """After some acquisitions without and with gas, the belief is the product of the likelihoods."""
    levels = np.array([0.0, 9.0, 0.0, 9.0])
    run = Run(MODEL, Script(np.repeat(levels, 100), 0.05), positions=((1.5, 1.0),))
    algorithm = run.algorithm
    places, seen = [], []
    done = 0
    while done < 4:
        run.go(0.1)
        count = run.swarm.acquisitions.to_numpy()[0]
        if count > done:
            done = count
            places.append(run.swarm.position.to_numpy()[0].astype(float))
            seen.append(run.swarm.hits.to_numpy()[0])
    detected = np.diff(seen, prepend=0)
    assert 0 < detected.sum() < 4
    centers = [(np.arange(n) + 0.5) * MODEL.cell for n in algorithm.cells]
    X, Y = np.meshgrid(*centers, indexing="ij")
    belief = np.full(X.shape, 1.0 / X.size)

    def chance(p):
        # the algorithm looks its rate up on nodes half a cell apart
        on_node = [
            np.floor((c - q) / algorithm.spacing + 0.5) * algorithm.spacing for c, q in ((X, p[0]), (Y, p[1]))
        ]
        return -np.expm1(-rate_of_the_paper(MODEL, *on_node) * MODEL.acquisition)

    for p, hit in zip(places, detected, strict=True):
        belief *= chance(p) if hit else 1 - chance(p)
    belief /= belief.sum()
    np.testing.assert_allclose(algorithm.belief.to_numpy()[0], belief, atol=2e-4 * belief.max())
    there = np.array([1.1, 0.7])
    p1 = chance(there)
    hit = (belief * p1).sum()
    expected = hit * entropy(belief * p1 / hit) + (1 - hit) * entropy(belief * (1 - p1) / (1 - hit))
    cell = tuple((there / MODEL.cell).astype(int))
    assert expect(algorithm, *there) == pytest.approx((1 - belief[cell]) * expected, rel=1e-3)


@ti.data_oriented
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
    run = Run(
        MODEL,
        Patches(source),
        positions=((2.6, 1.6),),
        trials=40,
        sources=[source],
        reach=0.3,
    )
    run.go(300)
    now = run.swarm.snapshot()
    assert now["found"].mean() >= 0.9
    assert np.nanmedian(now["path_length"]) < 4 * np.hypot(2.0, 0.9)
