"""Objects that refuse attributes which nobody reads: a misspelt name would be lost in silence."""

import difflib
from collections.abc import Sequence
from typing import Any


class KnownAttributes:
    """An object that user code may write to. After `_seal` only private attributes and those named there can be
    set.
    """

    _writable: tuple[str, ...] | None = None

    def _seal(self, *names: str) -> None:
        """Refuse from now on to set other attributes than these."""
        self._writable = names

    def _open(self) -> None:
        """Allow setting any attribute."""
        self._writable = None

    def __setattr__(self, name: str, value: Any) -> None:
        if self._writable is not None and name not in self._writable and not name.startswith("_"):
            raise AttributeError(_refusal(type(self).__name__, name, name in vars(self), self._writable))
        super().__setattr__(name, value)


def _refusal(owner: str, name: str, exists: bool, writable: Sequence[str]) -> str:
    """Message for an attribute that cannot be set."""
    what = f"{owner}.{name} can only be read" if exists else f"{owner} has no attribute '{name}'"
    close = difflib.get_close_matches(name, writable, n=1)
    meant = f"did you mean '{close[0]}'? " if close else ""
    allowed = f"attributes to set: {', '.join(writable)}" if writable else "no attribute of it can be set"
    return f"{what}; {meant}{allowed}"
