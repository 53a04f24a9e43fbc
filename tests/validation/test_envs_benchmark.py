import json

import pytest

from taichi_plume.validation.benchmark import envs
from taichi_plume.validation.benchmark.__main__ import main


def test_no_environments_are_refused_in_a_line(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["envs", "--count", "0"])
    assert ended.value.code == 2
    assert "--count: 0 is below 1" in capsys.readouterr().err


@pytest.mark.slow
def test_environments_are_measured_beside_what_is_wanted(monkeypatch, capsys):
    monkeypatch.setattr(envs, "RESETS", 200)
    monkeypatch.setattr(envs, "FRAMES", 141)
    assert main(["envs", "--count", "20", "--seconds", "0.1", "--json"]) == 0
    rows = {row["case"]: row for row in json.loads(capsys.readouterr().out)}
    assert list(rows) == [
        "steps of 20 environments",
        "reset of one of them",
        "reset of all",
        "steps of a single environment",
        "memory over 200 resets",
    ]
    for case in ("steps of 20 environments", "steps of a single environment"):
        assert rows[case]["figure"] > 0.0 < rows[case]["cpu_us"]
        assert rows[case]["wanted"].startswith(">= ")
