"""Openings (inlets, outlets, fans) on the grid: covered boundary faces and velocity profiles."""

from collections.abc import Callable, Sequence

import numpy as np

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.grid import Grid, block_mean
from taichi_plume.scenario.openings import Fan, Inlet, Jet, Opening
from taichi_plume.scenario.windows import Region

SAMPLES = 8  # samples per axis, to average an opening's profile over a cell face
RIM = 0.05  # fraction of a fan's radius over which the rim of its jet decays
RIM_ROUNDING = 1e-9  # tolerance over an opening's half size: a mirrored room covers the mirrored faces
JETS = ("fan", "inlet", "honeycomb")  # kinds of openings that blow where they have a speed
VENTS = (*JETS, "outlet")  # kinds through which air passes
NO_AIR = "no air behind the opening, obstacles cover all of it on this grid; move one of them or lower domain.spacing"

Places = list[np.ndarray]
"""Positions along each axis of a face relative to an opening's centre, over its half size: [-1, 1] is inside."""


def bounds(mask: np.ndarray) -> tuple[slice, ...]:
    """Return the slices along each axis of the smallest block with all that `mask` covers."""
    return tuple(slice(int(at.min()), int(at.max()) + 1) for at in np.nonzero(mask))


def periodic_axes(openings: tuple[Opening, ...], dim: int) -> tuple[bool, ...]:
    """Return for each axis of the domain whether the openings make the axis periodic."""
    wrapped = {opening.axis for opening in openings if opening.kind == "periodic"}
    return tuple(axis in wrapped for axis in "xyz"[:dim])


class Patch:
    """Region of a face of the domain, such as an opening. covered: mask of the face's cells through which air passes.

    opening: present parameters of the region; kind: kind of the opening, empty if the region is no opening.
    """

    def __init__(self, region: Region, grid: Grid, area: Sequence[np.ndarray], kind: str = ""):
        """Find the covered faces; area: area fractions of the faces per axis, see `Air`."""
        self.grid = grid
        self.opening: Region = region
        self.kind = kind
        self.axis, self.side = region.axis, region.side
        self.along = region.along(grid.dim)
        self.behind = np.take(area[self.axis], -self.side, axis=self.axis) > 0.0
        center, half = region.rectangle(grid.extent)
        self.center, self.half = np.array(center), np.array(half)
        self.disc = region.is_disc(grid.dim)
        self.area = region.area(grid.extent, grid.depth)
        self.face_area = grid.cell_volume / grid.dx
        self.covered = self.inside(self._places((0.0,) * len(self.along), 1)) & self.behind

    def _places(self, shift: tuple[float, ...], samples: int) -> Places:
        """Return `samples` positions per axis in each boundary face; shift: offset of all positions, in cells."""
        axes = []
        for k, a in enumerate(self.along):
            cells = np.arange(self.grid.shape[a])[:, None] + (np.arange(samples) + 0.5) / samples + shift[k]
            axes.append((cells.ravel() * self.grid.dx - self.center[k]) / self.half[k])
        return list(np.meshgrid(*axes, indexing="ij"))

    def average(self, function: Callable[[Places], np.ndarray], shift: tuple[float, ...] = (0.0, 0.0)):
        """Return the mean over each boundary face of a function of the relative position; shift: as in `_places`."""
        return block_mean(function(self._places(shift, SAMPLES)), SAMPLES)

    def points(self, places: Places) -> list[np.ndarray]:
        """Return the coordinates along each axis of the domain [m] of relative positions `places`."""
        coordinates = [p * h + c for p, h, c in zip(places, self.half, self.center, strict=True)]
        coordinates.insert(self.axis, np.full_like(coordinates[0], self.side * self.grid.extent[self.axis]))
        return coordinates

    def radius(self, places: Places) -> np.ndarray:
        """Return the distance from the centre over the half size: round for a disc, square for a rectangle."""
        if self.disc:
            return np.sqrt(sum(p**2 for p in places))
        return np.max([np.abs(p) for p in places], axis=0)

    def inside(self, places: Places) -> np.ndarray:
        """Return a mask of the relative positions that the region covers, rim included."""
        return self.radius(places) <= 1.0 + RIM_ROUNDING

    def cells(self) -> tuple[np.ndarray, ...]:
        """Return the indices, per axis, of the cells of air behind the covered faces."""
        index = list(np.nonzero(self.covered))
        index.insert(self.axis, np.full(len(index[0]), self.side * (self.grid.shape[self.axis] - 1)))
        return tuple(index)


def _top_hat(patch: Patch, places: Places, opening: Fan) -> np.ndarray:
    return 0.5 * (1.0 - np.tanh((patch.radius(places) - 1.0) / RIM))


def _of_inlet(patch: Patch, places: Places, opening: Inlet) -> np.ndarray:
    inside = patch.inside(places)
    if opening.profile == "uniform":
        return inside
    if not isinstance(opening.profile, str):
        return opening.profile.shape(
            opening.profile.height_at(patch.points(places), patch.grid.extent), inside
        )
    if patch.disc:
        return inside * (1.0 - patch.radius(places) ** 2)
    return inside * np.prod([1.0 - p**2 for p in places], axis=0)


def _even(patch: Patch, places: Places, opening: Jet) -> np.ndarray:
    return patch.inside(places)


PROFILES = {"fan": _top_hat, "inlet": _of_inlet, "honeycomb": _even}
"""Velocity profiles by kind: speed over mean speed at positions on the face, before scaling to the exact flow rate."""


class JetPatch(Patch):
    """Opening that prescribes the speed of the air. profile: speed over mean speed, for each cell of the face.

    window: slices of the face with its ghost layers in which the air moves; flow: its velocity there over the mean
    speed, (*window, dim).
    """

    def __init__(self, opening: Jet, kind: str, grid: Grid, area: Sequence[np.ndarray]):
        """Raises ValueError if no air is behind the opening."""
        super().__init__(opening, grid, area, kind)
        profile = self.average(lambda p: PROFILES[kind](self, p, opening)) * self.behind
        profile[profile < 1e-3] = 0.0
        if not profile.any():
            raise ValueError(NO_AIR)
        self.profile = profile * (self.area / (profile.sum() * self.face_area))
        self.covered = self.profile > 0
        flow = np.zeros((*profile.shape, grid.dim))
        flow[..., self.axis] = self.profile if self.side == 0 else -self.profile
        if isinstance(opening, Fan) and opening.swirl and grid.dim == 3:
            self._swirl(flow, opening.swirl)
        flow = grid.pad(flow, self.along)
        self.window = bounds((flow != 0.0).any(axis=-1))
        self.flow = flow[self.window]

    def _swirl(self, flow: np.ndarray, ratio: float) -> None:
        """Set a fan's tangential velocity over its mean speed; ratio: swirl at the rim over mean speed."""
        turn = ratio if self.side == 0 else -ratio  # right-handed about the direction of the jet
        first, second = self.along if self.axis != 1 else reversed(self.along)
        for axis, other, sense in ((first, second, -turn), (second, first, turn)):
            shift = tuple(-0.5 if a == axis else 0.0 for a in self.along)
            arm = self.along.index(other)
            flow[..., axis] = self.average(
                lambda p, arm=arm, sense=sense: sense * p[arm] * self.inside(p), shift
            ) * (self.covered | np.roll(self.covered, 1, self.along.index(axis)))


def opening_cells(openings: tuple[Opening, ...], grid: Grid) -> np.ndarray:
    """Return a mask, of grid.shape, of the cells behind openings through which air passes."""
    result, everywhere = np.zeros(grid.shape, bool), Air.everywhere(grid).area
    for opening in openings:
        patch = patch_of(opening, grid, everywhere)
        if patch is not None and opening.kind in VENTS:
            result[patch.cells()] = True
    return result


def patch_of(opening: Opening, grid: Grid, area: Sequence[np.ndarray]) -> Patch | None:
    """Return an opening on the grid: a `JetPatch` if it prescribes a speed, otherwise a `Patch`; None if periodic.

    area: area fractions of the faces per axis. Raises ValueError if a jet or an outlet has no open face.
    """
    match opening.kind:
        case "periodic":
            return None
        case "fan" | "inlet" | "honeycomb" if opening.blows:
            return JetPatch(opening, opening.kind, grid, area)
        case _:
            patch = Patch(opening, grid, area, opening.kind)
            if opening.kind in VENTS and not patch.covered.any():
                raise ValueError(NO_AIR)
            return patch
