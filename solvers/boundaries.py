"""Boundary conditions of the air at inlets, outlets and walls: prescribed velocity (Dirichlet) or ambient pressure.

Every boundary face has, per velocity component, a target V and a mirror factor, which `ghosts` turns into ghost values
beyond the face. The normal component is either prescribed (V) or free, with the ambient pressure outside. The targets
of tangential components lie on the staggered grid, between a boundary face and the boundary face below.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field, on_cpu
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.openings import Fan, FanCurve, Honeycomb, Inlet, MovingWall, Opening
from taichi_plume.solvers.blowing import Blowing
from taichi_plume.solvers.fans import CurvedFan
from taichi_plume.solvers.inflow import Fluctuations
from taichi_plume.solvers.openings import VENTS, JetPatch, Patch, patch_of

AIR_DENSITY = 1.184  # kg/m³ at 25 °C
HORIZON = 1.0  # s, largest time step
MIRRORS = {"wall": -1.0, "slip": 1.0, "outlet": 1.0, "honeycomb": 0.0}
"""Mirror factors of openings that do not blow, by kind; openings that blow have the factor 0."""


def curve_of(opening: Opening) -> FanCurve | None:
    """Return the pressure-flow curve of a fan; None for other openings and fans without a curve."""
    return opening.curve if opening.kind == "fan" else None


class Boundaries:
    """Boundary conditions of the flow: targets, mirror factors and ambient pressure of all boundary faces.

    patches: openings on the grid, with their parameters; jets: the patches that blow.
    """

    # the targets follow from these, the time and the openings, which may have changed
    STATE = ("ambient", "curved", "noise")

    def __init__(self, openings: tuple[Opening, ...], grid: Grid, area: Sequence[np.ndarray], seed: int = 0):
        """Place the openings; area: area fractions of the faces; seed: for turbulent inflow. Raises ValueError for an
        opening without air.
        """
        self.grid = grid
        self.dim = grid.dim
        self._placed: list[tuple[int, Patch]] = []
        for n, opening in enumerate(openings):
            try:
                patch = patch_of(opening, grid, area)
            except ValueError as error:
                raise ValueError(f"openings[{n}]: {error}") from None
            if patch is not None:
                self._placed.append((n, patch))
        self.patches = [patch for _, patch in self._placed]
        self.jets = [patch for patch in self.patches if isinstance(patch, JetPatch)]
        blowing = [openings[n] for n, patch in self._placed if isinstance(patch, JetPatch)]
        self.curved = {
            n: self._fan(curve, opening.speed_at(0.0), self.jets[n])
            for n, opening in enumerate(blowing)
            if (curve := curve_of(opening))
        }
        self.sides = [tuple(2 if a == d else n for a, n in enumerate(grid.padded)) for d in range(grid.dim)]
        self._inner = [tuple(2 if a == d else n for a, n in enumerate(grid.shape)) for d in range(grid.dim)]
        self._repeats = [grid.pad(np.arange(n), (a,)) for a, n in enumerate(grid.shape)]
        self.target, self.mirror = (tuple(grid.vector_field(shape) for shape in self.sides) for _ in range(2))
        self.free = tuple(grid.field(shape, ti.i32) for shape in self.sides)
        self.loss, self.ambient = (tuple(grid.field(shape) for shape in self.sides) for _ in range(2))
        """Loss coefficient [1] of the opening, and kinematic pressure at the face [m²/s²]."""
        self.is_free = self._kinds()
        self.has_loss = any(p.kind == "honeycomb" and p not in self.jets for p in self.patches)
        # jets and walls may change in every step
        self._changing = sorted({p.axis for p in self.patches if p in self.jets or p.kind == "wall"})
        self._set_conditions(openings, seed)

    def _fan(self, curve: FanCurve, speed: float, patch: JetPatch) -> CurvedFan:
        cells = np.stack(patch.cells(), axis=-1) + self.grid.ghost
        return CurvedFan(curve, speed, patch.area, AIR_DENSITY, cells, patch.profile[patch.covered])

    @staticmethod
    def _face(array: np.ndarray, patch: Patch) -> np.ndarray:
        """Return the view of a boundary array (2 along the patch's axis) on the side of the domain with the patch."""
        return np.moveaxis(array, patch.axis, 0)[patch.side]

    def spread(self, array: np.ndarray, d: int) -> np.ndarray:
        """Return a boundary array of axis d extended to the ghost layers of the other axes."""
        return array[np.ix_(*(range(2) if a == d else repeats for a, repeats in enumerate(self._repeats)))]

    def _kinds(self) -> list[np.ndarray]:
        """Set the mirror factors and the free faces by the kinds of the openings.

        Return a mask of the free faces per axis, ghost layers included.
        """
        mirror = [np.full((*shape, self.dim), -1.0, np.float32) for shape in self._inner]
        free = [np.zeros(shape, np.int32) for shape in self._inner]
        for p in self.patches:
            blows = p in self.jets
            self._face(mirror[p.axis], p)[p.covered] = 0.0 if blows else MIRRORS[p.kind]
            if p.kind in VENTS and not blows:
                self._face(free[p.axis], p)[p.covered] = 1
        self.is_wall = [(part[..., d] < 0.0) & (not self.grid.periodic[d]) for d, part in enumerate(mirror)]
        """Per axis, without ghost layers."""
        spread = [self.spread(faces, d) for d, faces in enumerate(free)]
        for d in range(self.dim):
            self.mirror[d].from_numpy(self.spread(mirror[d], d))
            self.free[d].from_numpy(spread[d])
        return spread

    def _set_conditions(self, openings: tuple[Opening, ...], seed: int) -> None:
        """Set the boundary conditions before the first step; seed: for turbulent inflow."""
        self._openings: list[Fan | Inlet | Honeycomb] = []  # parameters of the jets
        self._sliding: list[tuple[MovingWall, Patch]] = []
        self._wall_velocities = [np.zeros((*shape, self.dim), np.float32) for shape in self._inner]
        loss = [np.zeros(shape, np.float32) for shape in self._inner]
        for n, p in self._placed:
            opening = openings[n]
            match opening.kind:
                case "fan" | "inlet" | "honeycomb" if isinstance(p, JetPatch):
                    self._openings.append(opening)
                case "wall":
                    self._face(self._wall_velocities[p.axis], p)[p.covered] = opening.velocity
                    if opening.schedule:
                        self._sliding.append((opening, p))
                case "honeycomb":
                    self._face(loss[p.axis], p)[p.covered] = opening.loss_coefficient
        for p in self.jets:
            self._face(self._wall_velocities[p.axis], p)[p.covered] = 0.0
        self._sliding_targets = [self._along_walls(d) for d in range(self.dim)]
        for d in range(self.dim):
            self.target[d].from_numpy(self._sliding_targets[d])
            self.loss[d].from_numpy(self.spread(loss[d], d))
        self._targets = [target.values for target in self.target]
        # faces in the window of each jet, and their velocities over its mean speed
        self._blowing = [
            (self._face(self._targets[p.axis], p)[p.window], np.asfortranarray(p.flow, np.float32))
            for p in self.jets
        ]
        self.noise = {
            n: Fluctuations(p, o.turbulence_length or 0.4 * float(p.half.min()), seed, f"inflow {n}")
            for n, (p, o) in enumerate(zip(self.jets, self._openings, strict=True))
            if o.turbulence_intensity > 0
        }
        if not on_cpu():
            self._still = [ti.filled_vectors(target) for target in self._sliding_targets]
            self._on_device = [self._on_faces(n) for n in range(len(self.jets))]
        self._peaks = [self._peak(n) for n in range(len(self.jets))]
        self._blown: list[float] | None = None
        self.update(-np.inf, 0.0)

    def _on_faces(self, n: int) -> Blowing:
        """Return the n-th jet as a GPU computes it."""
        p = self.jets[n]
        faces = self._face(np.moveaxis(np.indices(self.sides[p.axis]), 0, -1), p)[p.window]
        faces, flow = faces.reshape(-1, self.dim), p.flow.reshape(-1, self.dim)
        return Blowing(self.target[p.axis], faces, flow, self.noise.get(n))

    def _peak(self, n: int) -> float:
        """Return the ratio of jet n's largest velocity component, with swirl and turbulence, to its mean speed."""
        p = self.jets[n]
        largest = np.abs(p.flow.reshape(-1, self.dim)).max(axis=0)
        swirl = np.delete(largest, p.axis).max()
        return float(largest[p.axis] + swirl) + 3.0 * self._openings[n].turbulence_intensity

    def speeds(self, t: float) -> list[float]:
        """Return the mean speed [m/s] of each jet at time t [s]; fans with a curve have their present speed."""
        return [
            self.curved[n].speed if n in self.curved else opening.speed_at(t)
            for n, opening in enumerate(self._openings)
        ]

    def advance(self, p: Field, t: float, dt: float) -> None:
        """Advance the boundary conditions from t to t + dt [s]. p: pressure field, operating point of fan curves."""
        for fan in self.curved.values():
            fan.advance(p, dt)
        self.update(t + dt, dt)

    def update(self, t: float, dt: float) -> None:
        """Set the targets for time t [s], at the end of a step of dt [s]; inflow turbulence advances by dt.

        Normal velocities change linearly within a step. Tangential velocities are the walls' means over the step.
        """
        self._set_targets(self.speeds(t), dt, self._set_wall_velocities(t - dt, t))

    def _set_wall_velocities(self, begin: float, end: float) -> bool:
        """Set the moving walls' mean velocities from `begin` to `end` [s]. Return whether any has changed."""
        changed = False
        for wall, p in self._sliding:
            face = self._face(self._wall_velocities[p.axis], p)
            before = face[p.covered]
            face[p.covered] = wall.mean_velocity(begin, end)
            if np.any(face[p.covered] != before):
                self._sliding_targets[p.axis] = self._along_walls(p.axis)
                changed = True
        return changed

    def _along_walls(self, d: int) -> np.ndarray:
        """Return the targets on the faces across axis d, ghost layers included, by moving walls alone. A tangential
        target is the mean of the velocities of the two boundary faces around it.
        """
        target = self._wall_velocities[d].copy()
        for c in range(self.dim):
            if c != d:
                target[..., c] = 0.5 * (target[..., c] + self._below(target[..., c], c))
        return np.asfortranarray(self.spread(target, d))

    def _below(self, values: np.ndarray, axis: int) -> np.ndarray:
        """Return each boundary face's lower neighbour along an axis; the first takes the last (periodic) or itself."""
        first = -1 if self.grid.periodic[axis] else 0
        return np.concatenate([np.take(values, [first], axis), np.delete(values, -1, axis)], axis)

    def measure_inertia(self, pressure_of: Callable[[], Field]) -> None:
        """Compute the inertia of the air in front of each fan with a curve.

        pressure_of: returns the field phi that makes the flow divergence-free; the pressure is dx/dt phi.
        """
        for n, fan in self.curved.items():
            self._set_targets([float(m == n) for m in range(len(self.jets))], 0.0)
            fan.inertia = max(0.0, self.grid.dx * fan.mean(pressure_of()))
        if self.curved:
            self.update(-np.inf, 0.0)

    def _set_targets(self, speeds: list[float], dt: float, slid: bool = False) -> None:
        """Set the targets of jets with these mean speeds [m/s]. slid: whether the velocity of a wall has changed."""
        if speeds == self._blown and not self.noise and not slid:
            return
        self._blown = speeds
        if not on_cpu():
            self._set_on_device(speeds, dt, slid)
            return
        for d in self._changing:
            self._targets[d][...] = self._sliding_targets[d]
        for n, (speed, (face, flow)) in enumerate(zip(speeds, self._blowing, strict=True)):
            face += speed * flow
            if n in self.noise and speed != 0:
                amplitude = self._openings[n].turbulence_intensity * abs(speed)
                face += amplitude * self.noise[n].advance(speed, dt)

    def _set_on_device(self, speeds: list[float], dt: float, slid: bool) -> None:
        """Set the targets as `_set_targets` does, without waiting for the GPU unless a wall has another velocity."""
        if slid:
            for d in self._changing:
                self._still[d].from_numpy(self._sliding_targets[d])
        self._stop_jets()
        for jet, opening, speed in zip(self._on_device, self._openings, speeds, strict=True):
            jet.add(speed, opening.turbulence_intensity * abs(speed), dt)

    @ti.kernel
    def _stop_jets(self):
        for d in ti.static(self._changing):
            for I in ti.grouped(ti.ndrange(*self.target[d].shape)):
                for c in ti.static(range(self.dim)):
                    self.target[d][I][c] = self._still[d][I][c]

    def fastest(self, t: float) -> float:
        """Return the largest velocity component [m/s] that schedules prescribe between t and t + HORIZON [s]."""
        result = 0.0
        for n, fan in self.curved.items():
            soon = max(fan.speed, min(fan.free_speed, fan.speed + 0.2 * fan.acceleration))
            result = max(result, self._peaks[n] * soon)
        for peak, opening in zip(self._peaks, self._openings, strict=True):
            if opening.schedule:
                times = [t, t + HORIZON, *(time for time in opening.knots if t < time < t + HORIZON)]
                result = max(result, peak * max(abs(opening.speed_at(time)) for time in times))
        return result

    def vented(self, regions: np.ndarray) -> set[int]:
        """Return the numbers of the regions with an opening that lets air out and in freely; regions: see `trapped`."""
        exits = [p for p in self.patches if p.kind in VENTS and p not in self.jets]
        return {int(region) for p in exits for region in np.unique(regions[p.cells()])}

    def trapped(self, regions: np.ndarray) -> list[int]:
        """Return the indices of openings that blow into a region without an outlet or a balancing opening.

        regions: array of grid.shape with equal numbers in cells that air connects.
        """
        jets = [(n, p) for n, p in self._placed if p in self.jets]
        reached, result = self.vented(regions), set()
        for region in {r for p in self.jets for r in np.unique(regions[p.cells()])} - reached:
            here = [m for m, p in enumerate(self.jets) if region in regions[p.cells()]]
            inside = [(p, p.covered) for p in (self.jets[m] for m in here)]
            shares = [
                p.profile[covered][regions[p.cells()] == region].sum() * p.face_area for p, covered in inside
            ]
            openings = [self._openings[m] for m in here]
            knots = sorted({0.0, *(time for opening in openings for time in opening.knots)})
            times = [*knots, *((a + b) / 2 for a, b in pairwise(knots))]
            flows = np.array(
                [[s * o.speed_at(t) for s, o in zip(shares, openings, strict=True)] for t in times]
            )
            # no speed of another jet balances a fan with a curve
            curved = any(m in self.curved for m in here)
            if curved or np.any(np.abs(flows.sum(axis=1)) > 1e-6 * np.abs(flows).sum(axis=1)):
                result |= {jets[m][0] for m in here}
        return sorted(result)
