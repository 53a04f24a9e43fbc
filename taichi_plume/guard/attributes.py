"""Objects that refuse to set unknown attributes, so that a misspelt attribute name raises an error."""

import difflib


class KnownAttributes:
    """Base class that can limit which attributes user code may set; setting another raises AttributeError."""

    _writable: tuple[str, ...] | None = None

    def _seal(self, *names: str) -> None:
        """From now on allow to set only private attributes and the attributes in `names`."""
        self._writable = names

    def _open(self) -> None:
        """Allow to set any attribute again."""
        self._writable = None

    def __setattr__(self, name: str, value: object) -> None:
        if self._writable is not None and name not in self._writable and not name.startswith("_"):
            raise AttributeError(self._refusal(name, self._writable))
        super().__setattr__(name, value)

    def _refusal(self, name: str, writable: tuple[str, ...]) -> str:
        owner = type(self).__name__
        what = (
            f"{owner}.{name} can only be read" if name in vars(self) else f"{owner} has no attribute '{name}'"
        )
        close = difflib.get_close_matches(name, writable, n=1)
        meant = f"did you mean '{close[0]}'? " if close else ""
        allowed = f"attributes to set: {', '.join(writable)}" if writable else "no attribute of it can be set"
        return f"{what}; {meant}{allowed}"
