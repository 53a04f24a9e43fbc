"""Downwash of drones: rotors as actuator discs.

By Newton's laws the air receives the force m (g - a) from a drone of mass m and acceleration a, g the acceleration of
gravity; a hovering drone pushes down its weight. The rotors return what the body takes from the air by drag, so that
drag cancels. The rotors share the force evenly, and each spreads it over a thin disc: over the faces within its radius
plus half a cell, in two layers around its plane, with weights whose sum over the faces with air is 1. The air thus gets
the momentum to rounding, wherever the disc lies on the grid. A rotor narrower than a cell is spread to the width of a
cell. The force is explicit: after the stages of a step its sum is that of the whole step.

The air passes the disc at w = (T/(2 rho A))^½ and reaches 2 w below (momentum theory: Rankine 1865, Froude 1889), with
ground and ceiling effect as far as the grid resolves them. Swirl, blades and tip vortices are not modelled, and the
body itself is no obstacle to the air.
"""

from math import pi, prod, sqrt

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field
from taichi_plume.grid.fields import Faces
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Template
from taichi_plume.scenario.bodies import GRAVITY, Body
from taichi_plume.scenario.species import AIR_DENSITY

LEAST_RADIUS = 0.5  # least radius of a disc [cells]
LANDED = 2e-3  # m of altitude over the floor below which rotors stand still
AHEAD_LEFT = 0.25 * pi  # bearing of the first rotor


class Downwash:
    """Force of the rotors of a group's drones on the air, from t = 0 on; satisfies `screens.Resistance`, in 3-D.

    place (2,) [m], heading [rad], altitude [m], acceleration (3,) [m/s²]: fields that the caller updates; the drones
    are entries first to first + count. open: face fields, 1 where the velocity is solved for.
    """

    def __init__(
        self,
        body: Body,
        grid: Grid,
        place: Field,
        heading: Field,
        altitude: Field,
        acceleration: Field,
        first: int,
        count: int,
        open: Faces,
    ):
        self.grid, self.open, self.first, self.count = grid, open, first, count
        self.place, self.heading, self.altitude, self.acceleration = place, heading, altitude, acceleration
        self.rotors = body.rotors or 1
        self.runs = ti.field(ti.i32)  # whether the rotors turn, 1 or 0
        # middles of the discs [m]; acceleration of a face of weight 1 [m/s²]
        self.hub, self.push = (ti.vector_field(3, ti.f32, count * self.rotors) for _ in range(2))
        dx = grid.dx
        mass, arm = body.mass or 0.0, body.arm or 0.0
        radius = max(body.rotor_radius or 0.0, LEAST_RADIUS * dx)
        across = arm + radius + 0.5 * dx
        block = [int(2 * reach / dx) + 2 for reach in (across, across, dx)]
        cells = zip(block, self.grid.shape, self.grid.periodic, strict=True)
        block = [min(faces, n) if periodic else faces for faces, n, periodic in cells]
        self.cells = self.count * 3 * prod(block)
        self.reach = ti.filled_vectors([across, across, dx])
        """Half sizes of the box around the discs of a drone [m]."""
        self.block = ti.filled_vectors(block)
        """Number of faces of the box per axis."""
        self.mass, self.radius, self.arm, self.height = mass, radius, arm, body.height
        thrust = mass * (GRAVITY + (body.max_acceleration or 0.0))
        disc = pi * min(self.rotors * radius**2, (arm + radius) ** 2)
        self.jet = sqrt(2.0 * thrust / (AIR_DENSITY * disc))  # speed of the far wake [m/s]

    def advance(self, t: float, dt: float) -> None:
        """Compute the rotors' forces on the faces around them; before t = 0 there are none."""
        self.runs[None] = t > -1e-9
        if t > -1e-9:
            self._compute_forces()

    def fastest(self, t: float) -> float:
        """Return the air speed [m/s] of the far wake at the largest thrust; 0 before t = 0."""
        return self.jet if t > -1e-9 else 0.0

    @ti.kernel
    def _compute_forces(self):
        for r in range(self.count * self.rotors):
            b = self.first + r // self.rotors
            angle = self.heading[b] + AHEAD_LEFT + 2.0 * pi * (r % self.rotors) / self.rotors
            arm = self.arm
            place = self.place[b] + arm * ti.Vector([ti.cos(angle), ti.sin(angle)])
            hub = ti.Vector([place[0], place[1], self.altitude[b] + self.height])
            self.hub[r] = hub
            # m (g - a), and never upward: rotors do not blow backwards
            force = -self.acceleration[b]
            force[2] = ti.min(force[2] - GRAVITY, 0.0)
            force *= ti.cast(self.altitude[b] > LANDED, ti.f32) * self.mass / self.rotors
            block = self.block[None]
            for d in ti.static(range(3)):
                total = 0.0
                for i, j, k in ti.ndrange(block[0], block[1], block[2]):
                    I, x, inside = self._face(d, ti.Vector([i, j, k]), hub)
                    if inside == 1 and self.open[d][I] > 0.0:
                        total += self._weight(x, hub)
                mass = AIR_DENSITY * self.grid.dx**3 * ti.max(total, 1e-6)
                self.push[r][d] = ti.select(total > 0.0, force[d] / mass, 0.0)

    @ti.func
    def _face(self, d: Template, K, middle):
        """Return index and position [m] of face K (axis d) in the block around a point, and 1 if it exists, else 0."""
        x = ti.Vector.zero(ti.f32, 3)
        I = ti.Vector.zero(ti.i32, 3)
        inside = 1
        for e in ti.static(range(3)):
            shift = ti.static(0.0 if e == d else 0.5)
            i = K[e] + ti.cast(ti.ceil((middle[e] - self.reach[None][e]) / self.grid.dx - shift), ti.i32)
            x[e] = (i + shift) * self.grid.dx
            n = ti.static(self.grid.shape[e])
            if ti.static(self.grid.periodic[e]):
                i = (i + n) % n
            elif i < 0 or i >= n + ti.static(int(e == d)):
                inside = 0
            I[e] = i + self.grid.ghost
        return I, x, inside

    @ti.func
    def _apart(self, x, middle):
        """Return the vector from `middle` to x [m], the short way round along periodic axes."""
        apart = x - middle
        for e in ti.static(range(3)):
            if ti.static(self.grid.periodic[e]):
                length = ti.static(float(self.grid.shape[e] * self.grid.dx))
                apart[e] -= length * ti.round(apart[e] / length)
        return apart

    @ti.func
    def _weight(self, x, hub):
        """Return the weight of a face at x in the rotor disc around `hub`, up to a factor common to all faces."""
        apart = self._apart(x, hub)
        off = ti.sqrt(apart[0] * apart[0] + apart[1] * apart[1])
        covered = ti.math.clamp(0.5 + (self.radius - off) / self.grid.dx, 0.0, 1.0)
        return covered * ti.max(0.0, 1.0 - ti.abs(apart[2]) / self.grid.dx)

    @ti.func
    def apply(self, u: Template, dt):
        for d in ti.static(range(3)):
            block = self.block[None]
            for K in ti.grouped(ti.ndrange(self.count, block[0], block[1], block[2])):
                self._push_face(u, d, K, dt)

    @ti.func
    def _middle(self, b):
        """Return the centre (3,) [m] of the rotors of the b-th drone."""
        p = self.place[self.first + b]
        return ti.Vector([p[0], p[1], self.altitude[self.first + b] + self.height])

    @ti.func
    def _push_face(self, u: Template, d: Template, K: Template, dt):
        """Apply the force of all drones to the face of axis d at place K[1:] of the block of drone K[0]. Only the first
        drone whose block holds the face does so, so that no face is written twice.
        """
        I, x, inside = self._face(d, ti.Vector([K[1], K[2], K[3]]), self._middle(K[0]))
        if inside == 1 and self.runs[None] == 1 and self.open[d][I] > 0.0:
            mine = 1
            for b in range(K[0]):
                _, lower, _ = self._face(d, ti.Vector([0, 0, 0]), self._middle(b))
                at = ti.cast(ti.round((x - lower) / self.grid.dx), ti.i32)
                for e in ti.static(range(3)):
                    if ti.static(self.grid.periodic[e]):
                        n = ti.static(self.grid.shape[e])
                        at[e] = (at[e] % n + n) % n
                block = self.block[None]
                covered = 1
                for e in ti.static(range(3)):
                    if at[e] < 0 or at[e] >= block[e]:
                        covered = 0
                if covered == 1:
                    mine = 0
            if mine == 1:
                total = 0.0
                for r in range(self.count * self.rotors):
                    total += self._weight(x, self.hub[r]) * self.push[r][d]
                u[d][I] = u[d][I] + dt * total
