"""PlumeSim's plumes against NumPy and SciPy: points of files, the puff on nodes, the random plume of points."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree  # type: ignore[attr-defined]

from taichi_plume.assembly.assemble import assemble
from taichi_plume.assembly.preparation import load_scenario
from taichi_plume.files.point_frames import PointFrames
from taichi_plume.files.run_folder import to_yaml
from taichi_plume.grid.fields import concentration_at, ppm_at, velocity_at
from taichi_plume.scenario.playback import PlumeSimWind
from taichi_plume.scenario.plumesim import PlumeSimGas, PlumeSimMeander, PlumeSimPuff
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.solvers.plumesim import (
    PointFilm,
    PointGas,
    PointWind,
    ProgramMeander,
    ProgramPuff,
    meandering_points,
)

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

EXTENT = (1.5, 1.0)
RNG = np.random.default_rng(3)
POINTS = RNG.uniform([0, 0], EXTENT, (2000, 2)).astype(np.float32)


def frames(counts: tuple[int, ...] = (300, 40, 0, 200), cell: float = 0.06) -> PointFrames:
    """Points at random places, some of them out of the domain."""
    rng = np.random.default_rng(8)
    n = sum(counts)
    place = rng.uniform([-0.2, -0.2], [1.7, 1.2], (n, 2))
    begin = np.concatenate([[0], np.cumsum(counts)])
    return PointFrames(Path("a"), 0.5, cell, place, rng.normal(size=(n, 2)), rng.uniform(0, 100, n), begin)


def points(place: ArrayLike, percent: Any, cell: float) -> PointFrames:
    """One frame of gas in air at rest."""
    place = np.array(place)
    n = len(place)
    percent = np.broadcast_to(np.asarray(percent, float), n)
    return PointFrames(Path("a"), 1.0, cell, place, np.zeros((n, 2)), percent, np.array([0, n]))


def gas_of(**keys: Any) -> PlumeSimGas:
    return PlumeSimGas.model_validate({"kind": "plumesim_log", "file": "a", **keys})


def wind_of(**keys: Any) -> PlumeSimWind:
    return PlumeSimWind.model_validate({"kind": "plumesim_log", "file": "a", **keys})


def ppm(gas: Any, points: np.ndarray) -> np.ndarray:
    return concentration_at(gas, points, 0.0) * gas.species.ppm_per_density


def nearest(known: PointFrames, k: int, values: np.ndarray, offset: tuple[float, float]) -> np.ndarray:
    """Values of the nearest point of frame k that is closer than the cell, else zero, by a tree."""
    own = known.frame(k)
    if own.start == own.stop:
        return np.zeros((len(POINTS), *values.shape[1:]))
    far, which = cKDTree(known.place[own] + offset).query(POINTS)
    taken = values[own][which]
    taken[far >= known.cell] = 0.0
    return taken


@pytest.mark.parametrize("cell", [0.06, 0.3, 0.0005])
def test_a_reading_is_the_nearest_points_within_a_cell(cell):
    known = frames(cell=cell)
    model = gas_of(full_scale_ppm=200, offset=[0.05, -0.03])
    gas = PointGas(model, known, EXTENT)
    wind = PointWind(wind_of(offset=[0.05, -0.03]), known, EXTENT)
    for k in range(4):
        gas.advance(0.5 * k - 0.1, 0.1)
        wind.advance(0.5 * k - 0.1, 0.1)
        wanted = 2.0 * nearest(known, k, known.percent, (0.05, -0.03))
        np.testing.assert_allclose(ppm(gas, POINTS), wanted, rtol=2e-6)
        flow = nearest(known, k, known.wind, (0.05, -0.03))
        np.testing.assert_allclose(velocity_at(wind, POINTS, 0.0), flow, rtol=1e-6)
    assert cell < 0.01 or ppm(gas, POINTS).any()


def test_of_points_in_one_place_the_first_counts():
    gas = PointGas(gas_of(), points([[0.5, 0.5], [0.5, 0.5], [0.61, 0.5]], [10, 20, 30], 0.2), EXTENT)
    at = np.array([[0.5, 0.5], [0.54, 0.52], [0.6, 0.45]])
    np.testing.assert_allclose(ppm(gas, at), [10, 10, 30], rtol=1e-6)


def test_between_points_of_a_lattice_it_is_bilinear():
    axes = [np.arange(0, 1.51, 0.1), np.arange(0, 1.01, 0.1)]
    place = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    percent = 3 + 10 * place[:, 0] + 4 * place[:, 1] + 20 * place[:, 0] * place[:, 1]  # bilinear all over
    gas = PointGas(gas_of(interpolate=True), points(place, percent, 0.1), EXTENT)
    x, y = POINTS.T.astype(float)
    np.testing.assert_allclose(ppm(gas, POINTS), 3 + 10 * x + 4 * y + 20 * x * y, rtol=2e-5)


def test_a_lattice_of_cells_is_read_up_to_the_walls():
    known = points([[x, y] for x in (0.25, 0.75, 1.25) for y in (0.25, 0.75)], 70.0, 0.5)
    np.testing.assert_allclose(ppm(PointGas(gas_of(interpolate=True), known, EXTENT), POINTS), 70, rtol=1e-5)


def test_between_scattered_points_nothing_jumps_and_nothing_exceeds():
    known = frames((400,), cell=0.1)
    gas = PointGas(gas_of(interpolate=True), known, EXTENT)
    line = np.stack([np.linspace(0, 1.5, 15001), np.full(15001, 0.4)], axis=-1)
    seen = ppm(gas, line)
    assert seen.max() <= known.percent.max() * (1 + 1e-6)
    assert seen.max() > 10
    assert np.abs(np.diff(seen)).max() < 1.0  # of 100 in 0.1 mm; a jump would be of tens


@pytest.mark.parametrize(
    ("keys", "t", "frame"),
    [
        ({}, -3.0, 0),
        ({}, 0.49, 0),
        ({}, 0.5, 1),
        ({}, 99.0, 3),
        ({"rate": 2}, 0.5, 2),
        ({"rate": 0.5}, 1.9, 1),
        ({"start": 1.0}, 0.6, 3),
        ({"loop": True}, 2.0, 0),
        ({"loop": True}, 7.2, 2),
        ({"loop": True}, -0.2, 3),
        ({"rate": 1e6}, 1e5, 3),
        ({"rate": 1e-6}, 1e5, 0),
        ({"start": -1e9, "loop": True}, 1e5, 0),
    ],
)
def test_frames_hold_until_the_next_one(keys, t, frame):
    known = frames((5, 6, 7, 8))
    model = gas_of(**keys)
    film = PointFilm(model, known, EXTENT, known.percent[:, None], 0.0)
    assert film.frame_at(t) == frame


@pytest.mark.parametrize("interpolate", [False, True])
def test_extreme_cells_give_numbers(interpolate):
    for cell in (1e-300, 1e300):
        model, known = gas_of(interpolate=interpolate), frames(cell=cell)
        seen = ppm(PointGas(model, known, EXTENT), np.concatenate([POINTS, known.place[:5]]))
        assert ((seen >= 0) & (seen <= 100.1)).all()


# ---------------------------------------------------------------- the program's own plumes


def puff_by_numpy(
    x: np.ndarray, release: tuple[float, float], n: int, extent: tuple[float, float], around: bool
) -> np.ndarray:
    """Percent at points, by searching all nodes."""
    i, j = (np.arange(1 - round(10 * width) if around else 0, round(10 * width)) for width in extent)
    node = np.stack(np.meshgrid(0.1 * i, 0.1 * j, indexing="ij"), axis=-1).reshape(-1, 2) + release
    dx, dy = (node - release).T
    peak = 100 / (4 * np.pi * np.sqrt(0.2 * 0.005) * n)
    c = peak * np.exp(-(dx**2) / (4 * 0.2 * n) - dy**2 / (4 * 0.005 * n))
    far, which = cKDTree(node).query(x)
    return np.where(far < 0.1, c[which], 0.0)


@pytest.mark.parametrize("around", [False, True])
def test_the_puff_is_the_programs(around):
    model = PlumeSimPuff(
        kind="plumesim_gaussian", release_point=(0.33, 0.41), full_scale_ppm=50, all_around=around
    )
    extent = (4.0, 3.0)
    gas = ProgramPuff(model, extent)
    x = RNG.uniform([0, 0], extent, (3000, 2)).astype(np.float32)
    order = [1, 2, *range(3, 26), *range(20, 26), *range(20, 26)]
    for k in (0, 1, 24, 25, 30, 31):
        gas.advance(k + 0.2, 0.1)
        wanted = 0.5 * puff_by_numpy(x, (0.33, 0.41), order[k], extent, around)
        # places as far from two nodes may go to either
        agree = np.isclose(ppm(gas, x), wanted, rtol=1e-4, atol=1e-30)
        assert agree.mean() > 0.999
        assert (wanted > 1).sum() > 20
    assert gas.frame_at(-5.0) == 1


def meander_of(**keys: Any) -> PlumeSimMeander:
    return PlumeSimMeander.model_validate(
        {"kind": "plumesim_meandering", "release_point": [0.2, 0.5], **keys}
    )


def test_the_meander_counts_points_within_its_radius():
    model = meander_of(dispersion=0.005, release_rate=20)
    gas = ProgramMeander(model, EXTENT, seed=4)
    tree = cKDTree(gas.place)
    most = len(tree.query_ball_point([0.3, 0.5], 0.1 + 1e-9))  # with the release itself, 0.1 m away
    counts = np.array([len(found) for found in tree.query_ball_point(POINTS.astype(float), 0.1)])
    np.testing.assert_allclose(ppm(gas, POINTS), np.minimum(100.0, 100.0 * counts / most), rtol=1e-5)
    assert 0 < (counts > 0).mean() < 1
    place = gas.place
    np.testing.assert_array_equal(ProgramMeander(model, EXTENT, seed=4).place, place)
    assert not np.array_equal(ProgramMeander(model, EXTENT, seed=5).place, place)


def test_the_meander_has_the_programs_statistics():
    model = meander_of(points=200, dispersion=0.02, release_rate=5)
    rng = np.random.default_rng(1)
    draws = np.array([meandering_points(model, 2.2, rng) for _ in range(4000)])
    x = draws[0, :, 0]
    assert 200 <= len(x) <= 220
    assert x[0] == 0.2
    np.testing.assert_allclose(x[-1], 0.2 + 19 * 0.1)
    np.testing.assert_array_equal(draws[0, :, 0], draws[1, :, 0])
    at = np.argmin(np.abs(x - (0.2 + 19 * 0.1)))
    # centre line at station i: i v0 + sum_k (i - 1 - k) a_k, each of variance s² = (0.2 dx)², dx = 0.1; strays of
    # 0.1 (x - x0). The standard deviation of 4000 draws is known to 1.1 %: three of these.
    spread = (0.2 * 0.1) ** 2 * (19**2 + sum((18 - k) ** 2 for k in range(18))) + (0.1 * 1.9) ** 2
    assert draws[:, at, 1].std() == pytest.approx(np.sqrt(spread), rel=0.034)
    assert abs(draws[:, at, 1].mean() - 0.5) < 4 * np.sqrt(spread / 4000)


# ---------------------------------------------------------------- runs

LOG = "1000,2,0.2\n+0 2\n0.5,0.5,0,0.4,0,50\n1.0,0.5,0,0.2,3.14159265,100\n+1 1\n0.5,0.5,0,0.4,0,20\n"
MIXED = """
duration: 2
stop_early: false
domain: {size: [1.5, 1.0], spacing: 0.05}
wind: {kind: uniform, velocity: [0.3, 0]}
gas:
  kind: mixture
  parts:
    - {kind: plumesim_log, file: plume.pslog, species: acetone, sources: [{position: [0.5, 0.5]}]}
    - {kind: eulerian, sources: [{position: [0.2, 0.3], rate: 1.0e-5}]}
    - {kind: eulerian, species: acetone, sources: [{position: [0.2, 0.3], rate: 1.0e-5}]}
robots:
  - name: n
    count: 1
    start: {kind: positions, positions: [[1.0, 0.5]], heading_deg: 180}
    algorithm: {kind: casting, upwind_angle_deg: 0}
    sensors: {gas: {kind: ideal}, wind: {kind: ideal}}
    reach: 0.45
"""


def test_a_log_adds_to_a_computed_plume_and_robots_find_its_source(tmp_path):
    (tmp_path / "plume.pslog").write_text(LOG)
    sim = assemble(Scenario.model_validate(yaml.safe_load(MIXED)), tmp_path)
    sim.run()
    logged, _, computed = (concentration_at(gas, POINTS, sim.t) for gas in sim.gas.gases)
    both = ppm_at(sim.gas, POINTS, sim.t)[:, 0]
    scale = sim.gas.gases[0].species.ppm_per_density
    np.testing.assert_allclose(both, (logged + computed) * scale, rtol=1e-5, atol=1e-6)
    assert logged.max() * scale == pytest.approx(20)
    assert computed.max() > 0
    assert sim.scenario.sources[0][0] == "gas.parts[0].sources[0]"
    assert sim.swarm.all_over()


def test_in_three_dimensions_it_is_the_same_at_every_height(tmp_path):
    (tmp_path / "plume.pslog").write_text(LOG)
    data = {
        "duration": 1,
        "domain": {"size": [1.5, 1.0, 0.5], "spacing": 0.1},
        "wind": {"kind": "plumesim_log", "file": "plume.pslog"},
        "gas": {"kind": "plumesim_log", "file": "plume.pslog"},
    }
    sim = assemble(Scenario.model_validate(data), tmp_path)
    for z in (0.0, 0.3, 0.5):
        at = np.array([[0.55, 0.5, z], [1.0, 0.45, z], [0.1, 0.1, z]])
        np.testing.assert_allclose(ppm_at(sim.gas, at, 0.0)[:, 0], [50, 100, 0], rtol=1e-6)
        np.testing.assert_allclose(
            velocity_at(sim.wind, at, 0.0), [[0.4, 0, 0], [-0.2, 0, 0], [0, 0, 0]], atol=1e-7
        )


def test_exports_of_fluent_are_played_by_a_run_and_by_its_resolved_scenario(tmp_path):
    for n, value in enumerate((0.02, 0.04), start=1):
        (tmp_path / f"smoke-{n}.txt").write_text(f"nodenumber,x,y,c\n1,0.5,0.5,{value}\n2,1.0,0.5,0.01\n")
    data = {
        "duration": 1,
        "domain": {"size": [1.5, 1.0], "spacing": 0.1},
        "wind": {"kind": "uniform", "velocity": [0.5, 0]},
        "gas": {"kind": "fluent", "files": "smoke-%d.txt", "period": 0.4, "full_scale_ppm": 300},
    }
    again = tmp_path / "runs" / "a"
    again.mkdir(parents=True)
    (again / "scenario.yaml").write_text(to_yaml(Scenario.model_validate(data), tmp_path, again))
    scenario = load_scenario(again / "scenario.yaml", allow_outside=True)
    sim = assemble(scenario, again, allow_outside=True)
    at = np.array([[0.45, 0.5], [1.0, 0.55], [0.75, 0.5]])
    np.testing.assert_allclose(ppm_at(sim.gas, at, 0.0)[:, 0], [150, 75, 0], rtol=1e-6)
    sim.run()
    np.testing.assert_allclose(ppm_at(sim.gas, at, sim.t)[:, 0], [300, 75, 0], rtol=1e-6)
