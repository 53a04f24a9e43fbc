"""Beliefs on a grid of cells, and the rule by which robots say where the source is."""

import numpy as np
import pytest
from arena import Run, Script

from taichi_plume.agents.beliefs import Believer
from taichi_plume.engine import ti
from taichi_plume.grid.kernels import Template
from taichi_plume.scenario.belief_algorithms import Infotaxis

pytestmark = pytest.mark.usefixtures("taichi")

SPREAD = 0.3
MODEL = Infotaxis(kind="infotaxis", cell=0.15, declare_spread=SPREAD)
LOW = (-1.0, 0.5)


@pytest.fixture(scope="module")
def run(taichi):
    return Run(MODEL, Script([0.0], 1.0), positions=((0.5, 1.5),), low=LOW, sources=[(1.0, 1.0)], reach=0.2)


@ti.kernel
def consider(algorithm: Template, x: float, y: float, spread: float, t: float):
    algorithm.declaring.consider(0, ti.Vector([x, y]), spread, t)


@ti.kernel
def mean_and_spread(algorithm: Template) -> ti.math.vec3:
    mean = algorithm.belief.mean(0)
    return ti.math.vec3(mean[0], mean[1], algorithm.belief.spread(0, mean))


def test_a_new_word_is_for_a_new_place(run):
    run.begin(MODEL)
    reported = []
    beliefs = [(2.0, 1.01 * SPREAD), (2.0, 0.9 * SPREAD), (2.0, 2.0), (2.1, 0.1), (1.3, 2.0), (1.3, 0.1)]
    for t, (x, spread) in enumerate(beliefs, 1):
        consider(run.algorithm, x, 1.0, spread, float(t))
        reported.append(int(run.swarm.snapshot()["declarations"][0]))
    assert reported == [0, 1, 1, 1, 1, 2]
    consider(run.algorithm, 1.1, 1.0, 0.1, 7.0)  # not two spreads off the last word
    reported = run.swarm.snapshot()
    assert reported["declarations"] == reported["false_declarations"] == 2
    assert reported["declared_position"][0] == pytest.approx((1.3, 1.0))


def test_who_never_declares(run):
    run.begin(MODEL.model_copy(update={"declare_spread": None}))
    consider(run.algorithm, 1.0, 1.0, 1e-6, 1.0)
    assert run.swarm.snapshot()["declarations"] == 0


def test_mean_and_spread(run):
    run.begin(MODEL)
    algorithm = run.algorithm
    assert isinstance(algorithm, Believer)
    assert algorithm.belief_low == pytest.approx(LOW)
    p = np.random.default_rng(1).random(algorithm.beliefs().shape).astype(np.float32) ** 8
    p /= p.sum()
    algorithm.belief.p.from_numpy(p)
    np.testing.assert_array_equal(algorithm.beliefs(), p)
    x, y = (np.indices(p.shape[1:]) + 0.5) * algorithm.belief_cell
    mean = (p[0] * x).sum(), (p[0] * y).sum()
    # of points drawn evenly in the cells
    inner = 2 * algorithm.belief_cell**2 / 12
    spread = np.sqrt((p[0] * ((x - mean[0]) ** 2 + (y - mean[1]) ** 2)).sum() + inner)
    assert mean_and_spread(algorithm).to_numpy() == pytest.approx([*mean, spread], rel=1e-4)
