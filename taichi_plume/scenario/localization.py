"""Localisation of robots: odometry by their wheels, or poses from a camera."""

from math import ceil, pi, radians
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from taichi_plume.quantities import number
from taichi_plume.scenario import si
from taichi_plume.scenario.vocabulary import SHAPE, Model

Slight = Annotated[float, *number(0, 0.2)]


class Odometry(Model):
    """Errors of robots that know their pose from their wheels alone; at the start they know it exactly.

    The first three are constant for each robot, normally distributed over the robots; the others are random, and their
    variance grows with the distance driven and the angle turned. Defaults: a small indoor robot, not calibrated.
    """

    age: ClassVar[float] = 0.0
    """Largest age of a believed pose [s]."""
    heading_scatter: ClassVar[float] = 0.0
    """Standard deviation of the believed heading of a robot that stands still [rad], from sample to sample."""
    kind: Literal["odometry"]
    distance_scale: Slight = 0.01
    """Relative error of distances, from the size of the wheels. Standard deviation over the robots, constant for
    each."""
    turn_scale: Slight = 0.01
    """Relative error of angles turned, from the distance between the wheels. Standard deviation over the robots,
    constant for each."""
    veer_deg: si.AngleNoise = 0.5
    """Unnoticed turn per metre, from wheels of unequal size. Standard deviation over the robots, constant for each."""
    distance_noise: si.Distance = 0.01
    """Standard deviation of the distance after a metre driven; it grows with the root of the distance."""
    turning_distance_noise: si.Distance = 0.005
    """Standard deviation of the distance after a full turn on the spot."""
    heading_noise_deg: si.AngleNoise = 1.0
    """Standard deviation of the heading after a metre driven; it grows with the root of the distance."""
    turn_noise_deg: si.AngleNoise = 2.0
    """Standard deviation of the heading after a full turn."""

    @property
    def deviations(self) -> tuple[float, float, float]:
        """Standard deviations of the constant errors a, b [1] and c [rad/m] of `agents/odometry.py` over the robots."""
        return self.distance_scale, self.turn_scale, radians(self.veer_deg)

    @property
    def variances(self) -> tuple[float, float, float, float]:
        """Coefficients k1 [rad], k2 [rad²/m], k3 [m] and k4 [m²/rad] of the random errors of `agents/odometry.py`."""
        return (
            radians(self.turn_noise_deg) ** 2 / (2.0 * pi),
            radians(self.heading_noise_deg) ** 2,
            self.distance_noise**2,
            self.turning_distance_noise**2 / (2.0 * pi),
        )


class Camera(Model):
    """Poses from a camera over the floor, or from motion capture: frame by frame, late and with errors.

    Between two frames the last pose holds. The distance driven is exact, as from wheels that are calibrated. Defaults:
    a ceiling camera over a small arena.
    """

    kind: Literal["camera"]
    position_noise: si.Distance = 0.005
    """Standard deviation of x and of y in a frame."""
    heading_noise_deg: si.AngleNoise = 2.0
    """Standard deviation of the heading in a frame."""
    rate: Annotated[si.FrameRate, SHAPE] = 10.0
    """Number of frames per second."""
    delay: Annotated[si.Latency, SHAPE] = 0.1
    """Time from the exposure of a frame until the robots have its poses."""

    @property
    def age(self) -> float:
        """Largest age of a believed pose [s]: that of the last frame when the next one arrives."""
        return self.delay + 1.0 / self.rate

    @property
    def heading_scatter(self) -> float:
        """Standard deviation of the believed heading of a robot that stands still [rad], from frame to frame."""
        return radians(self.heading_noise_deg)

    @property
    def frames(self) -> int:
        """Number of frames to keep: those on their way to the robots, and the last one that arrived."""
        return ceil(self.delay * self.rate) + 2


Localization = Annotated[Odometry | Camera, Field(discriminator="kind")]
