"""What holds or drags the air inside the domain."""

from typing import Any, Protocol


class Resistance(Protocol):
    """Screens, moving obstacles, robots; implementations are `ti.data_oriented`."""

    cells: int
    """About how many faces `apply` looks at."""

    def advance(self, t: float, dt: float) -> None:
        """Prepare the step from time t [s] to t + dt."""
        ...

    def fastest(self, t: float) -> float:
        """Largest velocity component [m/s] that it gives the air soon after t [s]."""
        ...

    def apply(self, u: Any, dt: Any) -> None:
        """ti.func: u = (u + dt r v)/(1 + dt r) on its faces, r its rate [1/s] and v its own velocity [m/s]."""
        ...
