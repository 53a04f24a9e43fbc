"""What holds for every component: it can begin anew with other numbers, and go on from a saved state."""

from collections.abc import Callable, Hashable, Sequence
from typing import Any

import numpy as np

from taichi_plume.engine.program import compiled
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


class Kept:
    """Components that the tests of a module share, so that each is compiled once."""

    def __init__(self) -> None:
        self._parts: dict[Hashable, Any] = {}
        self._states: dict[int, State] = {}

    def __call__(self, key: Hashable, make: Callable[[], Any], begin: Callable[[Any], object]) -> Any:
        """The component of this key, as new: made by `make`, or one that begins anew by `begin`."""
        if key in self._parts:
            self.renew(self._parts[key], begin)
        else:
            self._parts[key] = make()
        return self._parts[key]

    def renew(self, part: Any, begin: Callable[[Any], object]) -> None:
        """Let a component begin anew."""
        if id(part) not in self._states:
            self._states[id(part)] = State(part)
        self._states[id(part)].clear()
        begin(part)


def assert_plain(saved: Any, path: str = "saved") -> None:
    """What was saved is numbers, texts, arrays, lists and dicts alone: what files can hold without code."""
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
