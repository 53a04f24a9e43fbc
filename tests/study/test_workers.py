"""Processes of a study on this machine."""

import os

from taichi_plume.studies.workers import ENVIRONMENT, LocalWorkers


def test_workers_alone_get_the_environment_of_workers(tmp_path, monkeypatch):
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    before = dict(os.environ)
    workers = LocalWorkers(1, tmp_path / "workers.log")
    try:
        found = workers.submit("0", os.getenv, "PYTHONSAFEPATH").result(timeout=60)  # type: ignore[arg-type]
    finally:
        workers.close()
    assert found == ENVIRONMENT["PYTHONSAFEPATH"]
    assert dict(os.environ) == before
