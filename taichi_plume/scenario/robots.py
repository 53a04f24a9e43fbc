"""The robots of a scenario: groups of them."""

from collections.abc import Iterator
from math import pi
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from taichi_plume.scenario.algorithms import Algorithm
from taichi_plume.scenario.bodies import Body
from taichi_plume.scenario.domain import Arena, Context
from taichi_plume.scenario.quantities import number
from taichi_plume.scenario.sensors import Sensors
from taichi_plume.scenario.starts import Start
from taichi_plume.scenario.vocabulary import (
    COMPILED,
    AngleNoise,
    Count,
    Delay,
    Distance,
    Fraction,
    Length,
    Model,
)


class Communication(Model):
    """Messages between the robots of a team, for algorithms that use them."""

    range: Length | None = None
    """How far a message reaches; unless given, everywhere."""
    loss: Fraction = 0.0
    """Probability that a robot misses a message."""


Slight = number(0, 0.2)


class Odometry(Model):
    """Errors of robots that know their pose from their wheels alone; at the start they know it exactly.

    It is the group's and not the body's: the same robot is followed by cameras in one arena and by none in another. The
    first three are a robot's own for the whole run, normally distributed over the robots; the others are random, and
    their variance grows with the distance driven and the angle turned. Defaults: a small indoor robot, not calibrated.
    """

    distance_scale: Slight = 0.01
    """Relative error of distances, from the size of the wheels. Standard deviation over the robots, each keeps its
    own for the whole run."""
    turn_scale: Slight = 0.01
    """Relative error of angles turned, from the distance between the wheels. Standard deviation over the robots, each
    keeps its own for the whole run."""
    veer_deg: AngleNoise = 0.5
    """Angle per metre that it turns without knowing, from wheels of unequal size. Standard deviation over the robots,
    each keeps its own for the whole run."""
    distance_noise: Distance = 0.01
    """Standard deviation of the distance after a metre driven; it grows with the root of the way."""
    turning_distance_noise: Distance = 0.005
    """Standard deviation of the distance after a full turn on the spot."""
    heading_noise_deg: AngleNoise = 1.0
    """Standard deviation of the heading after a metre driven; it grows with the root of the way."""
    turn_noise_deg: AngleNoise = 2.0
    """Standard deviation of the heading after a full turn."""


class Group(Model):
    """Robots of one kind. `trials` independent copies of the team run at once in the same air."""

    name: str = "robots"
    """What the group is called in tables and recordings; two groups need two names."""
    count: Count
    """Robots of the team."""
    trials: Count = 1
    """Independent copies of the team that search at once in the same air. They neither see nor meet each other: more
    give better statistics in one run."""
    first_trial: Annotated[int, Field(ge=0, le=1_000_000)] = 0
    """Number of the first trial. With `trials: 1`, one of many is run again alone, to the same result."""
    begin: Annotated[Delay, COMPILED] = 0.0
    """When its robots set off. Until then they stand at their start, and their sensors follow the gas there, which maps
    take in as any reading. How long a search took counts from then on."""
    start: Start
    """Where the robots start: at given places, on a line or at random in an area."""
    algorithm: Algorithm
    """How the robots search: what they do with what they smell and feel."""
    body: Body = Body()
    """Size and speed of each robot."""
    sensors: Sensors = Sensors()
    """Gas sensor and anemometer that each robot carries."""
    communication: Communication = Communication()
    """How far messages between the robots reach, for algorithms that use them."""
    odometry: Odometry | None = None
    """Errors of the pose that a robot believes in. Unless given, robots know exactly where they are, as if cameras
    told them."""
    reach: Distance = 0.35
    """A robot whose centre comes this close to a source has found it and stops. The robot itself does not know. Height
    does not count but for drones, whose distance is that in space from the middle of the body."""
    capture: Literal["disc", "square"] = "disc"
    """Whether `reach` is the radius of a disc around the source or half the edge of a square."""
    found: Literal["reached", "declared"] = "reached"
    """Whether a robot has found a source that it has reached, or one that it has declared. Reached is within `reach`,
    which it does not know itself; declared is when it says where one is, and one is within `reach` of that place. With
    declared its first word ends its search, true or false."""
    wake: bool = False
    """Whether the robots disturb the air: in 3-D as solid bodies, in 2-D by their drag. Drones do so by the downwash of
    their rotors, which push down as much momentum as their weight is. It takes a computed wind and a single trial."""

    @property
    def start_altitude(self) -> float:
        """Height over the floor at which its bodies begin [m]."""
        return self.start.low_end(self.body)

    @property
    def stands(self) -> bool:
        """Whether the robots keep position and heading: their algorithm drives at `speed: 0`."""
        return getattr(self.algorithm, "speed", None) == 0

    def time(self, end: float) -> float:
        """How long its robots have been searching at a time `end` [s]; 0 while they wait."""
        return max(0.0, end - self.begin)

    def misfit(self, floor: Arena) -> str | None:
        """What is wrong with the size of its robots, or with their number; `key: message`."""
        width, radius = min(floor.size), self.body.radius
        if 2 * radius > width:
            return (
                f"body.radius: a robot {2 * radius:g} m wide does not fit on a floor "
                f"{width:g} m wide; make the body smaller"
            )
        most = int(floor.size[0] * floor.size[1] / (pi * radius**2))
        if self.count > most:
            return (
                f"count: {self.count} robots of radius {radius:g} m do not fit on "
                f"the floor; use fewer than {most} or a smaller body"
            )
        return None

    def places(self, floor: Arena) -> np.ndarray | None:
        """Where its robots start, (count, 2) [m]; None where that is drawn, or they do not fit."""
        return None if self.misfit(floor) else self.start.places(self.count)

    def problems(self, where: str, context: Context) -> Iterator[str]:
        scenario = context.scenario
        if scenario.arena is not None and scenario.arena.fault(context.domain.extent):
            return
        misfit = self.misfit(scenario.floor)
        if misfit:
            yield f"{where}.{misfit}"
        else:
            if self.wake:
                yield from self._wake(where, context)
            most = max(context.domain.extent)
            for path, sensor in self.sensors.placed():
                for key in ("ahead", "left"):
                    off = getattr(sensor, key, 0.0)
                    if abs(off) > most:
                        yield f"{where}.{path}.{key}: {off:g} m is more than the room is long; use at most {most:g} m"
            if context.domain.dim == 3:
                yield from self._heights(where, context.domain.extent[2])
            yield from self._flight(where)
            yield from self.start.clashes(f"{where}.start", self.body, self.count, context)
            yield from self._found_at_once(where, context)
        yield from self.algorithm.in_group(where, self, scenario.floor)

    def remarks(self, where: str, context: Context) -> Iterator[str]:
        stands = getattr(self.algorithm, "speed", None) == 0
        if self.reach == 0 and not (stands or context.scenario.maps):  # robots that measure or map need none
            yield f"{where}.reach: 0 m: its robots do not search, none will count as having found a source"
        if self.found == "declared" and not self.algorithm.may_declare:
            yield (
                f"{where}.found: declared, but {self.algorithm.kind} never says where a source is: none will count as "
                "found; use reached, or an algorithm that declares"
            )
        wind = context.scenario.wind
        if self.body.flies and wind.computed is None:
            yield (
                f"{where}.body: the downwash of its rotors is not there in a wind of kind {wind.kind}, which nothing "
                "disturbs; use wind.kind: cfd with wake: true to see it"
            )
        for key in ("speed", "line_speed"):
            speed = getattr(self.algorithm, key, None)
            if speed is not None and speed > self.body.max_speed:
                yield (
                    f"{where}.algorithm.{key}: {speed:g} m/s is more than body.max_speed: they drive at "
                    f"{self.body.max_speed:g} m/s"
                )

    def _wake(self, where: str, context: Context) -> Iterator[str]:
        """The air has to be computed, and is one: robots that move it cannot be in several trials at once."""
        wind = context.scenario.wind
        if wind.computed is None:
            yield (
                f"{where}.wake: a wind of kind {wind.kind} is not disturbed; use wind.kind: cfd, or remove the wake"
            )
            return
        for n, other in enumerate(context.scenario.robots):
            if other.trials > 1:
                yield (
                    f"{where}.wake: robots[{n}] has {other.trials} trials in the same air, and a wake would be felt "
                    "in all of them; use trials: 1, or remove the wake"
                )
                return
        if self.body.flies:
            return
        for path, sensor in self.sensors.placed():
            if context.domain.dim == 3 and sensor.height <= self.body.height:
                yield (
                    f"{where}.{path}.height: {sensor.height:g} m is inside the body, where with a wake there is no "
                    f"wind; put it above body.height = {self.body.height:g} m, or remove the wake"
                )
        if 2 * self.body.radius < context.domain.spacing:
            yield (
                f"{where}.wake: a body {2 * self.body.radius:g} m wide is smaller than a cell of "
                f"{context.domain.spacing:g} m and would not move the air; lower domain.spacing or remove the wake"
            )

    def _heights(self, where: str, ceiling: float) -> Iterator[str]:
        heights = {
            "body.height": self.body.height,
            **{f"{path}.height": sensor.height for path, sensor in self.sensors.placed()},
        }
        base = self.start_altitude
        for key, height in heights.items():
            if height > ceiling:
                yield f"{where}.{key}: {height:g} m is above the ceiling of the domain; use at most {ceiling:g} m"
            elif base + height > ceiling:
                yield (
                    f"{where}.start.altitude: {base:g} m and {key} of {height:g} m reach above the ceiling of the "
                    f"domain; use at most {ceiling - height:g} m"
                )

    def _flight(self, where: str) -> Iterator[str]:
        """What only drones have, and what only robots with wheels have."""
        if self.start.altitude is not None and not self.body.flies:
            yield f"{where}.start.altitude: is of drones alone; give body.kind: drone, or remove it"
        if self.odometry is not None and self.body.flies:
            yield f"{where}.odometry: a {self.body.kind} has no wheels to know its pose from; remove it"

    def _found_at_once(self, where: str, context: Context) -> Iterator[str]:
        """A robot that starts within reach of a source would have nothing to search; the first one."""
        places = self.start.places(self.count)
        if places is None:
            return
        for path, source in context.scenario.sources:
            apart = np.linalg.norm(places - np.array(source.position[:2]), axis=1)
            if self.body.flies and len(source.position) == 3:
                apart = np.hypot(apart, self.start_altitude + 0.5 * self.body.height - source.position[2])
            near = np.flatnonzero(apart <= self.reach)
            if len(near):
                k = near[0]
                yield (
                    f"{where}.start: robot {k} at ({places[k, 0]:g}, {places[k, 1]:g}) m is {apart[k]:.3g} m from "
                    f"{path} and would count as found at once; start it more than {where}.reach = "
                    f"{self.reach:g} m away, or lower the reach"
                )
                return
