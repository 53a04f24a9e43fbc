"""What tests of the validation share."""

import pytest


@pytest.fixture
def idle(monkeypatch):
    """Taichi does not start: the cases are made-up ones, which launch nothing."""
    monkeypatch.setattr("taichi_plume.engine.program.start", lambda arch: arch)
