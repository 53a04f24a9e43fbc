import pytest

from taichi_plume.report import theme


@pytest.fixture
def drawn(monkeypatch) -> list:
    """Return the list of figures that would have become pictures."""
    made: list = []
    monkeypatch.setattr(theme, "png", lambda figure: made.append(figure) or b"")
    return made
