"""Law of every component: it goes on from a saved state."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from taichi_plume.grid.state import State

Play = Callable[[int, int], Sequence[np.ndarray]]
"""Goes on from one step to another, and tells what was seen."""


def assert_goes_on(part: Any, play: Play) -> None:
    """To the bit, from a state that was saved in between."""
    state = State(part)
    play(0, 4)
    saved = state.save()
    after = play(4, 8)
    state.restore(saved)
    for again, first in zip(play(4, 8), after, strict=True):
        np.testing.assert_array_equal(again, first)


def assert_plain(saved: Any, path: str = "saved") -> None:
    """A saved state is numbers, texts, arrays, lists and dicts alone: what files can hold without code."""
    if isinstance(saved, dict):
        for key, value in saved.items():
            assert isinstance(key, str), f"{path}[{key!r}]"
            assert_plain(value, f"{path}[{key}]")
    elif isinstance(saved, list):
        for n, value in enumerate(saved):
            assert_plain(value, f"{path}[{n}]")
    elif isinstance(saved, np.ndarray):
        assert saved.dtype != object, path
    else:
        assert saved is None or isinstance(saved, bool | int | float | str), f"{path}: {type(saved)}"
