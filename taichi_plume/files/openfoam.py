"""OpenFOAM's case folders: velocities at the centres of the cells, of all times, whole or decomposed.

    constant/polyMesh/{points, faces, owner, neighbour}    the mesh; of a decomposed case in each processorN
    TIME/U, and TIME/nut where there is one                the fields of a time [s]

Files are text or binary, also gzipped (.gz). A cell's centre is that of its volume, as OpenFOAM has it (Jasak 1996,
thesis, Imperial College): faces are cut into triangles about the mean of their corners, cells into pyramids about the
mean of their faces' centres. For cells with plane faces that is exact.

No library is asked: VTK, of half a GB, has points in single precision, and foamlib 1.7 took more than ten minutes for
20,000 faces of text.
"""

import os
import re
import warnings
import zlib
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from taichi_plume.files.wind_points import FARTHEST, FASTEST, MOST_NUMBER, Points, WindFileError
from taichi_plume.guard.opening import admit, read_regular

LARGEST_FILE = 1 << 30  # bytes, also once unpacked
UNPACKED = 1 << 26  # bytes that a packed file of any size may have once unpacked
TIGHTEST = 100  # bytes per packed byte of larger files; text of a mesh or field has 3 to 10
LARGEST_LABEL = 2.0**31
MOST_EQUAL = 1000  # entries of a list with one value for all, where nothing else says how many there are
MESH = "constant/polyMesh"
PARTS = ("points", "faces", "owner", "neighbour")
# Every pattern reads each byte a bounded number of times: a comment without an end reaches to the end of the file, and
# blanks are not given back (++).
COMMENT = re.compile(rb"/(?:/[^\n]*|\*.*?(?:\*/|\Z))", re.DOTALL)
SKIPPED = re.compile(rb"\s++|//[^\n]*+|/\*.*?(?:\*/|\Z)", re.DOTALL)
HEADER = re.compile(rb"FoamFile\s*+\{([^{}]*+)\}")
WORD = re.compile(rb'"([^"]*)"|(;)|([^\s;"]+)')
LIST = re.compile(rb"\s*+(\d{1,10})\s*+([({])")
ENDS = {True: re.compile(rb"\)\s*\)"), False: re.compile(rb"\)")}  # of a list of lists, of one of numbers
BLANK = bytes.maketrans(b"()", b"  ")
TIME = re.compile(r"\d+(\.\d*)?(e[-+]?\d+)?", re.IGNORECASE)
FIELD = re.compile(rb"internalField\s++(?:uniform\s++([^;]{1,300}+);|nonuniform\s++(?:List<\w++>)?)")


def is_case(path: Path) -> bool:
    """Whether a path is a case folder."""
    return any(os.path.isdir(path / part / MESH) for part in (".", "processor0"))


def is_time(path: Path) -> bool:
    """Whether a path is that of a time of a case; of a decomposed one there may be no such folder."""
    return TIME.fullmatch(path.name) is not None and is_case(path.parent)


def times(case: Path) -> list[tuple[float, Path]]:
    """The times [s] of a case, in order, each as the path of its folder. Raises WindFileError."""
    found = {key: name for part in _parts(case)[:1] for key, name in _times(part).items()}
    late = max(found, default=0.0)
    if late > MOST_NUMBER:
        raise WindFileError(f"{case / found[late]}: its time is above {MOST_NUMBER:g} s")
    if not found:
        raise WindFileError(f"{case}: has no time folder with a file U")
    return [(key, case / found[key]) for key in sorted(found)]


def read(path: Path) -> Points:
    """The points of a time of a case, cells in the order of its parts. Raises WindFileError."""
    case, velocity, eddies = path.parent, [], []
    parts = _parts(case, path.name)
    for part in parts:
        folder, size = part / path.name, len(_centres(part))
        velocity.append(_field(folder / "U", 3, size))
        if _there(folder / "nut"):
            eddies.append(_field(folder / "nut", 1, size)[:, 0])
    if eddies and len(eddies) < len(parts):
        raise WindFileError(f"{path}: only some of its parts have a file nut")
    u = np.concatenate(velocity)
    if len(u) < 4:
        raise WindFileError(f"{case}: has {len(u)} cells, too few")
    if np.abs(u).max() >= FASTEST:
        raise WindFileError(f"{path}: {np.abs(u).max():.3g} m/s in U is no speed of air")
    place = np.concatenate([_centres(part) for part in parts])
    return Points(path, place, u, np.maximum(np.concatenate(eddies), 0.0) if eddies else None)


def _parts(case: Path, time: str = "") -> list[Path]:
    """The case itself, or the folders of its processors where these have times that it has not. Raises WindFileError.

    time: the one that is read, by its name; unless given, all.
    """
    whole = [case] if (case / MESH).is_dir() else []
    split, n = [], 0
    while (case / f"processor{n}" / MESH).is_dir():
        split.append(case / f"processor{n}")
        n += 1
    if not whole and not split:
        raise WindFileError(f"{case}: is no case of OpenFOAM: it has no {MESH}, nor has processor0 in it")
    if not whole or not split:
        return whole or split
    if time:
        return whole if _there(case / time / "U") else split
    return split if _times(split[0]).keys() - _times(case).keys() else whole


def _times(part: Path) -> dict[float, str]:
    try:
        names = [one.name for one in part.iterdir() if TIME.fullmatch(one.name)]
    except OSError as error:
        raise WindFileError(f"{part}: cannot be read: {error.strerror or error}") from None
    return {float(name): name for name in names if _there(part / name / "U")}


def admit_files(path: Path) -> None:
    """Admit all files that `read` opens for a time of a case. Raises WindFileError if one lies outside the gate."""
    for part in _parts(path.parent, path.name):
        for file in (*_mesh(part), part / path.name / "U", part / path.name / "nut"):
            if _there(file):
                _admit(_file(file))


def _admit(file: Path) -> None:
    try:
        admit(file)
    except OSError as error:
        raise WindFileError(f"{file}: {error.strerror}") from None


def _mesh(part: Path) -> list[Path]:
    return [part / MESH / name for name in PARTS]


# ---------------------------------------------------------------- mesh


def _centres(part: Path) -> np.ndarray:
    """Those of the cells of a part (n, 3) [m]."""
    if any(_there(part / name / "polyMesh" / "points") for name in _times(part).values()):
        raise WindFileError(f"{part}: its mesh moves, which is not read")
    files = [_file(file) for file in _mesh(part) if _there(file)]
    for file in files:
        _admit(file)
    return _centres_of(part, tuple(file.stat().st_mtime_ns for file in files))


@lru_cache(maxsize=64)
def _centres_of(part: Path, _changed: tuple[int, ...]) -> np.ndarray:
    points = _open(part / MESH / "points").numbers(3)
    flat, ends = _open(part / MESH / "faces").faces()
    owner = _open(part / MESH / "owner").labels()
    neighbour = _open(part / MESH / "neighbour").labels()
    cells = int(max(owner.max(initial=-1), neighbour.max(initial=-1))) + 1
    if (
        not len(points)
        or np.abs(points).max() > FARTHEST
        or flat.min(initial=0) < 0
        or flat.max(initial=0) >= len(points)
        or len(owner) != len(ends)
        or len(neighbour) > len(owner)
        or min(owner.min(initial=0), neighbour.min(initial=0)) < 0
        or not 0 < cells <= len(ends)
    ):
        raise WindFileError(f"{part / MESH}: its points, faces, owner and neighbour do not belong together")
    center, area = _faces(points, flat, ends)
    pairs = np.concatenate([owner, neighbour])
    faces = np.concatenate([np.arange(len(owner)), np.arange(len(neighbour))])
    sign = np.repeat([1.0, -1.0], [len(owner), len(neighbour)])
    return _volumes(center[faces], sign[:, None] * area[faces], pairs, cells, part)


def _sums(values: np.ndarray, into: np.ndarray, count: int) -> np.ndarray:
    """Sums (count, 3) of vectors (n, 3)."""
    return np.stack([np.bincount(into, column, count) for column in values.T], axis=-1)


def _faces(points: np.ndarray, flat: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centres and vector areas of faces, whose corners are parts of `flat` that end at `ends`."""
    begin = np.concatenate([[0], ends[:-1]])
    sizes = ends - begin
    face = np.repeat(np.arange(len(ends)), sizes)
    after = np.arange(1, len(flat) + 1)
    after[ends - 1] = begin
    a, b = points[flat], points[flat[after]]
    middle = _sums(a, face, len(ends)) / sizes[:, None]
    normal = 0.5 * np.cross(b - a, middle[face] - a)
    area = _sums(normal, face, len(ends))
    size = np.maximum(np.linalg.norm(area, axis=1), 1e-300)
    share = (normal * (area / size[:, None])[face]).sum(
        axis=1
    )  # of triangles, against the whole face's normal
    total = np.bincount(face, share, len(ends))
    center = _sums(share[:, None] * (a + b + middle[face]) / 3.0, face, len(ends))
    flat_out = np.abs(total) < 1e-290
    return np.where(flat_out[:, None], middle, center / np.where(flat_out, 1.0, total)[:, None]), area


def _volumes(center: np.ndarray, area: np.ndarray, cell: np.ndarray, cells: int, part: Path) -> np.ndarray:
    """Centres of cells by the pyramids over their faces; center, area: of the faces of all cells, area outwards."""
    count = np.bincount(cell, minlength=cells)
    if count.min() < 4:
        raise WindFileError(f"{part / MESH}: cell {int(count.argmin())} has {int(count.min())} faces")
    middle = _sums(center, cell, cells) / count[:, None]
    volume = (area * (center - middle[cell])).sum(axis=1) / 3.0
    total = np.bincount(cell, volume, cells)
    if not (total > 0.0).all():
        raise WindFileError(f"{part / MESH}: cell {int(total.argmin())} has no volume")
    away = 0.75 * (center - middle[cell])  # of a pyramid's centre from its tip
    return middle + _sums(volume[:, None] * away, cell, cells) / total[:, None]


# ---------------------------------------------------------------- files


@dataclass(frozen=True)
class _Foam:
    """What follows the header of a file, and how its numbers are written."""

    path: Path
    body: bytes
    binary: bool
    label: np.dtype
    scalar: np.dtype
    kind: str

    def wrong(self, what: str) -> WindFileError:
        """A fault of this file."""
        return WindFileError(f"{self.path}: {what}")

    def numbers(self, width: int, begin: int = 0, wanted: int | None = None) -> np.ndarray:
        """A list of scalars or vectors, (n, width); wanted: how many it must have."""
        values = self._list(begin, self.scalar, width, wanted)[0].astype(float).reshape(-1, width)
        if not np.isfinite(values).all():
            raise self.wrong("not all of its values are finite")
        return values

    def labels(self) -> np.ndarray:
        """A list of integers."""
        values = self._list(0, self.label, 1)[0]
        if not (np.abs(values) < LARGEST_LABEL).all():
            raise self.wrong("its list holds what is no label of a mesh")
        return values.astype(np.int64)

    def faces(self) -> tuple[np.ndarray, np.ndarray]:
        """The corners of all faces in turn, and where in them each face ends."""
        if self.binary and self.kind != "faceCompactList":
            raise self.wrong("is a binary list of another class than faceCompactList")
        if self.binary or self.kind == "faceCompactList":
            ends, end = self._list(0, self.label, 1)
            flat, _ = self._list(end, self.label, 1)
            ends, flat = ends.astype(np.int64)[1:], flat.astype(np.int64)
        else:
            count, values = self._text(0, True)
            if not (np.abs(values) < LARGEST_LABEL).all():
                raise self.wrong("its list holds what is no label of a mesh")
            sizes, at = [], 0
            for _ in range(count):
                if at >= len(values) or values[at] < 3 or values[at] != int(values[at]):
                    raise self.wrong("its list is cut or damaged")
                sizes.append(int(values[at]))
                at += sizes[-1] + 1
            heads = np.cumsum([0, *sizes[:-1]]) + np.arange(count)
            ends = np.cumsum(sizes)
            flat = np.delete(values, heads).astype(np.int64) if at == len(values) else np.empty(0, np.int64)
        if not len(ends) or (np.diff(ends, prepend=0) < 3).any() or ends[-1] != len(flat):
            raise self.wrong("its list is cut or damaged")
        return flat, ends

    def _list(
        self, begin: int, kind: np.dtype, width: int, wanted: int | None = None
    ) -> tuple[np.ndarray, int]:
        """Values of a list that begins there, and where it ends; wanted: how many it must have, if that is known."""
        if not self.binary:
            count, values = self._text(begin, width > 1, wanted)
            if len(values) != count * width:
                raise self.wrong(f"its list has {len(values) / width:.6g} of {count} entries; is it whole?")
            return values, len(self.body)
        head = LIST.match(self.body, begin)
        if head is None:
            raise self.wrong("has no list")
        self._require(int(head[1]), wanted)
        size = int(head[1]) * width * kind.itemsize
        if head[2] == b"{":  # one value for all
            one = (
                np.frombuffer(self.body, kind, width, head.end())
                if len(self.body) > head.end() + 64
                else None
            )
            if one is None or (wanted is None and int(head[1]) > MOST_EQUAL):
                raise self.wrong("its list is cut or damaged")
            return np.tile(one, int(head[1])), head.end() + width * kind.itemsize + 1
        if self.body[head.end() + size : head.end() + size + 1] != b")":
            raise self.wrong(f"its list of {int(head[1])} entries is cut or damaged")
        return np.frombuffer(self.body, kind, int(head[1]) * width, head.end()), head.end() + size + 1

    def _require(self, count: int, wanted: int | None) -> None:
        if wanted is not None and count != wanted:
            raise self.wrong(f"has {count} values, but the mesh has {wanted} cells")

    def _text(self, begin: int, nested: bool, wanted: int | None = None) -> tuple[int, np.ndarray]:
        """How many entries a list of text has, and all its numbers."""
        head = LIST.match(self.body, begin)
        if head is None or head[2] != b"(":
            raise self.wrong("has no list")
        count = int(head[1])
        self._require(count, wanted)
        if re.compile(rb"\s*\)").match(self.body, head.end()):
            return count, np.empty(0)
        end = ENDS[nested].search(self.body, head.end())
        if end is None:
            raise self.wrong("its list is cut")
        values = _numbers(self.body[head.end() : end.start()])
        if values is None:
            raise self.wrong("its list holds what is no number")
        return count, values


def _numbers(text: bytes) -> np.ndarray | None:
    """Numbers between blanks and parentheses, None where there is something else; neither slow nor large."""
    text = text.translate(BLANK)
    if not text.strip():
        return np.empty(0)
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # until NumPy 2.2, in place of the error
        try:
            return np.fromstring(text, sep=" ")
        except (ValueError, DeprecationWarning):
            return None


def _there(path: Path) -> bool:
    return os.path.isfile(path) or os.path.isfile(path.with_name(f"{path.name}.gz"))


def _file(path: Path) -> Path:
    return path if os.path.isfile(path) else path.with_name(f"{path.name}.gz")


def _open(path: Path) -> _Foam:
    """A file, or the one with .gz at its end."""
    path = _file(path) if _there(path) else path
    try:
        content = read_regular(path, LARGEST_FILE)
        if content is not None and content[:2] == b"\x1f\x8b":
            unpacked = zlib.decompressobj(31)
            content = unpacked.decompress(content, min(LARGEST_FILE, max(UNPACKED, TIGHTEST * len(content))))
            content = content if unpacked.eof else None
    except OSError as error:
        raise WindFileError(f"{path}: cannot be read: {error.strerror or error}") from None
    except zlib.error:
        raise WindFileError(f"{path}: is damaged: it cannot be unpacked") from None
    if content is None:
        raise WindFileError(
            f"{path}: is cut, or has more than {LARGEST_FILE >> 20} MiB, or of a small packed file {UNPACKED >> 20} MiB"
        )
    header = HEADER.match(content, _after_comments(content, 0))
    if header is None:
        raise WindFileError(f"{path}: is no file of OpenFOAM: it does not begin with FoamFile")
    keys = _keys(COMMENT.sub(b"", header[1]))
    arch = keys.get("arch", "")
    order = ">" if "MSB" in arch else "<"
    label, scalar = (re.search(rf"{name}=(\d+)", arch) for name in ("label", "scalar"))
    found = {"32": 4, "64": 8}
    kinds = [
        np.dtype(f"{order}{letter}{found.get(match[1] if match else default, 8)}")
        for letter, match, default in (("i", label, "32"), ("f", scalar, "64"))
    ]
    binary = keys.get("format") == "binary"
    body = content[_after_comments(content, header.end()) :]
    body = body if binary else COMMENT.sub(b"", body)
    return _Foam(path, body, binary, kinds[0], kinds[1], keys.get("class", ""))


def _after_comments(content: bytes, at: int) -> int:
    """Return the position after the blanks and comments that begin at a position."""
    while skipped := SKIPPED.match(content, at):
        at = skipped.end()
    return at


def _keys(header: bytes) -> dict[str, str]:
    """The entries `key value;` of a header, those that are whole."""
    keys: dict[str, str] = {}
    words: list[str] = []
    for quoted, end, word in WORD.findall(header):
        if not end:
            words.append((quoted or word).decode("ascii", "replace"))
            continue
        if len(words) > 1:
            keys[words[0]] = " ".join(words[1:])
        words = []
    return keys


def _field(path: Path, width: int, cells: int) -> np.ndarray:
    """The values of a field in the cells, (cells, width)."""
    file = _open(path)
    inner = FIELD.search(file.body)
    if inner is None:
        raise file.wrong("has no internalField")
    if inner[1] is not None:
        values = _numbers(inner[1])
        if values is None or len(values) != width or not np.isfinite(values).all():
            raise file.wrong(f"its internalField must be {width} numbers")
        return np.tile(values, (cells, 1))
    if not cells and re.compile(rb"\s*+0\s*+;").match(file.body, inner.end()):
        return np.empty((0, width))
    return file.numbers(width, inner.end(), cells)
