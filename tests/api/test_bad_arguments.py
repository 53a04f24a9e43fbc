"""Every public function with values of wrong types, names that no file can have, nan and huge numbers: one error."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from decimal import Decimal
from typing import Any

import numpy as np
import pytest
from test_changes import DATA

import taichi_plume as tp
from taichi_plume.engine.process import TurnError

HUGE = 10**5000
SEVEN: Any = np.int64(7)  # numpy's numbers pass, although the signatures name Python's types
HALF: Any = np.float32(0.5)
PATHS = [5, b"x", [], object(), "a\0b", "\ud800", "x" * 5000]
NUMBERS = [-1, float("nan"), float("inf"), "nan", "two", b"3", [1], {}, HUGE, object(), "1\0"]
NO_TICKS: list[Any] = [1.5, True, None, Decimal(1)]
NO_CHANGES: list[Any] = [5, "a", [1], b"a"]


def refused(call: Callable[[], object], *words: str) -> None:
    with pytest.raises(tp.InputError) as error:
        call()
    assert len(error.value.lines) == 1
    assert all(word in error.value.lines[0] for word in words), error.value.lines


def named(value: object) -> str:
    return f"{type(value).__name__}-{len(str(value)) if value is not HUGE else 'huge'}"


@pytest.mark.parametrize("path", PATHS, ids=named)
def test_paths(tmp_path, monkeypatch, path):
    monkeypatch.chdir(tmp_path)
    refused(lambda: tp.simulate(DATA, out=path, progress=False), "out")
    refused(lambda: tp.study({"name": "a", "base": DATA, "axes": {}, "airs": 1}, out=path, progress=False))
    refused(lambda: tp.contest(["random_walk"], out=path, progress=False), "out")
    refused(lambda: tp.load_scenario(DATA, folder=path) if path != [] else tp.load_scenario(path))
    refused(lambda: tp.load_scenario(path))
    refused(lambda: tp.Scenario.from_dict(DATA).to_yaml(path), "path")
    for reader in (tp.open_run, tp.open_study):
        with pytest.raises(tp.RunFolderError, match="folder"):
            reader(path)
    refused(lambda: tp.cite(path))
    refused(lambda: tp.study(path))
    refused(lambda: tp.statistics(path))
    refused(lambda: tp.maps(path, size=(1, 1)))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("overrides", [None, [], {}])
@pytest.mark.parametrize("number", NUMBERS, ids=named)
def test_durations_and_seeds(tmp_path, number, overrides):
    for name in ("duration", "seed"):
        if (name, number) != ("seed", b"3"):  # pydantic reads digits
            refused(
                lambda name=name: tp.simulate(
                    DATA, overrides=overrides, out=tmp_path / "a", **{name: number}
                ),
                name,
            )
    refused(lambda: tp.Simulation(DATA, overrides=overrides, duration=number), "duration")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "overrides",
    [
        [5],
        [b"seed=3"],
        b"seed=3",
        [("seed", 3)],
        [None],
        [["seed=3"]],
        "seed=3",
        5,
        iter([]),
        {"seed": HUGE},
        [HUGE],
    ],
)
def test_overrides(overrides):
    refused(
        lambda: tp.load_scenario(DATA, overrides), "seed" if isinstance(overrides, dict) else "overrides: got"
    )
    refused(lambda: tp.simulate(DATA, overrides=overrides, duration=1))


def test_values_beside_overrides_keep_their_type():
    scenario = tp.load_scenario(DATA, ["duration=1", "robots.0.count=1", "duration=2"])
    assert scenario.duration == 2.0
    sim = tp.Simulation(DATA, overrides=["seed=1"], seed=SEVEN, duration="1 s")
    assert (sim.scenario.seed, sim.scenario.duration) == (7, 1.0)


@pytest.mark.usefixtures("taichi")
def test_a_simulation(tmp_path):
    sim = tp.Simulation(DATA)
    sim.step(3)
    for number in NUMBERS:
        refused(lambda number=number: sim.step(number), "ticks") if number is not HUGE else None
        refused(lambda number=number: sim.run(until=number), "until")
        refused(lambda number=number: sim.every(number, print), "every")
        refused(lambda number=number: sim.write(tmp_path / "a.zarr", every=number), "every")
    for number in NO_TICKS:
        refused(lambda number=number: sim.step(number), "ticks")
    refused(lambda: sim.run(until=0.1), "until", "0.1 s", "0.3 s")
    for path in PATHS:
        refused(lambda path=path: sim.write(path), "path")
    for changes in NO_CHANGES:
        refused(lambda changes=changes: sim.change(changes))
        refused(lambda changes=changes: sim.reset(overrides=changes))
    assert sim.t == pytest.approx(0.3)
    sim.run(until=HALF)
    sim.run(until="0.5 s")
    sim.step(SEVEN)
    assert sim.t == pytest.approx(1.2)
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("taichi")
@pytest.mark.parametrize("use", [tp.Simulation.run, tp.Simulation.step, tp.Simulation.reset])
def test_a_function_of_every_cannot_advance_its_simulation(use):
    """But it may change the simulation and step another one."""
    sim, other = tp.Simulation(DATA), tp.Simulation(DATA)
    sim.every(1.0, use)
    refused(sim.run, "every")
    assert sim.t == 0.0
    sim = tp.Simulation(DATA)
    sim.every(1.0, lambda now: (other.step(), now.change({"wind.velocity": [0.1 * (1 + now.t), 0.0]})))
    sim.run()
    assert (sim.t, other.t) == (3.0, pytest.approx(0.4))
    assert sim.scenario.wind.velocity[0] == pytest.approx(0.4)


@pytest.mark.usefixtures("taichi")
def test_one_thread_at_a_time_steps():
    """The other one gets an error of ours, and may step later."""
    first, second = tp.Simulation(DATA), tp.Simulation(DATA)
    uses: list[Callable[[], object]] = [
        second.step,
        second.run,
        second.reset,
        lambda: second.robots,
        lambda: second.wind,
    ]
    caught: list[BaseException | None] = []
    with ThreadPoolExecutor(1) as threads:

        def beside(_: object) -> None:
            caught.extend(threads.submit(use).exception() for use in uses)

        first.every(10.0, beside)
        first.run()  # calls at the start and at the end
        assert len(caught) == 10
        for error in caught:
            assert isinstance(error, TurnError)
            assert "thread" in str(error)
        assert second.t == 0.0
        threads.submit(second.run).result()
    assert (first.t, second.t) == (3.0, 3.0)
    assert first.robots.equals(second.robots)
