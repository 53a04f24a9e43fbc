"""Swarm: pose, kinematics (unicycle, differential drive, drone) and readings of all robots, without any overlap.

A body is an upright disc that drives like a unicycle, or flies (see `flight`). Per step a body moves along the chord of
its arc; a collision cuts the move short, and the rest of the move slides along the obstacle. Robots of a trial move one
after the other, each among the new positions of the robots before. Trials neither sense nor touch each other.
"""

from collections.abc import Callable, Sequence
from math import ceil

import numpy as np

from taichi_plume.agents.camera import Camera
from taichi_plume.agents.collisions import CLEAR, PINNED, PUSHED, SKIN, Contact
from taichi_plume.agents.columns import (
    GAS_SHARE,
    Rows,
    columns_of,
    further_gas_sensors,
    range_columns,
    with_excess,
)
from taichi_plume.agents.flight import FREE, Flying
from taichi_plume.agents.groups import GroupRange, ranges
from taichi_plume.agents.odometry import Odometry, Reckoning
from taichi_plume.agents.referee import Referee
from taichi_plume.agents.room import Room
from taichi_plume.agents.serial_loops import runs_serially
from taichi_plume.agents.trials import FAR, OwnClocks, Trials
from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field
from taichi_plume.files.prior_map import PriorMap
from taichi_plume.grid.elementary import cos_sin, wrap
from taichi_plume.scenario.localization import Camera as CameraModel
from taichi_plume.scenario.obstacles import Obstacle
from taichi_plume.scenario.robots import Group

BODY: dict[str, Callable[[Group], float]] = {
    "radius": lambda group: group.body.radius,
    "reach": lambda group: group.reach,
    "square": lambda group: float(group.capture == "square"),  # 1: the reach is half the edge of a square
    "by_declaring": lambda group: float(group.found == "declared"),  # 1: declaring finds a source
    "sets_off": lambda group: group.begin,  # s, after which a robot can find a source
    "max_speed": lambda group: group.body.max_speed,
    "max_turn_rate": lambda group: 0.0 if group.stands else np.radians(group.body.max_turn_rate_deg),
    "half_base": lambda group: 0.5 * (group.body.wheel_base or 0.0),  # m, 0 for a unicycle
    "max_acceleration": lambda group: group.body.max_acceleration or np.inf,
    "placed": lambda group: float(group.algorithm.placed),  # 1: put to `ordered_position` from outside
}
"""Functions from a group to each body parameter (f32), by the names of the swarm's fields."""


class Swarm(OwnClocks, Referee, Reckoning, Flying):
    """State and motion of the robots of all groups, one Taichi field per quantity (see `Columns`).

    positions: (count, 2) [m] and headings: (count,) [rad] at the start, free of overlap (see `placement`). clearance:
    see `Contact`. sources: (m, 2 or 3) [m], known to the referee, not to the robots; sources_at: function from a time
    [s] to the positions of sources that move, appear or end, NaN for those that are not there. walkers: moving
    obstacles, each felt as the disc around its footprint. A walker that runs into a robot pushes the robot aside, or
    pins the robot if walls and other bodies leave no way out. Robots placed from outside are not pushed. rivals:
    whether groups neither sense nor touch each other. episodes: trials of the only group that each restart on their
    own. background: whether clean air has a background of gas, which `measured` holds and `reading` does not. room: for
    models of dispersion.

    Algorithms read `reading` [ppm] above that in clean air, `wind` [m/s], `wind_known`, `blocked` (the bumper) and the
    believed pose, `believed_position` [m], `believed_heading` [rad] and `odometer` [m]. They write `speed_command`
    [m/s], `turn_rate_command` [rad/s] and `state`. Robots that are placed from outside stay until they get
    `ordered_position`, `ordered_heading`. Without `localization` the believed pose is the true one: the same fields.
    """

    @ti.shared_memory()
    def __init__(
        self,
        groups: Sequence[Group],
        positions: np.ndarray,
        headings: np.ndarray,
        clearance: object,
        sources: np.ndarray,
        seed: int,
        walkers: Sequence[Obstacle] = (),
        rivals: bool = False,
        episodes: Trials | None = None,
        background: bool = False,
        room: Room | None = None,
        sources_at: Callable[[float], np.ndarray] | None = None,
    ):
        self.clearance, self.room = clearance, room
        self.priors: dict[int, PriorMap] = {}  # of groups, by their numbers
        self.episodes = episodes
        self.apart = episodes is not None  # whether each trial restarts on its own
        self.groups: list[GroupRange] = ranges(groups, rivals)
        self.count = sum(group.size for group in self.groups)
        self.trials = max((group.row + group.trials for group in self.groups), default=0)
        n = max(1, self.count)  # Taichi has no empty fields
        self.flies = any(group.body.flies for group in groups)
        self.reckons = any(group.localization for group in groups)
        self.sees = any(isinstance(group.localization, CameraModel) for group in groups)
        further = (
            *further_gas_sensors(max((len(group.sensors.noses) for group in groups), default=1)),
            *range_columns(max((group.sensors.ranges for group in groups), default=0)),
        )
        self.classifies = any(group.sensors.classifier for group in groups)
        differs, shares = background or self.classifies, (GAS_SHARE,) * self.classifies
        columns = (*columns_of(self.flies, bool(walkers)), *further, *shares)
        self.columns = with_excess(columns) if differs else columns
        self.STATE = tuple(column.name for column in self.columns)
        self._allocate(n, self.reckons, differs)
        if self.classifies:
            everything = self._each(lambda group: float(group.sensors.classifier is None))
            self.gas_share.from_numpy(everything.astype(np.float32))
        self._further = [getattr(self, column.name) for column in further]
        for name, value in BODY.items():
            setattr(self, name, ti.filled(self._each(value), ti.f32))
        self.places = any(group.algorithm.placed for group in groups)
        self.key, self.seed = ti.filled(seed, ti.u32), seed
        self.walker_count, self.source_count = len(walkers), len(sources)
        if episodes is not None:
            self.source_count = episodes.most_sources
        self.discs: Field = ti.vector_field(2, ti.f32, max(1, len(walkers)))  # positions of the walkers [m]
        self.disc_radius = ti.filled([walker.disc for walker in walkers], ti.f32)
        self.sources = ti.vector_field(2, ti.f32, max(1, self.source_count))
        self.sources_at = sources_at
        if self.flies:
            self._set_flight(walkers)
        self._set_sources(sources if sources_at is None else sources_at(0.0))
        self._list_members()
        self.contact = Contact(self)
        if self.reckons:
            self.odometry = Odometry(n, self.counter, self.groups, seed)
        if self.sees:
            self.camera = Camera(n, self.counter, self.groups)
            self.STATE = (*self.STATE, "camera")
        self._kept = Rows(self, [column for column in self.columns if column.key], 0, self.count)
        self._fields = [getattr(self, column.name) for column in self.columns]
        self._set_start(positions, headings, walkers)

    def _list_members(self) -> None:
        """Fill members[k, :team_size[k]] with the indices of the robots of trial k, from all groups in that trial."""
        teams = [
            [
                g.start + (k - g.row) * g.count + i
                for g in self.groups
                if 0 <= k - g.row < g.trials
                for i in range(g.count)
            ]
            for k in range(self.trials)
        ]
        sizes = np.array([len(team) for team in teams] or [0], np.int32)
        table = np.full((len(sizes), max(1, sizes.max())), -1, np.int32)
        for row, team in zip(table, teams, strict=False):
            row[: len(team)] = team
        self.members, self.team_size = ti.filled(table), ti.filled(sizes)

    def _set_start(self, positions: np.ndarray, headings: np.ndarray, walkers: Sequence[Obstacle]) -> None:
        """Set poses of the robots and moving obstacles at the start of a run."""
        self.start = np.array(positions, np.float32).reshape(-1, 2)  # positions at the start [m]
        self.walkers = [(walker.motion, walker.center) for walker in walkers]
        self.strides = max(  # largest speed of the walkers over their radius [1/s]
            (
                leg[2] / walker.disc
                for walker in walkers
                if walker.motion
                for leg in walker.motion.legs(walker.center)
            ),
            default=0.0,
        )
        if self.count:
            for place in (self.position, self.believed_position):
                place.from_numpy(self.start)
            for heading in (self.heading, self.believed_heading):
                heading.from_numpy(headings)
            if self.sees:
                self.camera.frames[:, 0] = np.column_stack([self.start, headings])
        never = (self.found_time, self.reached_time, self.declared_position, self.declared_time)
        for field in (*never, self.declared_rate, self.ordered_position, self.resistance, *self._further):
            field.fill(np.nan)
        self._walk(0.0)

    def _each(self, value: Callable[[Group], float]) -> np.ndarray:
        """Return an array over the robots of the body parameter that `value` computes for each robot's group."""
        values = [np.full(group.size, value(group.model)) for group in self.groups]
        return np.concatenate(values) if self.count else np.zeros(1)

    def _walk(self, t: float) -> None:
        """Move the moving obstacles (walkers) to their positions at time t [s]."""
        if self.walkers:
            self.discs.from_numpy([motion.place(center, t) for motion, center in self.walkers])

    def _set_sources(self, places: np.ndarray) -> None:
        """Set the sources' positions (m, 2 or 3) [m] for the referee; NaN: no robot finds the source."""
        if len(places):
            places = np.where(np.isnan(places), FAR, places)
            self.sources.from_numpy(places[:, :2])
            if self.flies:
                self.source_height.from_numpy(places[:, 2])

    def _push(self, t: float, dt: float) -> None:
        """Push robots aside that moving obstacles run into during the time step of dt [s] that ends at t [s].

        An obstacle that is fast for its size moves in substeps of at most half its radius.
        """
        parts = max(1, ceil(2.0 * self.strides * dt - 1e-9))
        for n in range(1, parts + 1):
            if parts > 1:
                self._walk(t if n == parts else t - dt + n * dt / parts)
            self._give_way(1.0 / dt, dt if n == parts else 0.0)

    def move(self, tick: int, t: float, dt: float) -> None:
        """Move all robots by their commands for a time step dt [s] that ends at t [s], unless their search is over."""
        if self.count:
            self._walk(t)
            if self.sources_at is not None:
                self._set_sources(self.sources_at(t))
            self._move(tick, t, dt)
            if self.walkers:
                self._push(t, dt)

    def all_over(self) -> bool:
        """Return whether all robots' searches have ended, by finding a source or by declaring one."""
        over = self.found.values[: self.count] > 0
        by_declaring = self._each(BODY["by_declaring"])[: self.count] > 0
        if not over[~by_declaring].all():
            return False
        return bool(over.all()) or bool((over | (self.declarations.values[: self.count] > 0)).all())

    def snapshot(self) -> dict[str, np.ndarray]:
        """Return arrays over the robots of all recorded columns, by key, and the robots' start positions [m]."""
        keys = (column.key for column in self._kept.columns)
        return {"start": self.start, **dict(zip(keys, self._kept.read(), strict=True))}

    @ti.kernel
    def _move(self, tick: int, t: float, dt: float):
        ti.loop_config(serialize=ti.static(runs_serially(self.count)))
        for k in range(self.trials):
            for m in range(self.team_size[k]):
                self.go(self.members[k, m], k, tick, t, dt)

    @ti.kernel
    def _give_way(self, rate: float, dt: float):
        """Push robots out of moving obstacles. rate: 1/step [1/s]; dt: added to `pinned_time` of stuck robots [s]."""
        ti.loop_config(serialize=ti.static(runs_serially(self.count)))
        for k in range(self.trials):
            for m in range(self.team_size[k]):
                i = self.members[k, m]
                place, rise, result, gap = self.contact.escape(i, k, self.position[i])
                if self.placed[i] == 1.0 and result == PUSHED:
                    place, rise, result = self.position[i], 0.0, PINNED
                if result == CLEAR:
                    self.touched[i] = ti.cast(self.touched[i] == 1 and gap < SKIN, ti.i32)
                else:
                    if self.touched[i] == 0:
                        self.touched[i] = 1
                        self.pushes[i] = self.pushes[i] + 1
                        self.bumps[i] = self.bumps[i] + 1 - self.blocked[i]
                    self.blocked[i] = 1
                    self.velocity[i] = self.velocity[i] + rate * (place - self.position[i])
                    self.position[i] = place
                    if ti.static(self.flies):
                        self.climb_rate[i] = self.climb_rate[i] + rate * rise
                        self.altitude[i] = self.altitude[i] + rise
                if result == PINNED:
                    self.pinned_time[i] = self.pinned_time[i] + dt

    @ti.func
    def go(self, i, k, tick, t, dt):
        """Move robot i of trial k for a time step dt [s] that ends at t [s], and note whether it finds a source."""
        before = self.blocked[i]
        pose = self._true_pose(i)
        self.blocked[i] = 0
        self.velocity[i] = ti.Vector([0.0, 0.0])
        if ti.static(self.flies):
            self.climb_rate[i] = 0.0
            self.acceleration[i] = ti.Vector([0.0, 0.0, 0.0])
        drives = 1
        if ti.static(self.places):
            if self.placed[i] == 1.0:
                drives = 0
                self._put(i, dt)
        if self.searches(i):
            if drives == 1:
                self._go_on(i, k, tick, dt)
            self.bumps[i] = self.bumps[i] + ti.cast(self.blocked[i] > before, ti.i32)
            if t - self.sets_off[i] > 1e-3 * dt and self._reaches(i):
                if ti.math.isnan(self.reached_time[i]):
                    self.reached_time[i] = t
                if self.by_declaring[i] == 0.0:
                    self.found[i] = 1
                    self.found_time[i] = t
        self._look(i, tick, dt, pose)

    @ti.func
    def _go_on(self, i, k, tick, dt):
        """Move robot i of trial k through a time step of dt [s] by its kinematics: drive or fly."""
        if ti.static(self.flies):
            if self.wings[i] == 1.0:
                begin = self.position[i]
                blocked, turn, way = self._fly(i, k, dt)
                self.blocked[i] = blocked
                self.heading[i] = wrap(self.heading[i] + turn)
                self.path_length[i] = self.path_length[i] + way
                if ti.static(self.reckons):
                    self._reckon(i, tick, turn, way, self.position[i] - begin)
            else:
                self._drive(i, k, tick, dt)
        else:
            self._drive(i, k, tick, dt)

    @ti.func
    def renew(self, i, place, heading):
        """Reset all quantities of robot i to the start of a run at a position [m] and heading [rad]."""
        for field in ti.static(self._fields):
            field[i] = ti.zero(field[i])
        never = ti.Vector([ti.math.nan, ti.math.nan])
        self.position[i], self.heading[i] = place, heading
        self.declared_position[i] = never
        self.declared_rate[i] = ti.Vector([ti.math.nan, ti.math.nan, ti.math.nan])
        self.found_time[i], self.reached_time[i] = never[0], never[0]
        self.declared_time[i], self.resistance[i] = never[0], never[0]
        for field in ti.static(self._further):
            field[i] = never[0]
        if ti.static(self.reckons):
            self.believed_position[i], self.believed_heading[i] = place, heading
            self.odometry.renew(i)
        if ti.static(self.sees):
            self.camera.start(i, place, heading)
        if ti.static(self.flies):
            self._restart_flight(i)

    @ti.func
    def _put(self, i, dt):
        """Set robot i to its ordered pose without collision checks: the pose is that of a real robot."""
        place = self.ordered_position[i]
        if not ti.math.isnan(place[0]):
            moved = place - self.position[i]
            way = moved.norm()
            # a jump of the tracking system causes no wind
            self.velocity[i] = moved / ti.max(dt, way / ti.max(self.max_speed[i], 1e-9))
            self.position[i], self.heading[i] = place, self.ordered_heading[i]
            if ti.static(self.flies):
                if not ti.math.isnan(self.ordered_altitude[i]):
                    up = self.ordered_altitude[i] - self.altitude[i]
                    self.climb_rate[i] = up / dt
                    self.altitude[i] = self.ordered_altitude[i]
                    way = ti.sqrt(way * way + up * up)
            self.path_length[i] = self.path_length[i] + way
            if ti.static(self.reckons):
                self.believed_position[i], self.believed_heading[i] = place, self.heading[i]
                self.odometer[i] = self.path_length[i]

    @ti.func
    def _drive(self, i, k, tick, dt):
        """Move robot i of trial k as a unicycle for dt [s], cut short by collisions and slid along obstacles."""
        speed, turn_rate = self._limited(i, dt)
        arc, turn = speed * dt, turn_rate * dt
        chord = arc
        if ti.abs(turn) > 1e-3:  # below, the factor differs from 1 by less than f32 resolves
            chord *= cos_sin(0.5 * turn)[1] / (0.5 * turn)
        course = self.heading[i] + 0.5 * turn
        self.heading[i] = wrap(self.heading[i] + turn)

        displacement = chord * cos_sin(course)
        begin = self.position[i]
        p, path, contact = self.contact.slide(i, k, begin, displacement)
        if contact == 1 and (p - begin).dot(displacement) < FREE * displacement.dot(displacement):
            self.blocked[i] = 1
        self.position[i] = p
        self.velocity[i] = (p - begin) / dt
        self.path_length[i] = self.path_length[i] + path
        if ti.static(self.reckons):
            self._reckon(i, tick, turn, ti.select(arc < 0.0, -path, path), p - begin)

    @ti.func
    def _limited(self, i, dt):
        """Return speed [m/s] and turn rate [rad/s] of robot i: its commands within the limits of its body."""
        limit, turn_limit = self.max_speed[i], self.max_turn_rate[i]
        speed = ti.math.clamp(self.speed_command[i], -limit, limit)
        turn_rate = ti.math.clamp(self.turn_rate_command[i], -turn_limit, turn_limit)
        # the outer wheel stays within the largest speed, on an arc of the same radius
        outer = ti.abs(speed) + ti.abs(turn_rate) * self.half_base[i]
        share = ti.select(outer > limit, limit / ti.max(outer, 1e-9), 1.0)
        change = ti.math.clamp(
            share * speed - self.speed[i], -self.max_acceleration[i] * dt, self.max_acceleration[i] * dt
        )
        speed = self.speed[i] + change
        self.speed[i] = speed
        return speed, share * turn_rate
