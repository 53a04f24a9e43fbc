"""Results of GADEN (iteration_N of all versions) as a played-back gas: concentrations [ppm] of the cells of a grid.

A file is zlib, since 3.1 after the text GADEN_RESULT and the unpacked size. Unpacked, little-endian:

    1          int32 version; float64 lower and upper corner [m]; int32 cells; float64 edge (3), source [m];
               int32 gas; float64 moles of a filament, of air per cm3; int32 wind;
               filaments of int32, float64 x, y, z, sigma
    2.0, 2.5   int32 major, minor; int32 cells; float32 corners, edge [m], source; int32 gas; float64 moles; int32 wind;
               filaments as above
    2.6        the same with float32 moles and filaments
    3          the same with the type of the source and its size before the position; then filaments as above or, after
               a text, "filaments" (float32 x, y, z, sigma, int32) or "concentrations" (float32 ppm per cell)

Sigma is in cm. A filament has a Gaussian of ppm, cut at 3 sigma and, with an occupancy grid, where a wall is between
the filament and the cell, as in GADEN. Cells count x first, then y, then z.
"""

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.files import gaden
from taichi_plume.files.conventions import FileFacts, spans, when
from taichi_plume.files.film import FilmError
from taichi_plume.files.gaden_results import GASES
from taichi_plume.files.wind_points import WindFileError, find
from taichi_plume.guard.safe_open import content_of
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.loading import ScenarioError, read_mapping
from taichi_plume.scenario.playback import GadenGas

LARGEST_FILE = 1 << 28  # bytes
MOST_VALUES = 2e9  # of all filaments at the cells within reach
MOST_CELLS = 100_000_000
LARGEST = 1e12  # ppm: sums stay finite
MARK = b"GADEN_RESULT\0"
CUT = 3.0  # sigma
SIZES = {b"point": 0, b"box": 12, b"line": 12, b"sphere": 4}
"""Bytes of the size of a source, by its type."""
USUAL_INTERVAL = 0.5  # s: GADEN's default of saveDeltaTime
FILES = "iteration_%d"


@dataclass(frozen=True)
class Result:
    """Iteration of GADEN's results. low: lower corner [m]; edge of a cell [m]; shape: cells; source [m].

    gas: GADEN's number; ppm: (x, y, z) or None; filaments: (n, 4), x, y, z [m] and sigma [cm]; strength: ppm at the
    centre of a filament times sigma³ [cm³].
    """

    path: Path
    low: np.ndarray
    edge: float
    shape: tuple[int, int, int]
    source: np.ndarray
    gas: int
    ppm: np.ndarray | None
    filaments: np.ndarray
    strength: float

    @property
    def kind(self) -> tuple[Any, ...]:
        """Grid, gas and form, which are the same in all files of a run."""
        return *self.low.tolist(), self.edge, self.shape, self.gas, self.ppm is None


class _Buffer:
    """Unpacked bytes of a result, read from the start on. Raises FilmError at the end."""

    def __init__(self, path: Path, content: bytes):
        self.path, self.content, self.at = path, content, 0

    def take(self, form: str) -> np.ndarray:
        """Return numbers of a struct format, such as "3i", as floats."""
        size = struct.calcsize(f"<{form}")
        if len(self.content) - self.at < size:
            raise FilmError(
                f"{self.path}: is cut or damaged: it ends after {len(self.content):,} bytes unpacked"
            )
        self.at += size
        return np.array(struct.unpack_from(f"<{form}", self.content, self.at - size), float)

    def text(self, allowed: Sequence[bytes]) -> bytes:
        """Return the text at this position if it is one of these, else b"", without moving on."""
        for text in allowed:
            whole = struct.pack("<Q", len(text)) + text
            if self.content.startswith(whole, self.at):
                self.at += len(whole)
                return text
        return b""

    def rest(self, kind: np.dtype) -> np.ndarray:
        """Return all that is left as records."""
        left = self.content[self.at :]
        if len(left) % kind.itemsize:
            raise FilmError(f"{self.path}: is cut or damaged: its filaments have {len(left):,} bytes")
        return np.frombuffer(left, kind)


def read(path: Path) -> Result:
    """Return an iteration of GADEN's results. Raises FilmError."""
    buffer = _Buffer(path, _unpacked(path))
    major = int(buffer.take("i")[0])
    if major not in (1, 2, 3):
        raise FilmError(f"{path}: is no result of GADEN 1, 2 or 3: it begins with {major}")
    minor = 0 if major == 1 else int(buffer.take("i")[0])
    if major == 1:
        corners, cells, edges, source = (buffer.take(form) for form in ("6d", "3i", "3d", "3d"))
    else:
        cells, corners, edges = (buffer.take(form) for form in ("3i", "6f", "f"))
        if major == 3:
            kind = buffer.text(list(SIZES))
            if not kind:
                raise FilmError(f"{path}: its source is none of {', '.join(name.decode() for name in SIZES)}")
            buffer.take(f"{SIZES[kind]}x")
        source = buffer.take("3f")
    gas, number = int(buffer.take("i")[0]), "d" if (major, minor) < (2, 6) else "f"
    moles, air, _ = buffer.take(f"2{number}i")
    edge, shape = float(edges[0]), (int(cells[0]), int(cells[1]), int(cells[2]))
    is_whole = np.isfinite([*corners, edge, *source, moles, air]).all() and 1e-3 <= edge <= 100.0
    is_filled = (np.abs(corners[:3] + edge * cells - corners[3:]) < 1.01 * edge).all()
    if not (is_whole and is_filled and min(shape) >= 1 and np.prod(cells) <= MOST_CELLS):
        raise FilmError(
            f"{path}: is damaged: {' x '.join(map(str, shape))} cells of {edge:g} m do not fill its box"
        )
    mode = buffer.text([b"filaments", b"concentrations"]) if major == 3 else b""
    count = int(buffer.take("Q")[0]) if mode else None
    ppm, filaments = None, np.empty((0, 4))
    if mode == b"concentrations":
        values = buffer.rest(np.dtype("<f4")).astype(float)
        if count != len(values) or count != np.prod(cells):
            raise FilmError(f"{path}: has {len(values):,} concentrations for {int(np.prod(cells)):,} cells")
        if not ((values >= 0.0) & (values <= LARGEST)).all():
            raise FilmError(f"{path}: holds a concentration that is not from 0 to {LARGEST:g} ppm")
        ppm = values.reshape(shape[::-1]).T
    else:
        order = [("n", "<i4"), ("place", f"<{number}", 4)]
        filaments = buffer.rest(np.dtype(order[::-1] if mode else order))["place"].astype(float)
        good = (
            count in (None, len(filaments)) and np.isfinite(filaments).all() and (filaments[:, 3] > 0.0).all()
        )
        if not good or (len(filaments) and not (air > 0.0 and moles >= 0.0)):
            raise FilmError(
                f"{path}: is damaged: filaments are missing or have no size, or no moles of gas and air"
            )
    strength = 1e6 * moles / air / (2.0 * np.pi) ** 1.5 if air > 0.0 else 0.0
    return Result(path, corners[:3], float(edge), shape, source, gas, ppm, filaments, strength)


def _unpacked(path: Path) -> bytes:
    content = content_of(path, LARGEST_FILE, FilmError)
    if content.startswith(MARK):
        content = content[len(MARK) + 8 :]
    try:
        return zlib.decompress(content)
    except zlib.error as error:
        raise FilmError(f"{path}: is no result of GADEN, or cut or damaged: {error}") from None


class GadenFilm:
    """Results of GADEN on disk, as frames on the cells of the domain, with the interface of a movie.

    times: of the files [s]; origin: the domain's lower corner in the files' coordinates [m]; source: its position from
    there [m]; gas: name of the species. Raises FilmError.
    """

    def __init__(self, folder: Path, model: GadenGas, domain: Domain):
        path = folder / model.files
        try:
            self.files = find(path if path.is_dir() else folder, FILES if path.is_dir() else model.files, 1.0)
            self.walls = gaden.read(folder / model.occupancy) if model.occupancy else None
        except WindFileError as error:
            raise FilmError(str(error)) from None
        self.path, self.cells, self.remarks = self.files[0][1], domain.shape, []
        interval = model.interval or self._interval()
        self.times = np.arange(len(self.files)) * interval
        self.first = read(self.path)
        if not 0 <= self.first.gas < len(GASES):
            raise FilmError(
                f"{self.path}: its gas has the number {self.first.gas}, not 0 to {len(GASES) - 1}"
            )
        self.gas = GASES[self.first.gas]
        low, edge, dim = self.first.low, self.first.edge, domain.dim
        self.high = low + edge * np.array(self.first.shape)
        self.origin = np.array(model.origin or low[:dim])
        axes = zip(self.cells, self.origin, low, self.first.shape, strict=False)
        self.shares = [  # of the results' cells in each cell of the domain
            gaden.overlaps_of(np.arange(n + 1) * domain.spacing + begin, a + edge * np.arange(count + 1))
            for n, begin, a, count in axes
        ]
        self.height = float(low[2] + self.high[2]) / 2 if model.height is None else model.height
        self.layer = int(min((self.height - low[2]) // edge, self.first.shape[2] - 1))
        if dim == 2 and not low[2] <= self.height <= self.high[2]:
            raise FilmError(
                f"{self.path}: height {self.height:g} m is outside of z {low[2]:g} to {self.high[2]:g} m"
            )
        if self.walls is not None and self.walls.cubes.shape != self.first.shape:
            shape = " x ".join(map(str, self.walls.cubes.shape))
            raise FilmError(f"{self.walls.path}: has {shape} cells, not those of {self.path}")
        if self.first.ppm is None and self.walls is None:
            self.remarks.append(f"{self.path}: has filaments, whose gas passes through walls; give occupancy")
        self.source = tuple(float(x) for x in self.first.source[:dim] - self.origin)
        self.largest = 0.0

    def _interval(self) -> float:
        """Return saveDeltaTime of the sim.yaml beside or above the results [s], or GADEN's default, with a remark."""
        for folder in (self.path.parent, self.path.parent.parent):
            if (folder / "sim.yaml").is_file():
                try:
                    step = read_mapping(folder / "sim.yaml", "it has saveDeltaTime").get("saveDeltaTime")
                except ScenarioError as error:
                    raise FilmError(error.faults[0]) from None
                if isinstance(step, int | float) and not isinstance(step, bool) and 0.0 < step < 1e6:
                    return float(step)
        self.remarks.append(
            f"{self.path}: states no time; files are taken as {USUAL_INTERVAL:g} s apart; give interval"
        )
        return USUAL_INTERVAL

    def gas_of(self, species: object) -> str:
        return "concentration"

    def still(self, name: str) -> np.ndarray:
        """Return the air fraction of the domain's cells: 1 everywhere, as results show no obstacles."""
        return np.ones(self.cells)

    def frame(self, n: int, names: list[str]) -> dict[str, np.ndarray]:
        """Return frame n [ppm] as means over the domain's cells, axes (x, y[, z]). Raises FilmError."""
        result = read(self.files[n][1])
        if result.kind != self.first.kind:
            raise FilmError(f"{result.path}: has another grid, gas or form than {self.path.name}")
        values = self._sum(result) if result.ppm is None else result.ppm
        if len(self.cells) == 2:
            values = values[:, :, self.layer]
        for axis, shares in enumerate(self.shares):
            values = np.moveaxis(np.tensordot(shares, values, axes=(1, axis)), 0, axis)
        self.largest = max(self.largest, float(values.max(initial=0.0)))
        return dict.fromkeys(names, values)

    def _sum(self, result: Result) -> np.ndarray:
        """Return the sum [ppm] of the Gaussians of all filaments at the centres of the cells, (x, y, z)."""
        values, sigmas = np.zeros(result.shape), result.filaments[:, 3:]
        begin, end = (
            np.clip((result.filaments[:, :3] + reach * sigmas - result.low) / result.edge, 0, result.shape)
            for reach in (-CUT / 100.0, CUT / 100.0)
        )
        begin, end = np.floor(begin).astype(int), np.ceil(end).astype(int)
        if np.prod((end - begin).astype(float), axis=1).sum() > MOST_VALUES:
            raise FilmError(
                f"{result.path}: has too many or too wide filaments for cells of {result.edge:g} m"
            )
        for (*place, sigma), first, last in zip(result.filaments, begin, end, strict=True):
            if (first >= last).any():
                continue
            radius = CUT * sigma / 100.0
            centres = [
                result.low[a] + result.edge * (np.arange(first[a], last[a]) + 0.5) - place[a]
                for a in range(3)
            ]
            x, y, z = np.meshgrid(*centres, indexing="ij")
            squared = x**2 + y**2 + z**2
            near = squared < radius**2
            if self.walls is not None:
                near &= self._in_sight(np.array(place), np.stack([x, y, z], axis=-1), np.sqrt(squared))
            at_centre = result.strength / sigma**3
            box = tuple(map(slice, first, last))
            values[box] += np.where(near, at_centre * np.exp(-squared * 1e4 / (2.0 * sigma**2)), 0.0)
        return values

    def _in_sight(self, place: np.ndarray, away: np.ndarray, distance: np.ndarray) -> np.ndarray:
        """Return whether no wall is between a filament and the points at `away` (..., 3) [m].

        The line between them is sampled at least every half a cell, twice as densely as in GADEN, which looks through
        walls of a cell.
        """
        assert self.walls is not None
        edge = self.first.edge
        free = self.walls.cubes == 0
        steps = np.ceil(2.0 * distance / edge).astype(int)
        sight = np.ones(distance.shape, bool)
        for k in range(int(steps.max()) + 1):
            share = np.where(k < steps, k / np.maximum(steps, 1), 1.0)
            cell = np.floor((place + share[..., None] * away - self.first.low) / edge).astype(int)
            inside = ((cell >= 0) & (cell < free.shape)).all(axis=-1)
            cell = np.clip(cell, 0, np.array(free.shape) - 1)
            sight &= inside & free[cell[..., 0], cell[..., 1], cell[..., 2]]
        return sight

    def facts(self) -> FileFacts:
        """Return what was read of the results, in their coordinates, and what was assumed."""
        form = "filaments" if self.first.ppm is None else "concentrations"
        cells = f"{' x '.join(map(str, self.first.shape))} cells of {self.first.edge:g} m"
        corner = ", ".join(f"{x:.6g}" for x in self.origin)
        return FileFacts(
            f"{when(self.times)}; {form} of {self.gas} on {cells}, {self.largest:.4g} ppm at most in the first and "
            f"last, {spans(self.first.low, self.high)}; the domain begins at ({corner})",
            tuple(self.remarks),
        )
