"""Bodies of robots that drive on the floor, and of drones."""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field, model_validator

from taichi_plume.scenario import si
from taichi_plume.scenario.vocabulary import Model

GRAVITY = 9.81  # m/s²
# Footprints, speeds and wheel bases from the makers' sheets and from the papers that used the robots: MOMO in Ferri et
# al. 2009, the miniQ in Marjovi & Marques 2014 (its speed is our choice). Of the Crazyflie 2.1: take-off weight and
# size from Bitcraze's sheet (92 mm from motor to motor across, 29 mm high, propellers of 45 mm); speeds and the largest
# acceleration, that of a tilt of 20 degrees, are the limits of its firmware's position controller. Of the Matrice 100:
# mass with one battery, 650 mm across, propellers of 13 inches and vertical speeds from DJI's sheet; its speed along
# the ground, acceleration and height are our choice for rooms. The generic drone lies between the two.
BODIES: dict[str, dict[str, float]] = {
    "free": {},
    "momo": {"radius": 0.085, "height": 0.2, "max_speed": 0.2, "max_turn_rate_deg": 90.0},
    "roomba_560": {"radius": 0.17, "height": 0.09, "max_speed": 0.5, "wheel_base": 0.235},
    "miniq": {"radius": 0.05, "height": 0.1, "max_speed": 0.1, "wheel_base": 0.08},
    "khepera_3": {"radius": 0.065, "height": 0.07, "max_speed": 0.5, "wheel_base": 0.088},
}
DRONES: dict[str, dict[str, float]] = {
    "drone": {
        "radius": 0.2, "height": 0.1, "max_speed": 1.0, "max_climb": 1.0, "max_descent": 0.7, "max_acceleration": 3.0,
        "mass": 0.5, "rotors": 4, "rotor_radius": 0.075, "arm": 0.125,
    },
    "crazyflie": {
        "radius": 0.07, "height": 0.029, "max_speed": 1.0, "max_climb": 1.0, "max_descent": 1.0,
        "max_acceleration": 3.57, "mass": 0.027, "rotors": 4, "rotor_radius": 0.0225, "arm": 0.046,
    },
    "matrice_100": {
        "radius": 0.49, "height": 0.3, "max_speed": 2.0, "max_climb": 5.0, "max_descent": 4.0, "max_acceleration": 4.0,
        "mass": 2.355, "rotors": 4, "rotor_radius": 0.165, "arm": 0.325,
    },
}  # fmt: skip
WINGED = ("max_climb", "max_descent", "mass", "rotors", "rotor_radius", "arm")
"""Keys that only drones have."""


class Body(Model):
    """Body of a robot: a disc that drives (unicycle or two wheels) or a drone. Defaults: a small indoor robot."""

    kind: Literal["free", "momo", "roomba_560", "miniq", "khepera_3", "drone", "crazyflie", "matrice_100"] = (
        "free"
    )
    """A real robot, whose data are the defaults of the other keys; free: a small indoor robot. A drone, a crazyflie
    (2.1) and a matrice_100 fly, in 3-D runs: they move in any direction."""
    radius: si.BodyLength = 0.08
    """Radius of the disc that the robot is, for contact with walls, obstacles and others."""
    height: si.BodyLength = 0.15
    """Height of the body: it passes under higher obstacles. With `wake`, the height that disturbs the air."""
    max_speed: si.TopSpeed = 0.2
    """Largest speed; with a `wheel_base`, of each wheel."""
    max_turn_rate_deg: si.TurnRate = 180.0
    """Largest angle per second by which it turns."""
    wheel_base: si.BodyLength | None = None
    """Distance between its two wheels, each of at most max_speed: the robot is slower in a bend. Unless given, it turns
    at any speed."""
    max_acceleration: si.Thrust | None = None
    """Largest change of speed per time; unless given, it changes at once. Of a drone, in any direction."""
    max_climb: si.TopSpeed | None = None
    """Largest speed upward, of a drone."""
    max_descent: si.TopSpeed | None = None
    """Largest speed downward, of a drone."""
    mass: si.BodyMass | None = None
    """Mass at take-off, of a drone: with `wake` its rotors push the air down by its weight."""
    rotors: Annotated[int, Field(ge=1, le=16)] | None = None
    """Number of its rotors, of a drone; the first one is ahead on the left."""
    rotor_radius: si.BodyLength | None = None
    """Radius of each rotor, of a drone."""
    arm: si.Distance | None = None
    """Distance of the rotors from its middle, of a drone."""

    @model_validator(mode="before")
    @classmethod
    def _data_of_kind(cls, data: object) -> object:
        if isinstance(data, dict) and isinstance(data.get("kind"), str):
            return {**(BODIES | DRONES).get(data["kind"], {}), **data}
        return data

    @property
    def flies(self) -> bool:
        """Whether the body is a drone."""
        return self.kind in DRONES

    def dimension_errors(self, where: str, dim: int) -> Iterator[str]:
        yield from super().dimension_errors(where, dim)
        if not self.flies:
            for key in [key for key in WINGED if vars(self)[key] is not None][:1]:
                yield f"{where}.{key}: is for drones; give body.kind: drone, or remove it"
            return
        if dim == 2:
            yield f"{where}.kind: a {self.kind} needs a 3-D run; give domain.size three numbers"
        if self.wheel_base is not None:
            yield f"{where}.wheel_base: a {self.kind} has no wheels; remove it"
        missing = [key for key in (*WINGED, "max_acceleration") if vars(self)[key] is None]
        for key in missing:
            yield f"{where}.{key}: a {self.kind} needs a number; remove the key or give one"
        reach = (self.arm or 0.0) + (self.rotor_radius or 0.0)
        if not missing and reach > self.radius + 1e-3:
            yield f"{where}.radius: {self.radius:g} m is less than arm + rotor_radius = {reach:g} m; make it larger"
