"""Undo and redo: all texts of a session, in order."""

MOST_CHARACTERS = 50_000_000  # of all texts together: the oldest are forgotten beyond


class History:
    """Texts that an edited text has had. `undo` and `redo` return to each of them, byte for byte.

    >>> history = History("a")
    >>> history.put("b")
    >>> history.undo(), history.redo()
    ('a', 'b')
    """

    def __init__(self, text: str):
        self._texts, self._at = [text], 0

    @property
    def text(self) -> str:
        """The present text."""
        return self._texts[self._at]

    @property
    def can_undo(self) -> bool:
        """Whether there is an earlier text."""
        return self._at > 0

    @property
    def can_redo(self) -> bool:
        """Whether an undone text can be returned to."""
        return self._at < len(self._texts) - 1

    def put(self, text: str) -> None:
        """Make a text the present one; undone texts are forgotten, and an equal text is not put twice."""
        if text == self.text:
            return
        del self._texts[self._at + 1 :]
        self._texts.append(text)
        while len(self._texts) > 2 and sum(map(len, self._texts)) > MOST_CHARACTERS:
            del self._texts[0]
        self._at = len(self._texts) - 1

    def undo(self) -> str:
        """Return to the previous text, if there is one; return the present text."""
        self._at = max(0, self._at - 1)
        return self.text

    def redo(self) -> str:
        """Return to the text that was undone last, if there is one; return the present text."""
        self._at = min(len(self._texts) - 1, self._at + 1)
        return self.text
