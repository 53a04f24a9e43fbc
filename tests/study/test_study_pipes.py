"""A pipe in place of a file of a study's folder is refused by every reader; none waits for a writer."""

import os
import shutil
from pathlib import Path

import made_study
import pytest

from taichi_plume import open_study
from taichi_plume.cli import study
from taichi_plume.files import own_folder
from taichi_plume.guard.input_error import InputError
from taichi_plume.studies.messages import AirRecord
from taichi_plume.studies.store import AIRS, KIND, Store
from tests.pipes_in_folders import ended

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes in folders")
FILES = (
    "study.json",
    "plan.parquet",
    "runs.parquet",
    "costs.parquet",
    "parts/000000.parquet",
    "trials",
    "airs/a.json",
)


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    """The folder of a study with a file of each kind."""
    folder = tmp_path_factory.mktemp("study")
    plan = made_study.plan()
    made_study.add(folder, made_study.records(plan))
    made_study.published(folder, plan, made_study.records(plan))
    own_folder.mark(folder, KIND)
    (folder / AIRS).mkdir()
    Store(folder).add_air(AirRecord("a", 1.0, 10, 100))
    return folder


@pytest.mark.parametrize("name", FILES)
def test_no_reader_waits_for_a_pipe(finished, tmp_path, capsys, name):
    folder = shutil.copytree(finished, tmp_path / "study")
    file = folder / name
    shutil.rmtree(file) if file.is_dir() else file.unlink()
    os.mkfifo(file)
    readers = {
        "trials": lambda: open_study(folder).trials(),
        "points": lambda: open_study(folder).points(),
        "repr": lambda: repr(open_study(folder)),
        "records": lambda: Store(folder).records(),
        "airs": lambda: Store(folder).air_records(),
        "report": lambda: study.main(["report", str(folder)]),
    }
    for reader, call in readers.items():
        ends, outcome = ended(call, file)
        capsys.readouterr()
        assert ends, f"{reader} waits for {name}"
        if isinstance(outcome, Exception):
            assert isinstance(outcome, InputError | OSError | ValueError), (reader, outcome)
            assert "\n" not in str(outcome)
