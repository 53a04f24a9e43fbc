"""What a study still has to do, when it goes on and asks for more than before."""

from pathlib import Path
from types import SimpleNamespace

import made_study
import pytest
from study_rooms import ROOM

from taichi_plume.studies.store import Store
from taichi_plume.studies.study_run import missing_runs


@pytest.fixture
def store(tmp_path) -> Store:
    """Of a study whose runs are done but for the last two, of which one has failed."""
    plan = made_study.plan()
    store = Store(tmp_path)
    store.parts.mkdir()
    records = made_study.records(plan)[:-1]
    store.add([*records[:-1], records[-1]._replace(status="failed")])
    return store


def wanted(
    store: Store, outcomes: dict[str, str], keep: tuple[str, ...] = (), retry: bool = False
) -> list[int]:
    """From the end, the runs that are to be done."""
    plan = made_study.plan()
    plan.study, plan.base = SimpleNamespace(outcomes=outcomes, keep=keep), ROOM
    return [one.number - len(plan.requests) for one in missing_runs(plan, store, retry)]  # type: ignore[arg-type]


def test_what_is_done_is_not_done_again(store):
    assert wanted(store, {}) == [-1]
    assert wanted(store, {}, retry=True) == [-2, -1]
    assert wanted(store, {"another_name": made_study.PATHS["error"]}) == [-1]


def test_runs_that_lack_what_is_asked_for_now_are_done_again(store):
    every = list(range(-len(made_study.plan().requests), 0))
    every.remove(-2)  # it failed
    assert wanted(store, {"correlation": "maps.1.correlation"}) == every
    assert wanted(store, {}, ("robots.parquet",)) == every
    for one in made_study.plan().requests[:3]:
        folder: Path = store.folder / "kept" / one.run
        folder.mkdir(parents=True)
        (folder / "robots.parquet").touch()
    assert wanted(store, {}, ("robots.parquet",)) == every[3:]


def test_files_that_a_run_does_not_leave_are_not_missed(store):
    assert wanted(store, {}, ("plume.pslog",)) == [-1]
