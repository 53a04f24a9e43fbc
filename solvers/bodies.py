"""Moving bodies in the air (immersed boundaries by penalisation): obstacles of prescribed motion, and robots.

The air inside a body is made to move with it by penalisation (Angot, Bruneau & Fabrie 1999, doi:10.1007/s002110050401):
a force (v - u) r, implicit in u, of a rate that grows without bound towards the inside. Where the surface cuts a face's
volume the rate is s/(1 - s)/dt, s the volume fraction of the body: this averages the velocities by volume. A body is no
wall to the pressure, whose matrix does not change. Gas inside a body moves with it. Only the faces in a box around each
body are visited.

A robot in a 2-D run fills only a part of the slab, and most of the air passes over the robot. The robot then takes its
form drag from the air, C_d/2 (v - u)|v - u| per frontal area, spread evenly over its disc.
"""

from dataclasses import dataclass
from math import cos, inf, prod, radians, sin

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field
from taichi_plume.grid.fields import Faces
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Template
from taichi_plume.scenario.obstacles import Obstacle
from taichi_plume.scenario.robots import Body
from taichi_plume.solvers.boundaries import HORIZON

SOLID = 0.999  # largest share: 1 has an infinite rate
DRAG = 1.0  # drag coefficient of a squat upright cylinder on the ground


@dataclass(frozen=True)
class Outline:
    """Outline of a body: all points within `radius` [m] of a rectangle of half widths `half` [m] (0, 0: a disc) turned
    by `yaw` [rad], from `low` to `high` [m]; ball: whether the outline is round in the third direction too.
    """

    half: tuple[float, float] = (0.0, 0.0)
    radius: float = 0.0
    yaw: float = 0.0
    low: float = 0.0
    high: float = inf
    ball: bool = False


class Bodies:
    """Moving bodies of one outline in the air; satisfies `screens.Resistance` once a subclass defines `advance`.

    open: face fields, 1 where the velocity is solved for. place [m] and velocity [m/s]: fields of 2-vectors that the
    caller updates; the bodies are entries first to first + count. permeable: whether air passes through the bodies,
    with a drag, the force per mass over the square of the relative speed [1/m].
    """

    def __init__(
        self,
        grid: Grid,
        place: Field,
        velocity: Field,
        count: int,
        open: Faces,
        outline: Outline,
        first: int = 0,
        permeable: bool = False,
        drag: float = 0.0,
    ):
        self.grid, self.dim, self.open = grid, grid.dim, open
        self.place, self.velocity = place, velocity
        self.count, self.first = count, first
        self.ball, self.permeable = outline.ball, permeable
        top = self.grid.extent[2] if self.dim == 3 else 1.0
        margin = 0.0 if self.ball else self.grid.dx  # no air may slip under a body that stands on the floor
        low = outline.low - margin if outline.low <= 0 else outline.low
        high = top + margin if outline.high >= top else outline.high
        middle = 0.5 * (outline.low + outline.high) if self.ball else 0.5 * (low + high)
        half_height = 0.5 * (high - low)
        turn = (cos(outline.yaw), sin(outline.yaw))
        c, s = (abs(part) for part in turn)
        half, radius = outline.half, outline.radius
        reach = [radius + c * half[0] + s * half[1], radius + s * half[0] + c * half[1]]
        if self.dim == 3:
            reach.append(half_height)
        block = [int(2 * r / self.grid.dx) + 3 for r in reach]
        self.cells = self.count * self.dim * prod(block)
        self.half, self.turn = ti.filled_vectors(half), ti.filled_vectors(turn)
        self.reach = ti.filled_vectors(reach)
        """Half sizes of the box around a body [m]."""
        self.block = ti.filled_vectors(block)
        """Number of faces per axis in the box around a body, half a cell wider on either side."""
        self.radius, self.middle, self.half_height, self.drag = radius, middle, half_height, drag
        self.pace = ti.field(ti.f32)
        """1/dt [1/s]; 0 while the bodies are not there."""

    @ti.func
    def distance(self, x: Template, b):
        """Return the distance [m] of x [m] from the surface of body b, negative inside; a bound above and below."""
        p = ti.Vector([x[0], x[1]]) - self.place[b]
        turn, radius = self.turn[None], self.radius
        q = (
            ti.abs(ti.Vector([turn[0] * p[0] + turn[1] * p[1], turn[0] * p[1] - turn[1] * p[0]]))
            - self.half[None]
        )
        beyond = ti.sqrt(ti.max(q[0], 0.0) ** 2 + ti.max(q[1], 0.0) ** 2)
        result = beyond + ti.min(ti.max(q[0], q[1]), 0.0) - radius
        if ti.static(self.dim == 3):
            z = x[2] - self.middle
            if ti.static(self.ball):
                result = ti.sqrt(p.dot(p) + z * z) - radius
            else:
                result = ti.max(result, ti.abs(z) - self.half_height)
        return result

    @ti.func
    def share(self, x: Template, b):
        """Return the volume fraction, at most SOLID, of body b in a cube of edge dx around x."""
        return ti.math.clamp(0.5 - self.distance(x, b) / self.grid.dx, 0.0, SOLID)

    @ti.func
    def has_largest_share(self, x: Template, b, share):
        """Return 1 if body b has the largest fraction at x, so that no face is written twice, else 0."""
        result = 1
        for other in range(self.first, self.first + self.count):
            if other != b:
                theirs = self.share(x, other)
                if theirs > share or (theirs == share and other < b):
                    result = 0
        return result

    @ti.func
    def apply(self, u: Template, dt):
        """Move the air in and around the bodies with them (ti.func): update the velocities u for a step of dt [s]."""
        for d in ti.static(range(self.dim)):
            block = self.block[None]
            if ti.static(self.dim == 3):
                for K in ti.grouped(ti.ndrange(self.count, block[0], block[1], block[2])):
                    self._hold(u, d, K, dt)
            else:
                for K in ti.grouped(ti.ndrange(self.count, block[0], block[1])):
                    self._hold(u, d, K, dt)

    @ti.func
    def _hold(self, u: Template, d: Template, K: Template, dt):
        """Update the velocity on the face of axis d at place K[1:] of the block of body K[0], for a step of dt [s]."""
        b = self.first + K[0]
        x = ti.Vector.zero(ti.f32, self.dim)
        I = ti.Vector.zero(ti.i32, self.dim)
        inside = 1
        for e in ti.static(range(self.dim)):
            middle = self.middle
            if ti.static(e < 2):
                middle = self.place[b][e]
            shift = ti.static(0.0 if e == d else 0.5)
            i = K[e + 1] + ti.cast(
                ti.ceil((middle - self.reach[None][e]) / self.grid.dx - shift - 0.5), ti.i32
            )
            x[e] = (i + shift) * self.grid.dx
            n = ti.static(self.grid.shape[e])
            if ti.static(self.grid.periodic[e]):
                i = (i + n) % n
            elif i < 0 or i >= n + ti.static(int(e == d)):
                inside = 0
            I[e] = i + self.grid.ghost
        if inside == 1 and self.pace[None] > 0.0:
            share = self.share(x, b)
            if share > 0.0 and self.open[d][I] > 0.0:
                mine = self.has_largest_share(x, b, share)
                if mine == 1:
                    v = 0.0
                    if ti.static(d < 2):
                        v = self.velocity[b][d]
                    rate = 0.0
                    if ti.static(self.permeable):
                        rate = dt * self.drag * share * self._slip(u, d, I, b)
                    else:
                        rate = dt * self.pace[None] * share / (1.0 - share)
                    u[d][I] = (u[d][I] + rate * v) / (1.0 + rate)

    @ti.func
    def _slip(self, u: Template, d: Template, I, b):
        """Return the horizontal speed [m/s] of the air at face I of axis d relative to body b."""
        squared = 0.0
        D = ti.Vector.unit(self.dim, d, ti.i32)
        for e in ti.static(range(2)):
            E = ti.Vector.unit(self.dim, e, ti.i32)
            there = u[e][I]
            if ti.static(e != d):
                there = 0.25 * (u[e][I] + u[e][I - D] + u[e][I + E] + u[e][I + E - D])
            squared += (there - self.velocity[b][e]) ** 2
        return ti.sqrt(squared)


class MovingObstacle(Bodies):
    """Cylinder, sphere or box that moves as prescribed. Its position is exact at the end of each step."""

    def __init__(self, model: Obstacle, grid: Grid, open: Faces):
        place: Field = ti.vector_field(2, ti.f32, 1)
        velocity: Field = ti.vector_field(2, ti.f32, 1)
        super().__init__(grid, place, velocity, 1, open, outline(model, grid.dim))
        motion = model.motion
        assert motion is not None
        self.motion, self.center = motion, model.center

    def advance(self, t: float, dt: float) -> None:
        before = np.array(self.motion.place(self.center, t))
        after = np.array(self.motion.place(self.center, t + dt))
        self.place.from_numpy([after])
        self.velocity.from_numpy([(after - before) / dt])
        self.pace[None] = 1.0 / dt

    def fastest(self, t: float) -> float:
        """Return the largest speed [m/s] from t to t + HORIZON [s]; on a loop that of all path segments."""
        legs = self.motion.legs(self.center)
        return max(
            (speed for a, b, speed in legs if self.motion.loop or (a < t + HORIZON and t <= b)), default=0.0
        )


class Wake(Bodies):
    """Robots of a group in the air, as upright discs of the body's radius and height, from t = 0 on.

    Discs are solid in 3-D and have a drag in 2-D. place and velocity: fields of the swarm; the robots are entries first
    to first + count.
    """

    def __init__(
        self, body: Body, grid: Grid, place: Field, velocity: Field, first: int, count: int, open: Faces
    ):
        # C_d/2 times frontal area over the volume of the disc through the whole slab
        drag = DRAG * min(body.height / grid.depth, 1.0) / (np.pi * body.radius)
        shape = Outline(radius=body.radius, high=body.height)
        super().__init__(grid, place, velocity, count, open, shape, first, grid.dim == 2, drag)
        self.max_speed = body.max_speed

    def advance(self, t: float, dt: float) -> None:
        """Set the penalisation rate of a step of dt [s]; the swarm moves the robots, which are absent before t = 0."""
        self.pace[None] = 1.0 / dt if t > -1e-9 else 0.0

    def fastest(self, t: float) -> float:
        return self.max_speed


def outline(model: Obstacle, dim: int) -> Outline:
    """Return the outline of an obstacle that can move. Raises ValueError for other kinds of obstacles."""
    match model.kind:
        case "box":
            low, high = 0.0, inf
            if dim == 3:
                low, high = model.center[2] - model.size[2] / 2, model.center[2] + model.size[2] / 2
            half = (model.size[0] / 2, model.size[1] / 2)
            return Outline(half, yaw=radians(model.yaw_deg), low=low, high=high)
        case "sphere":
            if dim == 2:
                return Outline(radius=model.radius)
            low, high = model.center[2] - model.radius, model.center[2] + model.radius
            return Outline(radius=model.radius, low=low, high=high, ball=True)
        case "cylinder":
            top = inf if model.height is None else model.base + model.height
            return Outline(radius=model.radius, low=model.base, high=top)
        case _:
            raise ValueError(f"obstacles of kind {model.kind} cannot move")
