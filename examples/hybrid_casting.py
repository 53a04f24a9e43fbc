"""External robot that searches for a simulated plume by casting, after Lochmatter & Martinoli 2008.

    python -m taichi_plume.serve configs/live/plumesim_hybrid.yaml      # in one terminal
    python examples/hybrid_casting.py                                   # in another one

The program replaces a real robot, for 90 s in real time: it has its own kinematics and algorithm, sends its pose, and
receives the readings of gas sensor and anemometer there. With --velocity the simulator also moves the robots, and the
program sends velocity commands (group with ``takes: velocity``). Any number of robots are driven independently.
"""

import argparse
from dataclasses import dataclass, replace

import numpy as np

from taichi_plume.client import Readings, Team

FIND, UPWIND, IN_PLUME, LOST, SIDESTEP = range(5)
MOST_CASTS = 4


@dataclass
class Settings:
    """Speed [m/s], threshold [ppm], distances [m], angle to the wind [rad], time constant of the wind mean [s]."""

    speed: float = 0.2
    threshold: float = 5.0
    angle: float = np.radians(20.0)
    lost_distance: float = 0.3
    cast_distance: float = 0.6
    find_step: float = 0.3
    wind_memory: float = 1.0
    peak_fraction: float = 0.7


class Casting:
    """Casting: lanes until the first detection, a zigzag upwind in the plume, ever wider crosswind sweeps outside."""

    def __init__(self, n: int, settings: Settings, heading: np.ndarray, rng: np.random.Generator):
        self.at, self.state = settings, np.full(n, FIND)
        self.side = rng.choice([-1.0, 1.0], n)
        self.step_sign, self.cast, self.failed = np.ones(n), np.zeros(n), np.zeros(n, int)
        self.wind, self.upwind = np.zeros((n, 2)), np.column_stack([np.cos(heading), np.sin(heading)])
        self.peak, self.trough = np.zeros(n), np.full(n, np.inf)
        self.way, self.stuck = np.zeros(n), np.zeros(n)  # way on the path segment [m], time blocked [s]
        self.place: np.ndarray | None = None

    def course(self) -> np.ndarray:
        """Unit vectors of the desired courses, (n, 2)."""
        u = self.upwind
        across = self.side[:, None] * np.column_stack([-u[:, 1], u[:, 0]])
        zigzag = np.cos(self.at.angle) * u + np.sin(self.at.angle) * across
        state = self.state[:, None]
        return np.where(
            state == IN_PLUME, zigzag, np.where(state == UPWIND, self.step_sign[:, None] * u, across)
        )

    def act(self, now: Readings, dt: float) -> tuple[np.ndarray, np.ndarray]:
        """Speeds [m/s] and turn rates [rad/s] for the next dt [s]."""
        self._feel_wind(now, dt)
        moved = 0.0 if self.place is None else np.hypot(*(now.position - self.place).T)
        self.place = now.position
        self.way = self.way + moved
        ahead = np.column_stack([np.cos(now.heading), np.sin(now.heading)])
        bump = now.blocked & ((ahead * self.course()).sum(axis=1) > 0.98)
        self.stuck = np.where(bump, self.stuck + dt, np.where(now.blocked, self.stuck, 0.0))
        self._decide(now.gas, bump)
        course = self.course()
        off = np.arctan2(course[:, 1], course[:, 0]) - now.heading
        off -= 2 * np.pi * np.round(off / (2 * np.pi))
        return self.at.speed * np.maximum(0.0, np.cos(off)), off / max(dt, 0.25)

    def _feel_wind(self, now: Readings, dt: float) -> None:
        share = 1.0 - np.exp(-dt / self.at.wind_memory)
        self.wind += np.where(now.wind_known[:, None], share * (now.wind - self.wind), 0.0)
        speed = np.hypot(*self.wind.T)
        felt = now.wind_known & (speed > 0)
        self.upwind[felt] = -self.wind[felt] / speed[felt, None]

    def _enter(self, which: np.ndarray, state: int) -> None:
        self.state[which], self.way[which], self.stuck[which] = state, 0.0, 0.0

    def _decide(self, gas: np.ndarray, bump: np.ndarray) -> None:
        at, was = self.at, self.state.copy()
        inside, aside = was == IN_PLUME, was == SIDESTEP
        self.peak = np.where(inside | aside, np.maximum(self.peak, gas), self.peak)
        smells = (gas >= 0.7 * at.threshold) & (gas >= at.peak_fraction * self.peak)
        self.way[inside & smells] = 0.0
        self.trough = np.where(inside | aside, gas, np.minimum(self.trough, gas))
        blocked = self.stuck > 1.0

        lost = inside & ~smells & (blocked | (self.way >= at.lost_distance))
        self.side[lost] *= -1
        self.cast[lost], self.failed[lost] = at.cast_distance, 0
        self._enter(lost, LOST)
        self._enter(inside & ~lost & blocked, SIDESTEP)

        past = aside & (self.way >= at.lost_distance)
        self._enter(past, IN_PLUME)
        turned = aside & ~past & blocked
        self.side[turned] *= -1
        self._enter(turned, SIDESTEP)

        outside = ~inside & ~aside
        found = outside & (gas >= at.threshold) & (gas >= 1.15 * self.trough)
        self.peak[found], self.step_sign[found] = gas[found], 1.0
        self._enter(found, IN_PLUME)

        swept = outside & ~found & (was == LOST) & (bump | (self.way >= self.cast))
        self.side[swept] *= -1
        self.cast[swept] *= 2.0
        self.failed[swept] += 1
        self._enter(swept & (self.failed < MOST_CASTS), LOST)
        self._enter(swept & (self.failed >= MOST_CASTS), FIND)

        self._enter(outside & ~found & (was == FIND) & bump, UPWIND)
        stepped = outside & ~found & (was == UPWIND) & (bump | (self.way >= at.find_step))
        self.step_sign[stepped & bump] *= -1
        self.side[stepped] *= -1
        self._enter(stepped, FIND)


class Wheels:
    """Poses of robots of a radius [m] in an empty arena, as from the localisation of a real robot."""

    def __init__(self, position: np.ndarray, heading: np.ndarray, size: tuple[float, float], radius: float):
        self.position, self.heading = position.astype(float), heading.astype(float)
        self.low, self.high = radius + 1e-3, np.array(size) - radius - 1e-3
        self.blocked = np.zeros(len(heading), bool)

    def drive(self, speed: np.ndarray, turn_rate: np.ndarray, dt: float, most_turn: float) -> None:
        """Drive for dt [s]; robots slide along walls."""
        turn = np.clip(turn_rate, -most_turn, most_turn) * dt
        course = self.heading + 0.5 * turn
        wanted = (speed * dt)[:, None] * np.column_stack([np.cos(course), np.sin(course)])
        place = np.clip(self.position + wanted, self.low, self.high)
        self.blocked = ((place - self.position) * wanted).sum(axis=1) < 0.9 * (wanted**2).sum(axis=1)
        self.position, self.heading = place, self.heading + turn


def search(
    team: Team, velocity: bool, seed: int = 0, size: tuple[float, float] = (4.0, 3.0), radius: float = 0.17
):
    """Search with all robots of a team until all arrive or the service ends; return the last readings."""
    now = team.wait()
    if now is None:
        raise ConnectionError(f"the service sends no readings of a group {team.group}")
    casting = Casting(len(now.robot), Settings(), now.heading, np.random.default_rng(seed))
    wheels = None if velocity else Wheels(now.position, now.heading, size, radius)
    last, before = now, now.t
    while now is not None:
        last, dt = now, now.t - before if now.t > before else 0.1
        before = now.t
        if wheels is None:
            team.drive(*casting.act(now, dt))
        else:
            felt = replace(now, position=wheels.position, heading=wheels.heading, blocked=wheels.blocked)
            speed, turn_rate = casting.act(felt, dt)
            wheels.drive(np.where(now.over, 0.0, speed), turn_rate, dt, np.pi)
            x, y = wheels.position.T
            team.be_at(x, y, wheels.heading)
        now = team.wait(5.0)
    return last


def main() -> None:
    """Search with all robots of a group."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("where", nargs="?", default="127.0.0.1:7447", help="HOST:PORT of the service")
    parser.add_argument("--group", default="roomba")
    parser.add_argument("--velocity", action="store_true", help="send velocity commands instead of poses")
    args = parser.parse_args()
    try:
        with Team(args.where, group=args.group, patience=20.0) as team:
            last = search(team, args.velocity)
    except ConnectionError as error:
        parser.error(str(error))
    print(f"t = {last.t:.1f} s: {last.over.sum()} of {len(last.over)} robots have found the source")


if __name__ == "__main__":
    main()
