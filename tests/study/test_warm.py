"""Simulations that stay warm: what is kept, and when Taichi starts anew."""

from pathlib import Path

import pytest
from study_rooms import UNIFORM, changed

from taichi_plume.assembly.preparation import Prepared, checked
from taichi_plume.engine import program
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.studies import simulation_cache
from taichi_plume.studies.simulation_cache import Warm

pytestmark = pytest.mark.slow


@pytest.fixture
def prepared() -> Prepared:
    return checked(Scenario.model_validate(changed(UNIFORM)), Path())


def test_what_was_assembled_is_found_until_others_were_used_more_lately(prepared):
    its = Warm(most=2)
    assert its.find("a") is None
    a, b = its.add("a", prepared), its.add("b", prepared)
    assert its.find("a") is a
    its.add("c", prepared)
    assert its.find("b") is None
    assert its.find("a") is a
    assert b.sim is not a.sim
    its.drop("a")
    assert its.find("a") is None
    assert its.begun == 1


def test_taichi_starts_anew_before_it_has_no_place_left(prepared, monkeypatch):
    monkeypatch.setattr(simulation_cache, "PLACES", 100)
    its = Warm(most=100)
    seen = []
    for n in range(12):
        its.add(n, prepared).sim.run()
        seen.append(simulation_cache._trees())
    assert its.begun > 1
    assert max(seen) < simulation_cache.PLACES
    assert its.find(11) is not None
    assert its.find(0) is None, "it has fields in a Taichi that is gone"


def test_a_taichi_that_others_have_started_holds_nothing_of_ours(prepared):
    its = Warm()
    its.add("a", prepared)
    before = its.compiled
    assert before > 0
    program.start()
    assert its.find("a") is None
    its.add("a", prepared).sim.run()
    assert its.begun == 2


def test_one_thread_gives_what_many_give(prepared):
    def path() -> list[float]:
        sim = Warm().add("a", prepared).sim
        sim.run()
        return sim.swarm.snapshot()["path_length"].tolist()

    from taichi_plume.assembly.assemble import build

    one = path()
    program.start(threads=2)
    sim = build(prepared)
    sim.run()
    assert sim.swarm.snapshot()["path_length"].tolist() == one
