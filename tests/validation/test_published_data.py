import json

import pytest

from taichi_plume.validation.__main__ import main
from taichi_plume.validation.cases import CASES
from taichi_plume.validation.published_data import VARIABLE, MissingDataError, data_file


def test_a_file_of_the_folder_is_found(tmp_path, monkeypatch):
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "a.csv").touch()
    assert data_file("set/a.csv", "10.1/2") == tmp_path / "set" / "a.csv"


@pytest.mark.parametrize("folder", [None, "empty"])
def test_a_missing_file_is_named_with_its_source(folder, tmp_path, monkeypatch):
    if folder:
        monkeypatch.setenv(VARIABLE, str(tmp_path))
    else:
        monkeypatch.delenv(VARIABLE, raising=False)
    with pytest.raises(MissingDataError) as error:
        data_file("set/a.csv", "10.1/2")
    assert all(part in str(error.value) for part in ("set/a.csv", "10.1/2", VARIABLE))


def test_a_case_without_its_data_is_skipped_and_judged_by_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr("taichi_plume.validation.cases.CASES", {"red_vapor": CASES["red_vapor"]})
    assert main(["--out", str(tmp_path)]) == 0
    assert "skipped: red_vapor" in capsys.readouterr().out
    (case,) = json.loads((tmp_path / "report.json").read_text())["cases"]
    assert case["skipped"]
    assert VARIABLE in case["message"]
    assert "skipped" in (tmp_path / "report.html").read_text()
