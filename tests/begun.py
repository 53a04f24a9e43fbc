"""What holds for every component: it can begin anew with other numbers, and go on from a saved state."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from taichi_plume.grid.kernels import compiled
from taichi_plume.grid.state import State

Play = Callable[[int, int], Sequence[np.ndarray]]
"""Goes on from one step to another, and tells what was seen."""


def assert_begins_anew(
    part: Any, begin: Callable[[Any], None], numbers: Any, others: Any, play: Play
) -> None:
    """With `numbers`, those that `part` has just been made with, and with others; to the bit, without a new kernel.

    Also goes on from a state that was saved in between.
    """
    state = State(part)
    new = play(0, 4)
    state.clear()
    before = compiled()
    begin(others)
    different = play(0, 4)
    assert not all(np.array_equal(a, b, equal_nan=True) for a, b in zip(new, different, strict=True))
    state.clear()
    begin(numbers)
    for again, first in zip(play(0, 4), new, strict=True):
        np.testing.assert_array_equal(again, first)
    assert compiled() == before
    saved = state.save()
    after = play(4, 8)
    state.restore(saved)
    for again, first in zip(play(4, 8), after, strict=True):
        np.testing.assert_array_equal(again, first)
