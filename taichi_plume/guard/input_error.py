"""Base class of the errors that a user's input causes."""

from taichi_plume.guard.terminal import visible


class InputError(ValueError):
    """Base class of errors in the user's files, values or options.

    `lines`: one line for each fault, escaped and cut as by `visible`. A command prints them and exits with 2.

    >>> import taichi_plume as tp
    >>> try:
    ...     tp.simulate("casting_room", duration="2 kg")
    ... except tp.InputError as error:
    ...     print(error.lines[0].split(": ", 1)[1])
    duration: got '2 kg': must have a unit that converts to s; units that fit: us, ms, s, min, h
    """

    def __init__(self, *lines: object):
        self.lines = [visible(line) for line in lines]
        super().__init__("\n".join(self.lines))
