"""Groups of robots: start, algorithm, body, sensors, communication and localisation."""

from collections.abc import Iterator
from math import e, pi
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from taichi_plume.scenario import si
from taichi_plume.scenario.algorithms import Algorithm
from taichi_plume.scenario.bodies import Body
from taichi_plume.scenario.domain import Arena, Context
from taichi_plume.scenario.localization import Localization
from taichi_plume.scenario.sensors import Sensors
from taichi_plume.scenario.starts import Start
from taichi_plume.scenario.vocabulary import AT_START, SHAPE, Model


class Communication(Model):
    """Messages between the robots of a team, for algorithms that use them."""

    range: si.Length | None = None
    """Range of a message; unless given, unlimited."""
    loss: si.Fraction = 0.0
    """Probability that a robot misses a message."""
    rate: si.Frequency | None = None
    """Messages per second that a robot with a policy or with shared readings sends at most. It is rounded to whole
    ticks; unless given, there is one per tick."""


class Group(Model):
    """Robots of one kind. `trials` independent copies of the team run at once in the same air."""

    name: str = "robots"
    """Name of the group in tables and recordings; two groups need two names."""
    count: si.Count
    """Number of robots of the team."""
    trials: si.Count = 1
    """Independent copies of the team that search at once in the same air. They neither see nor meet each other: more
    give better statistics in one run."""
    first_trial: Annotated[int, Field(ge=0, le=1_000_000)] = 0
    """Number of the first trial. With `trials: 1`, one of many is run again alone, to the same result."""
    begin: Annotated[si.Delay, SHAPE] = 0.0
    """Time when the robots start to move. Until then they stand at their start, where their sensors measure gas, also
    for maps. The duration of a search counts from this time."""
    start: Annotated[Start, AT_START]
    """Start of the robots: at given positions, on a line or at random in an area."""
    algorithm: Algorithm
    """Search algorithm of the robots."""
    body: Body = Body()
    """Size and speed of each robot."""
    sensors: Sensors = Sensors()
    """Gas sensor and anemometer that each robot carries."""
    communication: Communication = Communication()
    """Range and loss of messages between the robots, for algorithms that use them."""
    localization: Localization | None = None
    """Way in which the robots know their poses: by odometry, which drifts, or from a camera, late and with noise.
    Unless given, they know them exactly."""
    reach: si.Distance = 0.35
    """A robot whose centre comes this close to a source has found it and stops. The robot itself does not know. Height
    only counts for drones, whose distance is that in space from the middle of the body."""
    capture: Literal["disc", "square"] = "disc"
    """Whether `reach` is the radius of a disc around the source or half the edge of a square."""
    found: Literal["reached", "declared"] = "reached"
    """Whether a robot has found a source that it has reached, or one that it has declared. Reached is within `reach`,
    which it does not know itself; declared means that a source is within `reach` of the position that it declares. With
    declared, its first declaration ends its search, true or false."""
    wake: bool = False
    """Whether the robots disturb the air: in 3-D as solid bodies, in 2-D by their drag. Drones do so by the downwash of
    their rotors, whose momentum equals their weight. It takes a computed wind and a single trial."""

    @property
    def start_altitude(self) -> float:
        """Height of the lower ends of the robots' bodies over the floor at the start [m]; 0 unless drones."""
        return self.start.low_end(self.body)

    @property
    def start_highest(self) -> float:
        """Largest height of the lower ends of the robots' bodies over the floor at the start [m]; 0 unless drones."""
        return self.start.high_end(self.body)

    @property
    def turn_time(self) -> float:
        """Least time T [s] in which the robots turn to a course with poses that are up to τ old: T = e τ.

        A heading that turns at the rate error / T then approaches the course as fast as it can without overshoot; for
        T < 2 τ / π it would oscillate ever more.
        """
        return 0.0 if self.localization is None else e * self.localization.age

    @property
    def stands(self) -> bool:
        """Whether the robots keep position and heading: their algorithm drives at `speed: 0`."""
        return self.algorithm.own_speed == 0

    def time(self, end: float) -> float:
        """Return how long the group has searched at time `end` [s]; 0 before its search begins."""
        return max(0.0, end - self.begin)

    def oversize(self, floor: Arena) -> str | None:
        """Return an error `key: message` if the robots are too wide or too many for the floor; otherwise None."""
        width, radius = min(floor.size), self.body.radius
        if 2 * radius > width:
            return f"body.radius: a robot {2 * radius:g} m wide does not fit on a floor {width:g} m wide; lower it"
        most = int(floor.size[0] * floor.size[1] / (pi * radius**2))
        if self.count > most:
            return f"count: {self.count} robots of radius {radius:g} m do not fit on the floor; use at most {most}"
        return None

    def places(self, floor: Arena) -> np.ndarray | None:
        """Return the start positions (count, 2) [m]; None if drawn at random, too few, or not fitting the floor."""
        return None if self.oversize(floor) else self.start.places(self.count)

    def errors(self, where: str, context: Context) -> Iterator[str]:
        scenario = context.scenario
        if scenario.arena is not None and scenario.arena.fault(context.domain.extent):
            return
        if oversize := self.oversize(scenario.floor):
            yield f"{where}.{oversize}"
        else:
            if self.wake:
                yield from self._wake(where, context)
            most = max(context.domain.extent)
            for path, sensor in self.sensors.placed():
                for key in ("ahead", "left"):
                    offset = vars(sensor).get(key, 0.0)
                    if abs(offset) > most:
                        yield f"{where}.{path}.{key}: {offset:g} m is longer than the room; use at most {most:g} m"
            if context.domain.dim == 3:
                yield from self._heights(where, context.domain.extent[2])
            yield from self._flight(where)
            yield from self.start.placement_errors(f"{where}.start", self.body, self.count, context)
            yield from self._found_at_once(where, context)
        yield from self.algorithm.in_group(where, self, scenario.floor)

    def warnings(self, where: str, context: Context) -> Iterator[str]:
        if self.reach == 0 and not (
            self.stands or context.scenario.maps
        ):  # robots that measure or map need none
            yield f"{where}.reach: 0 m: its robots cannot find a source"
        if self.found == "declared" and not self.algorithm.may_declare:
            kind = vars(self.algorithm)["kind"]
            yield f"{where}.found: declared, but {kind} never declares; use reached, or an algorithm that declares"
        wind = context.scenario.wind
        if self.body.flies and wind.computed is None:
            yield (
                f"{where}.body: a wind of kind {wind.kind} has no downwash of rotors; use wind.kind: cfd with wake: "
                "true if it matters"
            )
        for key in ("speed", "line_speed"):
            speed, most = vars(self.algorithm).get(key), self.body.max_speed
            if speed is not None and speed > most:
                yield f"{where}.algorithm.{key}: {speed:g} m/s is more than body.max_speed; {most:g} m/s are used"

    def _wake(self, where: str, context: Context) -> Iterator[str]:
        """Yield errors if the robots cannot disturb the air, which must be computed for one trial on a fine grid."""
        wind = context.scenario.wind
        if wind.computed is None:
            yield f"{where}.wake: a wind of kind {wind.kind} is not disturbed; use wind.kind: cfd, or remove the wake"
            return
        for n, other in enumerate(context.scenario.robots):
            if other.trials > 1:
                yield f"{where}.wake: robots[{n}] has {other.trials} trials in this air; use trials: 1, or remove wake"
                return
        if self.body.flies:
            return
        for path, sensor in self.sensors.placed():
            if context.domain.dim == 3 and sensor.height <= self.body.height:
                yield (
                    f"{where}.{path}.height: {sensor.height:g} m is inside the body, where a wake has no wind; put it "
                    f"above body.height = {self.body.height:g} m, or remove the wake"
                )
        if 2 * self.body.radius < context.domain.spacing:
            yield (
                f"{where}.wake: a body {2 * self.body.radius:g} m wide is smaller than a cell of "
                f"{context.domain.spacing:g} m; lower domain.spacing or remove the wake"
            )

    def _heights(self, where: str, ceiling: float) -> Iterator[str]:
        """Yield errors of the robots' bodies and sensors that reach above the ceiling [m]."""
        heights = {
            "body.height": self.body.height,
            **{f"{path}.height": sensor.height for path, sensor in self.sensors.placed()},
        }
        if self.sensors.range is not None:
            heights["sensors.range.height"] = self.sensors.range.height
        base = self.start_highest
        for key, height in heights.items():
            if height > ceiling:
                yield f"{where}.{key}: {height:g} m is above the ceiling of the domain; use at most {ceiling:g} m"
            elif base + height > ceiling:
                end = "altitude" if base == self.start_altitude else "highest"
                yield (
                    f"{where}.start.{end}: {base:g} m and {key} of {height:g} m reach above the ceiling of the "
                    f"domain; use at most {ceiling - height:g} m"
                )

    def _flight(self, where: str) -> Iterator[str]:
        """Yield errors of keys that only drones have on robots with wheels, and vice versa."""
        if self.start.altitude is not None and not self.body.flies:
            yield f"{where}.start.altitude: is for drones; give body.kind: drone, or remove it"
        if self.localization is not None and self.body.flies:
            yield f"{where}.localization: is for robots on the floor, a {self.body.kind} knows its pose; remove it"

    def _found_at_once(self, where: str, context: Context) -> Iterator[str]:
        """Yield an error if a robot starts within `reach` of a source, which it would find at once."""
        places = self.start.places(self.count)
        if places is None:
            return
        gases = dict(context.scenario.gases)
        for path, source in context.scenario.sources:
            if not gases[path.rpartition(".")[0]].searched:
                continue
            apart = np.linalg.norm(places - np.array(source.position[:2]), axis=1)
            if self.body.flies and len(source.position) == 3:
                apart = np.hypot(apart, self.start_altitude + 0.5 * self.body.height - source.position[2])
            near = np.flatnonzero(apart <= self.reach)
            if len(near):
                k = near[0]
                yield (
                    f"{where}.start: robot {k} at ({places[k, 0]:g}, {places[k, 1]:g}) m is {apart[k]:.3g} m from "
                    f"{path}, within {where}.reach = {self.reach:g} m; start it farther away, or lower the reach"
                )
                return
