"""Recorded airs against the airs themselves, and whose they are."""

import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from refusals import cut, gone, refused, replaced
from scipy.interpolate import RegularGridInterpolator
from small_task import TASK, task
from test_film_bank import Asking

from taichi_plume.assembly.assemble import build
from taichi_plume.assembly.preparation import checked
from taichi_plume.cli.envs import main
from taichi_plume.engine import program
from taichi_plume.envs import bank as banks
from taichi_plume.envs.bank import Bank, bank_of, key_of, read, record
from taichi_plume.execution.film_output import Filming
from taichi_plume.grid.fields import ppm_at, velocity_at
from taichi_plume.grid.grid import centers
from taichi_plume.scenario.loading import scenario_from
from taichi_plume.solvers.film_bank import FilmBank
from taichi_plume.time_loop import Every

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

POINTS = 200
HERE = Path()
ROOM = {
    **TASK,
    "wind": {
        "kind": "cfd",
        "openings": [
            {"kind": "honeycomb", "face": "x-", "speed": 0.5, "turbulence_intensity": 0.1},
            {"kind": "outlet", "face": "x+"},
        ],
    },
    "obstacles": [{"kind": "box", "center": [1.2, 0.65], "size": [0.2, 0.3]}],
    "gas": {"kind": "eulerian", "species": "acetone", "sources": [{"position": [0.4, 0.6], "rate": 1e-4}]},
    "fields": {"rate": 5},
    "duration": 2.0,
    "task": {"episode": 1.0, "airs": 2, "film": 2.0, "frame": 0.2},
}


@pytest.fixture(scope="module")
def closed():
    """Two airs of closed forms: the bank, and what it says at random places in the second one, over time."""
    program.start("cpu")
    scenario = scenario_from(TASK)
    bank = record(scenario)
    films = FilmBank(bank, POINTS)
    places = np.random.default_rng(2).uniform([0.05, 0.05], [1.95, 1.15], (POINTS, 2))
    asking = Asking(films, POINTS)

    def ask(film: int, gas: int, t: float) -> tuple[np.ndarray, np.ndarray]:
        films.film.fill(film)
        films.gas_of.fill(gas)
        films.now.fill(t)
        return asking(places)

    return SimpleNamespace(scenario=scenario, bank=bank, places=places, ask=ask)


def test_a_bank_gives_its_closed_forms_between_cells_and_frames(closed):
    air = banks.airs(closed.scenario)[1]
    sim = build(checked(air, HERE))
    axes = [(np.arange(n) + 0.5) * sim.grid.dx for n in sim.grid.shape]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    inner = np.clip(closed.places, [a[0] for a in axes], [a[-1] for a in axes])
    known: list[np.ndarray] = []

    def look(sim) -> None:
        ppm, wind = closed.ask(1, -1, sim.t)
        at_cells = ppm_at(sim.gas, grid, sim.t)
        known.append(at_cells)
        if sim.tick % 2:  # a frame is two ticks: half-way between two of them
            return
        np.testing.assert_allclose(wind, velocity_at(sim.wind, closed.places, sim.t), atol=2e-3)
        between = RegularGridInterpolator(axes, at_cells[..., 0])(inner)
        np.testing.assert_allclose(ppm[:, 0], between, atol=2e-3 * at_cells.max())
        truth = ppm_at(sim.gas, closed.places, sim.t)[:, 0]
        # a plume of width s: linear between centres dx apart is off by (dx/s)²/8 of its peak at most, s > 0.75 dx here
        smooth = np.linalg.norm(closed.places - [0.45, 0.6], axis=1) > 0.6
        assert np.abs(ppm[:, 0] - truth)[smooth].max() < 0.23 * truth.max()

    sim.observers.append(Every(sim.dt, look))
    while sim.tick < 10:
        sim.advance()
        sim.observe()
    assert len(known) == 11
    ppm, _ = closed.ask(1, -1, 0.5)
    mean = 0.5 * (known[4] + known[6])[..., 0]
    np.testing.assert_allclose(ppm[:, 0], RegularGridInterpolator(axes, mean)(inner), atol=2e-3 * mean.max())


def test_airs_differ_and_one_gas_is_alone(closed):
    both, first, second = (closed.ask(0, gas, 2.0)[0] for gas in (-1, 0, 1))
    assert first.max() > 0 < second.max()
    np.testing.assert_allclose(first + second, both, rtol=1e-5)
    other, wind = closed.ask(1, -1, 2.0)
    assert np.abs(other - both).max() > 0.1 * both.max()
    assert np.abs(wind - closed.ask(0, -1, 2.0)[1]).max() > 0.02
    assert [place.tolist() for place in closed.bank.sources[1]] == [[[0.4, 0.4]], [[0.5, 0.8]]]
    assert closed.bank.length == pytest.approx(6.0)


def test_a_bank_is_written_read_and_its_own_scenarios(closed, tmp_path):
    path = tmp_path / "bank.zarr"
    closed.bank.write(path)
    closed.bank.write(path)
    again = read(path)
    (path / "notes.txt").write_text("mine")
    with pytest.raises(ValueError, match=r"holds notes.txt"):
        closed.bank.write(path)
    assert (path / "notes.txt").read_text() == "mine"
    np.testing.assert_array_equal(again.values, closed.bank.values)
    assert again.species == closed.bank.species
    assert again.key == key_of(closed.scenario, HERE)
    assert bank_of(closed.scenario, HERE, path).films == 2
    robots = [{**TASK["robots"][0], "count": 1}]
    assert bank_of(scenario_from(task(robots=robots)), HERE, closed.bank) is closed.bank, (
        "robots are not in it"
    )
    for other in (
        {"seed": 4},
        {"task": {**TASK["task"], "airs": 3}},
        {"task": {**TASK["task"], "frame": 0.3}},
    ):
        with pytest.raises(ValueError, match="recorded of another scenario") as reported:
            bank_of(scenario_from(task(**other)), HERE, path)
        assert "\n" not in str(reported.value)


@pytest.mark.parametrize(
    "damage",
    [
        shutil.rmtree,
        gone("zarr.json"),
        replaced("zarr.json", banks.FORMAT, "taichi_plume shared film 1"),
        gone("values/c/0"),
        cut("air/zarr.json"),
    ],
)
def test_what_is_no_bank_is_reported_in_a_line(closed, tmp_path, damage):
    closed.bank.write(tmp_path / "bank.zarr")
    damage(tmp_path / "bank.zarr")
    with refused(ValueError, tmp_path / "bank.zarr", ""):
        read(tmp_path / "bank.zarr")


def test_a_bank_of_a_movie_holds_the_means_of_its_pixels(tmp_path):
    pictures = np.random.default_rng(4).random((31, 24, 40)).astype(np.float32)
    np.save(tmp_path / "m.npy", pictures)
    gas = {
        "kind": "movie", "file": "m.npy", "frame_rate": 5, "pixel": 0.05, "ppm_per_unit": 30,
        "sources": [{"position": [0.4, 0.6]}],
    }  # fmt: skip
    still = {"kind": "uniform", "velocity": [0.5, 0.0]}
    bank = record(scenario_from(task(wind=still, gas=gas, warm_up=0.0)), tmp_path)
    means = 30 * pictures.reshape(31, 12, 2, 20, 2).mean(axis=(2, 4)).swapaxes(1, 2)
    np.testing.assert_allclose(bank.values[0, ..., 2] * bank.scale[0, 0], means, rtol=1e-3)
    assert [place.tolist() for place in bank.sources[0]] == [[[0.4, 0.6]]]


def test_an_air_without_chance_is_recorded_once():
    still = {"kind": "uniform", "velocity": [0.5, 0.0]}
    gas = {"kind": "gaussian_plume", "sources": [{"position": [0.4, 0.6], "rate": 1e-5}], "diffusivity": 1e-2}
    assert len(banks.airs(scenario_from(task(wind=still, gas=gas)))) == 1


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """A computed air with a wall, as a scenario, its bank, and in a folder a film of the run itself."""
    program.start("cpu")
    folder = tmp_path_factory.mktemp("room")
    scenario = scenario_from(ROOM)
    bank = record(scenario, folder)
    sim = build(checked(banks.airs(scenario)[0].model_copy(update={"fields": scenario.fields}), folder))
    assert scenario.fields
    filming = Filming(sim, folder / "fields.zarr", scenario.fields)
    filming.start()
    sim.observers.append(filming.observer())
    points = centers(sim.grid.shape, sim.grid.dx)[~sim.air.solid]
    seen = []
    sim.observers.append(
        Every(
            0.2,
            lambda sim: seen.append((ppm_at(sim.gas, points, sim.t), velocity_at(sim.wind, points, sim.t))),
        )
    )
    sim.run()
    filming.close()
    return SimpleNamespace(scenario=scenario, bank=bank, folder=folder, seen=seen, solid=sim.air.solid)


def frames(bank: Bank, film: int, air: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gas [ppm] and wind [m/s] of all frames in the cells of air."""
    values = bank.values[film].astype(float)[:, air]
    return values[..., 2] * bank.scale[film, 0], values[..., :2]


def test_computed_airs_are_those_of_their_seeds_at_every_frame(room):
    assert np.array_equal(room.bank.air[1], ~room.solid)
    assert room.solid.any()
    ppm, wind = frames(room.bank, 0, ~room.solid)
    assert len(ppm) == len(room.seen) == 11
    for n, (gas, u) in enumerate(room.seen):
        np.testing.assert_allclose(ppm[n], gas[:, 0], rtol=2e-3, atol=1e-6 * ppm.max())
        np.testing.assert_allclose(wind[n], u, atol=1e-3)
    assert np.abs(frames(room.bank, 1, ~room.solid)[1] - wind).max() > 0.02, "the other seed is another air"
    assert (room.bank.values[..., 2:][:, :, room.solid] == 0).all()


def test_films_are_played_as_they_were_recorded(room):
    played = {
        **ROOM,
        "wind": {"kind": "playback", "file": "elsewhere.zarr"},
        "gas": {"kind": "playback", "file": "elsewhere.zarr"},
        "warm_up": 0,
        "fields": None,
        "task": {**ROOM["task"], "films": ["fields.zarr"]},
    }
    bank = record(scenario_from(played), room.folder)
    assert bank.films == 1
    assert bank.sources[0][0].tolist() == [[0.4, 0.6]]
    for again, first in zip(frames(bank, 0, ~room.solid), frames(room.bank, 0, ~room.solid), strict=True):
        np.testing.assert_allclose(again, first, atol=2e-3 * np.abs(first).max())


def test_films_need_something_that_plays_them():
    with pytest.raises(ValueError, match=r"task\.films: neither wind nor gas is of kind playback"):
        record(scenario_from(task(task={**TASK["task"], "films": ["fields.zarr"]})))


def test_the_command_writes_a_bank(tmp_path, capsys):
    file, out = tmp_path / "task.yaml", tmp_path / "bank.zarr"
    file.write_text(yaml.safe_dump(TASK))
    assert main([str(file), "--out", str(out), "--set", "task.airs=1", "--set", "task.film=5"]) == 0
    assert "1 films of 26 frames, 0.2 s apart, of 20 x 12 cells" in capsys.readouterr().out
    assert read(out).films == 1
    out = tmp_path / "mine"
    out.mkdir()
    (out / "thesis.tex").write_text("all of it")
    assert main([str(file), "--out", str(out)]) == 2
    assert (out / "thesis.tex").exists()
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "reported"),
    [
        (["task.yaml", "--set", "task.airs=0"], "task.airs"),
        (["task.yaml", "--set", "task.airs=1000", "--set", "task.film=360000"], "lower task.airs"),
    ],
)
def test_the_command_tells_what_is_wrong_in_a_line(tmp_path, monkeypatch, capsys, arguments, reported):
    monkeypatch.chdir(tmp_path)
    Path("task.yaml").write_text(yaml.safe_dump(TASK))
    assert main(arguments) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert reported in lines[0]
