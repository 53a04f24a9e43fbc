"""Scenarios that share what their files hold are checked as each would be alone."""

from pathlib import Path

import pytest

from taichi_plume.assembly.preparation import checked, load_scenario
from taichi_plume.engine.choice import ENGINES
from taichi_plume.scenario.checks import every
from taichi_plume.scenario.loading import ScenarioError, read_scenario
from taichi_plume.scenario.vocabulary import Model
from taichi_plume.studies.ids import Digests
from taichi_plume.studies.scenario_checks import Checks
from tests.fuzz import formats

CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.yaml")), ids=lambda path: path.stem)
def test_again_and_after_others_it_says_the_same(path):
    checks, digests = Checks(path.parent, True), Digests(path.parent)
    scenario = read_scenario(path)
    alone = checked(scenario, path.parent, True).scenario
    assert checks.checked(scenario).scenario == alone
    early = read_scenario(path, ["duration=0.5"])
    other = read_scenario(path, ["gas={kind: eulerian, sources: [{position: [-1, -1], rate: 1}]}"])
    for one in (scenario, other, early, scenario):
        reported = []
        for check in (checks.checked, lambda one: checked(one, path.parent, True)):
            try:
                reported.append(check(one).scenario)
            except ScenarioError as error:
                reported.append(error.faults)
        assert reported[0] == reported[1]
    assert digests.ids(alone, {}) == Digests(path.parent).ids(alone, {})


def models(part: object) -> list[Model]:
    """All sections in a value, whatever the annotations of its keys say."""
    if isinstance(part, Model):
        return [part, *models(list(vars(part).values()))]
    parts = part.values() if isinstance(part, dict) else part if isinstance(part, list | tuple) else ()
    return [model for value in parts for model in models(value)]


@pytest.mark.parametrize("path", sorted(CONFIGS.rglob("*.yaml")), ids=lambda path: path.stem)
def test_the_checks_see_every_section(path):
    if path.parent.name == "studies":
        pytest.skip("a study")
    scenario = load_scenario(path, (), True)
    found = [section for _, section in every(scenario)]
    assert sorted(map(id, found)) == sorted(map(id, models(scenario)))


def test_runs_with_another_engine_have_other_ids(monkeypatch):
    """A study that is resumed with another engine does not mix the results of both."""
    path = CONFIGS / "casting_room.yaml"
    ids = Digests(path.parent).ids(load_scenario(path), {})
    made = []
    for name in ENGINES:
        monkeypatch.setattr("taichi_plume.studies.ids.chosen", lambda name=name: name)
        made += [ids.run(1, 1), ids.air_of(1, 1)]
    assert len(set(made)) == 2 * len(ENGINES)


def test_ids_of_a_film_are_of_what_it_holds(tmp_path):
    formats.make(tmp_path)
    file = tmp_path / "a.yaml"
    file.write_text(
        "duration: 1\ndomain: {size: [0.6, 0.5, 0.4], spacing: 0.1}\nwind: {kind: playback, file: fields.zarr}\n"
        "gas: {kind: playback, file: fields.zarr}\n"
    )
    one = Checks(tmp_path, False).checked(read_scenario(file)).scenario
    ids = Digests(tmp_path).ids(one, {})
    assert not ids.air_by_chance
    (tmp_path / "fields.zarr").rename(tmp_path / "film.zarr")
    file.write_text(file.read_text().replace("fields.zarr", "film.zarr"))
    moved = Checks(tmp_path, False).checked(read_scenario(file)).scenario
    assert Digests(tmp_path).ids(moved, {})[:2] == ids[:2]
    meta = tmp_path / "film.zarr" / "zarr.json"
    meta.write_text(meta.read_text().replace("1", "2", 1))
    assert Digests(tmp_path).ids(moved, {}).air != ids.air
