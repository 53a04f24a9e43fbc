"""Prior of the source's position: read from each form, the start of beliefs, and part of Bayes' rule."""

from pathlib import Path

import numpy as np
import pytest
from arena import Run, Script
from PIL import Image
from scipy.special import k0

import taichi_plume as tp
from taichi_plume.assembly.preparation import load_scenario
from taichi_plume.engine import ti
from taichi_plume.files.prior_map import PriorMap
from taichi_plume.grid.kernels import Template
from taichi_plume.scenario.belief_algorithms import Infotaxis
from taichi_plume.scenario.domain import Arena
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scenario.prior import Prior

pytestmark = pytest.mark.usefixtures("taichi")

FLOOR = Arena(low=(0, 0), high=(3.0, 2.0))
WEIGHTS = np.random.default_rng(4).random((4, 6))  # (y, x), in cells of 0.5 m
ROOM = {
    "duration": 2,
    "seed": 3,
    "domain": {"size": [3, 2], "spacing": 0.1},
    "wind": {"kind": "synthetic", "speed": 0.1},
    "gas": {
        "kind": "eulerian",
        "sources": [{"position": [0.4, 1.1], "rate": "20 mg/s"}],
    },
    "obstacles": [{"kind": "box", "center": [1.5, 0.5], "size": [1.0, 1.0]}],
}
WALL = {"areas": [{"vertices": [[1.2, 0.2], [1.8, 0.2], [1.8, 0.8]], "weight": 1}], "rest": 0}


def room(prior, kind="infotaxis", **keys):
    robots = {"count": 1, "start": {"kind": "positions", "positions": [[2.5, 1.5]]}}
    return ROOM | {"robots": [robots | {"algorithm": {"kind": kind, "prior": prior} | keys}]}


def means(prior, cells=(6, 4), cell=0.5, folder=Path()):
    return PriorMap(Prior.model_validate(prior), FLOOR, folder).on((0.0, 0.0), cell, cells)


def test_forms_agree(tmp_path):
    """Values, arrays and a picture give equal weights; cells that are not pixels take means weighted by area."""
    grey = np.round(255 * WEIGHTS).astype(np.uint8)
    Image.fromarray(grey[::-1]).save(tmp_path / "guess.png")
    np.save(tmp_path / "guess.npy", grey)
    np.savez(tmp_path / "guess.npz", prior=grey, other=grey + 1)
    np.testing.assert_allclose(means({"values": WEIGHTS.tolist()}), WEIGHTS.T, rtol=1e-12)
    for name, most in (("guess.png", 255), ("guess.npy", grey.max()), ("guess.npz", grey.max())):
        np.testing.assert_allclose(means({"file": name}, folder=tmp_path), grey.T / most, rtol=1e-12)
    fine = np.kron(WEIGHTS, np.ones((15, 15)))  # pixels of 1/30 m
    coarse = fine.reshape(3, 20, 5, 18).mean(axis=(1, 3))  # cells of 20 x 18 of them
    there = {"values": WEIGHTS.tolist(), "resolution": 0.5, "origin": [0.0, 0.0]}
    on = PriorMap(Prior.model_validate(there), FLOOR, Path()).on((0.0, 0.0), (0.6, 2 / 3), (5, 3))  # type: ignore[arg-type]
    np.testing.assert_allclose(on, coarse.T, rtol=1e-12)


def test_areas_have_the_weight_of_their_parts():
    """A triangle covers half of a square; the later of two areas counts; the rest has its own weight."""
    square = [[0, 0], [1, 0], [1, 1], [0, 1]]
    areas = [{"vertices": square, "weight": 8}, {"vertices": [[0, 0], [1, 0], [1, 1]], "weight": 2}]
    weights = means({"areas": areas, "rest": 0.5}, cells=(3, 2), cell=1.0)
    assert weights[0, 0] == pytest.approx(5.0, abs=0.5)  # by 8 x 8 points
    np.testing.assert_array_equal(np.delete(weights.ravel(), 0), 0.5)


@ti.kernel
def learn(algorithm: Template, detected: int):
    algorithm.readings.place[0] = ti.Vector([1.25, 0.75])
    algorithm.readings.value[0], algorithm.readings.wind[0] = detected, ti.Vector([1.0, 0.0])
    algorithm._learn(0, 0)


def test_posterior_by_bayes_rule(taichi):
    """The posterior is prior times likelihoods over their sum, with the published likelihood in f64. Evidence that
    rules out all cells brings the prior back.
    """
    model = Infotaxis(kind="infotaxis", cell=0.5, step=0.5, acquisition=2.0)
    run = Run(model, Script([0.0], 1.0), positions=((1.25, 0.75),), size=(3.0, 2.0), found="declared")
    run.swarm.priors = {0: PriorMap(Prior.model_validate({"values": WEIGHTS.tolist()}), FLOOR, Path())}  # type: ignore
    algorithm = type(run.algorithm)(run.swarm, run.algorithm.members, 0.1)
    prior = WEIGHTS.T / WEIGHTS.sum()
    np.testing.assert_allclose(algorithm.beliefs()[0], prior, rtol=1e-6)
    x, y = 0.5 * (np.indices((6, 4)) + 0.5)
    along, distance = x - 1.25, np.maximum(np.hypot(x - 1.25, y - 0.75), model.size)  # wind unknown: along x
    D, V, tau = model.diffusivity, model.wind_speed, model.lifetime
    fades = np.sqrt(D * tau / (1 + V**2 * tau / (4 * D)))
    rate = model.rate / np.log(fades / model.size) * np.exp(-V * along / (2 * D)) * k0(distance / fades)
    hit = 1 - np.exp(-rate * 2.0)
    wanted = prior.copy()
    for detected in (1, 0, 1, 0, 0):
        learn(algorithm, detected)
        wanted *= hit if detected else 1 - hit
        wanted /= wanted.sum()
        np.testing.assert_allclose(algorithm.beliefs()[0], wanted, rtol=2e-4, atol=1e-9)
    algorithm.belief.p.fill(0.0)
    learn(algorithm, 1)
    np.testing.assert_allclose(algorithm.beliefs()[0], prior, rtol=1e-6)


def test_particles_follow_the_prior():
    """Before a detection the belief is the prior. Afterwards weighted particles have the prior times the likelihood:
    no particle is where the prior is zero, and with equal likelihoods its two halves keep their ratio.
    """
    prior = {"areas": [{"vertices": [[0, 0], [1, 0], [1, 2], [0, 2]], "weight": 3}], "rest": 0.0}
    prior["areas"].append({"vertices": [[0, 1], [1, 1], [1, 2], [0, 2]], "weight": 1})
    keys = {"particles": 20_000, "false_alarm": 1.0, "cell": 0.25}  # whose likelihood is 1 everywhere
    with tp.Simulation(room(prior, "particle_filter", **keys), overrides={"obstacles": []}) as sim:
        (team,) = sim._loop.teams  # type: ignore[attr-defined]
        filtered = team.algorithm
        before = filtered.beliefs()[0]
        draw(filtered)
        filtered.known.fill(1)
        after = filtered.beliefs()[0]
    np.testing.assert_allclose(before[:4, :4], 3 / 64, rtol=1e-6)
    np.testing.assert_allclose(before[:4, 4:], 1 / 64, rtol=1e-6)
    assert (after[4:] == 0.0).all()
    assert after[:4, 4:].sum() == pytest.approx(0.25, abs=0.02)


@ti.kernel
def draw(algorithm: Template):
    for m in range(algorithm.count):
        algorithm._draw(0, m, 7)


class Reader:
    """User's algorithm that reads the prior."""

    def act(self, robots: tp.Robots):
        self.prior = robots.prior(0.5)


def test_own_code_reads_the_prior():
    own = tp.Own(Reader) | {"prior": {"values": WEIGHTS.tolist()}}
    with tp.Simulation(room(None), overrides={"robots.0.algorithm": own}) as sim:
        sim.step()
        (team,) = sim._loop.teams  # type: ignore[attr-defined]
        np.testing.assert_allclose(team.algorithm.algorithm.prior, WEIGHTS.T / WEIGHTS.sum(), rtol=1e-9)


def faults(prior, folder, kind="infotaxis"):
    with pytest.raises(ScenarioError) as caught:
        load_scenario(room(prior, kind), folder=folder)
    (line,) = caught.value.faults
    return line


@pytest.mark.parametrize(
    ("prior", "key", "says"),
    [
        ({"values": [[0, 0], [0, 0]]}, "values", "zero everywhere"),
        (
            {"areas": [{"vertices": [[0, 0], [1, 0], [1, 1]], "weight": 0}], "rest": 0},
            "areas",
            "zero everywhere",
        ),
        ({"areas": [{"vertices": [[4, 0], [5, 0], [5, 1]], "weight": 1}]}, "areas[0].vertices", "x 0 to 3 m"),
        ({"values": [[1]], "resolution": 0.5, "origin": [3, 0]}, "values", "x 3 to 3.5 m"),
        ({"values": [[1, -2]]}, "values[0][1]", "-2"),
        ({"values": [[1, float("nan")]]}, "values[0][1]", "nan"),
        ({"values": [[1, 2], [1]]}, "values", "1 to 2"),
        ({"file": "a.npy", "values": [[1]]}, "prior", "both"),
        ({"values": [[1]], "rest": 0}, "rest", "areas"),
        ({"file": "none.png"}, "file", "none.png"),
        ({"file": "text.png"}, "file", "text.png"),
        ({"file": "text.npy"}, "file", "text.npy"),
        ({"file": "guess.txt"}, "file", ".npz"),
        ({"file": "cube.npy"}, "file", "(2, 2, 2)"),
        ({"file": "infinite.npy"}, "file", "[1, 0] is inf"),
        ({"file": "less.npy"}, "file", "[0, 1] is -1"),
        ({"file": "two.npz"}, "file", "a, b"),
    ],
)
def test_bad_priors(prior, key, says, tmp_path):
    for name in ("text.png", "text.npy"):
        (tmp_path / name).write_text("no numbers")
    np.save(tmp_path / "cube.npy", np.ones((2, 2, 2)))
    np.save(tmp_path / "infinite.npy", np.array([[1.0], [np.inf]]))
    np.save(tmp_path / "less.npy", np.array([[1.0, -1.0]]))
    np.savez(tmp_path / "two.npz", a=np.ones((2, 2)), b=np.ones((2, 2)))
    line = faults(prior, tmp_path)
    assert line.startswith("robots[0].algorithm.")
    assert key in line.split(": ")[0] + line.split(": ")[1]
    assert says in line
    assert "\n" not in line


@pytest.mark.parametrize("kind", ["infotaxis", "hit_map", "particle_filter", "source_term"])
def test_a_prior_in_a_wall_is_refused(kind):
    with pytest.raises(ScenarioError, match=r"robots\[0\].algorithm.prior: .*zero in all cells"):
        tp.Simulation(room(WALL, kind))


def test_a_prior_behind_walls_is_refused():
    """Gas of a closed room does not reach the robots: the hit map has no cell there."""
    gas = {"kind": "eulerian", "sources": [{"position": [2, 1], "rate": "20 mg/s"}]}
    closed = {"gas": gas, "obstacles": [{"kind": "box", "center": [1.0, 1.0], "size": [0.1, 2.0]}]}
    prior = {"areas": [{"vertices": [[0, 0], [0.5, 0], [0.5, 2], [0, 2]], "weight": 1}], "rest": 0}
    with pytest.raises(ScenarioError, match="gas and robots can reach"):
        tp.Simulation(room(prior, "hit_map") | closed)
    prior["rest"] = 1
    with tp.Simulation(room(prior, "hit_map") | closed) as sim:
        (team,) = sim._loop.teams  # type: ignore[attr-defined]
        belief = team.algorithm.beliefs()[0]
    assert (belief[:4] == 0.0).all()
    assert belief.sum() == pytest.approx(1.0)


def test_the_prior_is_written(tmp_path):
    run = tp.simulate(room({"values": WEIGHTS.tolist()}, cell=0.5, declare_spread=None), out=tmp_path / "run")
    (belief,) = run.beliefs
    np.testing.assert_allclose(belief["prior"], WEIGHTS / WEIGHTS.sum(), rtol=1e-6)
    assert belief["prior"].dims == ("y", "x")
