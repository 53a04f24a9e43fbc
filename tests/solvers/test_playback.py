"""A film of a computed run, played back: the same air and gas at the recorded times, and what lies between."""

from types import SimpleNamespace

import numpy as np
import pytest
from rooms import divergence, largest_outflow
from test_film import DX, SHAPE, new_film

from taichi_plume.assembly.assemble import assemble
from taichi_plume.assembly.preparation import load_scenario
from taichi_plume.engine import program
from taichi_plume.execution.film_output import Filming
from taichi_plume.files.film import Film
from taichi_plume.grid.fields import concentration_at, velocity_at
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.gases import PlaybackGas
from taichi_plume.scenario.playback import PlaybackWind
from taichi_plume.solvers.playback import PlayedGas, PlayedWind
from taichi_plume.time_loop import Every, TimeLoop

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

LIVE = """
seed: 3
duration: 2
warm_up: 2
domain: {size: [1.2, 0.8], spacing: 0.05, depth: 0.5}
wind:
  kind: cfd
  openings:
    - {kind: honeycomb, face: x-, speed: 0.7, turbulence_intensity: 0.1}
    - {kind: honeycomb, face: x+}
obstacles: [{kind: cylinder, center: [0.5, 0.35], radius: 0.1}]
gas: {kind: eulerian, species: acetone, sources: [{position: [0.3, 0.4], rate: 10 mg/s, start: -1}]}
fields: {rate: 10, start: -1}
"""
POINTS = np.random.default_rng(1).uniform([0, 0], [1.2, 0.8], (200, 2))


def watched(sim: TimeLoop) -> dict[float, tuple[np.ndarray, np.ndarray]]:
    """Runs; velocity and concentration at POINTS per tick from -1 s on."""
    seen = {}

    def look(sim: TimeLoop) -> None:
        if sim.tick >= -10:
            seen[sim.tick] = (
                velocity_at(sim.wind, POINTS, sim.t),
                concentration_at(sim.gas.gases[0], POINTS, sim.t),
            )

    sim.observers.append(Every(sim.dt, look, warm_up=True))
    sim.run()
    return seen


def filmed(folder, text):
    """What was seen of a computed run, its simulation, and the folder with its film."""
    (folder / "live.yaml").write_text(text)
    scenario = load_scenario(folder / "live.yaml")
    sim = assemble(scenario, folder)
    assert scenario.fields is not None
    filming = Filming(sim, folder / "fields.zarr", scenario.fields)
    filming.start()
    sim.observers.append(filming.observer())
    return SimpleNamespace(seen=watched(sim), sim=sim, folder=folder)


@pytest.fixture(scope="module")
def live(tmp_path_factory):
    """Of a computed flow."""
    program.start("cpu")
    return filmed(tmp_path_factory.mktemp("live"), LIVE)


def played(live, *overrides: str) -> TimeLoop:
    """The same scenario on the film's wind."""
    wind = "wind={kind: playback, file: fields.zarr}"
    scenario = load_scenario(live.folder / "live.yaml", [wind, "fields=null", "warm_up=1", *overrides])
    return assemble(scenario, live.folder)


def test_wind_and_gas_are_those_that_were_recorded(live):
    sim = played(live, "gas={kind: playback, file: fields.zarr}")
    again = watched(sim)
    assert sorted(again) == list(range(-10, 21))
    fastest = max(np.abs(u).max() for u, _ in live.seen.values())
    # the cells' own concentrations; at an inflow the live gas falls to the clean air outside
    far = (POINTS > 0.05).all(axis=1) & (POINTS < [1.15, 0.75]).all(axis=1)
    for tick, (u, c) in live.seen.items():
        np.testing.assert_allclose(again[tick][0], u, atol=1e-6 * fastest)
        np.testing.assert_allclose(again[tick][1][far], c[far], atol=1e-6 * c.max() + 1e-12)
    assert np.abs(live.seen[-10][0] - live.seen[20][0]).max() > 0.1, "the flow has changed meanwhile"
    assert sim.steps == 30, "nothing is solved for that would need shorter steps than ticks"


def test_at_the_time_of_a_frame_it_is_that_frame_however_the_time_was_reckoned(live):
    for t in (0.3, np.nextafter(0.3, 0.0), np.nextafter(0.3, 1.0), 0.1 + 0.2):
        wind = played(live).wind
        wind.advance(0.0, float(t))
        np.testing.assert_array_equal(velocity_at(wind, POINTS, 0.0), live.seen[3][0])


def test_between_frames_the_flow_is_their_mean_and_free_of_divergence(live):
    sim = played(live)
    wind = sim.wind
    assert isinstance(wind, PlayedWind)
    for tick in range(-10, 20, 7):
        wind.advance(0.1 * tick - 0.1, 0.1 + 0.025)
        mean = 0.75 * live.seen[tick][0] + 0.25 * live.seen[tick + 1][0]
        np.testing.assert_allclose(velocity_at(wind, POINTS, 0.0), mean, atol=2e-6)
        assert divergence(wind) < 1e-4  # what the pressure solver left, and rounding


def test_gas_disperses_on_a_played_flow_as_on_the_computed_one(live):
    sim = played(live)
    c, wanted = watched(sim)[20][1], live.seen[20][1]
    assert np.abs(c - wanted).sum() < 0.03 * wanted.sum()
    budget = sim.gas.gases[0].budget()
    lost = budget["emitted_kg"] - budget["in_domain_kg"] - budget["outflow_kg"]
    assert abs(lost) < 1e-5 * budget["emitted_kg"]


def test_a_film_of_a_synthetic_room_mixes_by_its_shorter_eddies_too(taichi, tmp_path):
    room = LIVE[: LIVE.index("wind:")] + "wind: {kind: synthetic}\n" + LIVE[LIVE.index("gas:") :]
    made = filmed(tmp_path, room)
    wanted, again = made.seen[20][1], played(made)
    wind, live = again.wind.carrier, made.sim.wind.carrier
    assert wind is not None
    assert live is not None
    np.testing.assert_array_equal(wind.grid.read(wind.nu), live.grid.read(live.nu))
    assert (wind.max_viscosity, wind.viscosity, wind.schmidt) == pytest.approx(
        (live.max_viscosity, live.viscosity, live.schmidt)
    )
    assert np.abs(watched(again)[20][1] - wanted).sum() < 0.03 * wanted.sum()


def model_of(**keys) -> PlaybackWind:
    return PlaybackWind.model_validate({"kind": "playback", "file": "f", **keys})


@pytest.fixture(scope="module")
def noise(taichi, tmp_path_factory):
    """Frames without sense, the film of them, its grid, and a wind that plays it from some time on."""
    folder = tmp_path_factory.mktemp("noise")
    frames = new_film(folder / "fields.zarr")
    film, grid = Film(folder / "fields.zarr"), Grid(SHAPE, DX)

    def wind(t: float, **keys) -> PlayedWind:
        return PlayedWind(model_of(**keys), film, grid, t)

    return SimpleNamespace(frames=frames, film=film, grid=grid, wind=wind)


def gas_of(**keys) -> PlaybackGas:
    return PlaybackGas.model_validate({"kind": "playback", "file": "f", "species": "acetone", **keys})


def u_of(wind: PlayedWind) -> np.ndarray:
    """The x-component on the faces, with a ghost layer along y and z."""
    return wind.grid.read(wind.u[0], 1)[1:]


@pytest.mark.parametrize(
    ("keys", "t", "weights"),
    [
        ({}, -3.0, (1, 0, 0)),
        ({}, 0.2, (0.6, 0.4, 0)),
        ({}, 0.5, (0, 1, 0)),
        ({}, 7.0, (0, 0, 1)),
        ({"rate": 2.0}, 0.4, (0, 0.4, 0.6)),
        ({"start": 0.5}, 0.1, (0, 0.8, 0.2)),
        ({"loop": True}, 1.25, (0.5, 0, 0.5)),
        ({"loop": True}, 1.7, (0.6, 0.4, 0)),
        ({"loop": True}, -0.25, (0.5, 0, 0.5)),
        ({"loop": True, "rate": 3.0}, 1.9, (0.4, 0, 0.6)),
    ],
)
def test_time_of_the_film(noise, keys, t, weights):
    wanted = sum(w * frame["u_face"].T for w, frame in zip(weights, noise.frames, strict=True))
    wind = noise.wind(t, **keys)
    np.testing.assert_allclose(u_of(wind), wanted, atol=1e-6)
    for n in range(11):  # back by a second, and step by step
        wind.advance(t - 1.1 + 0.1 * n, 0.1)
    np.testing.assert_allclose(u_of(wind), wanted, atol=3e-6)


def test_maxima_hold_between_frames(noise):
    wind = noise.wind(0.0)
    for t in (0.0, 0.1, 0.3, 0.45, 0.8):
        wind.advance(t, 0.02)
        flow = largest_outflow(wind)
        assert flow <= wind.outflow_rate * (1 + 1e-6)
        assert wind.outflow_rate < 1.5 * flow


def test_gas_between_cells_and_frames(noise):
    frames = noise.frames
    gas = PlayedGas(gas_of(), noise.film, noise.grid, 0.0)
    gas.advance(0.0, 0.25)
    c = 0.5 * (frames[0]["gas_acetone"] + frames[1]["gas_acetone"]).T
    found = concentration_at(gas, np.array([[0.15, 0.25, 0.15], [0.2, 0.25, 0.15], [0.01, 0.01, 0.01]]), 0.0)
    np.testing.assert_allclose(found, [c[1, 2, 1], 0.5 * (c[1, 2, 1] + c[2, 2, 1]), c[0, 0, 0]], rtol=2e-5)
    assert gas.species.ppm_per_density == pytest.approx(1e6 * 24.4654e-3 / 58.08e-3, rel=1e-5)
