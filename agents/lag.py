"""A first-order lag."""

from math import expm1


class Lag:
    """A first-order lag that is solved exactly over ticks of dt [s] in which its goal stands still.

    share: of the way to the goal that is covered in a tick; rest: mean of the rest of the way over the tick, over the
    whole of it.
    """

    def __init__(self, time_constant: float, dt: float):
        self.share = -expm1(-dt / time_constant) if time_constant > 0 else 1.0
        self.rest = self.share * time_constant / dt
