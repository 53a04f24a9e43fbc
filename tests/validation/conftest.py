"""What tests of the validation share."""

import pytest


@pytest.fixture
def idle(monkeypatch):
    """Taichi does not start: the cases are made-up ones, which launch nothing."""
    monkeypatch.setattr("taichi_plume.grid.kernels.start", lambda arch: arch)
