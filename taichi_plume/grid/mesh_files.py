"""Meshes of STL, OBJ and PLY files: read whole, with every count and index in range, or not at all.

Libraries read what they can of a damaged file, and the one for distances ends the process with an index out of range.
STL has no more to check than its size and grammar, OBJ not even a count: a body may be missing from the end of one.
"""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from taichi_plume.grid.ply_files import read_ply
from taichi_plume.grid.polygons import DamagedError, triangulated
from taichi_plume.grid.shapes import ShapeError
from taichi_plume.guard.opening import read_regular
from taichi_plume.guard.terminal import LONGEST_VALUE, visible

LARGEST_FILE = 1 << 26  # bytes: a million triangles and more
FARTHEST = 1e9  # in the file's units: farther is a number read wrongly
VERTEX = ["vertex", "#", "#", "#"]
FACET = ["facet", "normal", "#", "#", "#", "outer", "loop", *VERTEX, *VERTEX, *VERTEX, "endloop", "endfacet"]
IGNORED = re.compile("vt|vn|vp|g|o|s|mg|l|p|usemtl|mtllib|usemap|maplib|bevel|lod|[cd]_interp|shadow_obj")


class MeshError(ShapeError):
    """A mesh file that is missing, unreadable or not closed."""


def read_mesh(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3), as in the file, and triangles (m, 3), indices of them. Raises MeshError."""
    try:
        content = read_regular(path, LARGEST_FILE)
    except IsADirectoryError:
        raise MeshError(f"{path.name}: is a folder; give an STL, OBJ or PLY file in it") from None
    except FileNotFoundError:
        raise MeshError(f"{path.name}: no such file in {path.parent}") from None
    except OSError as error:
        raise MeshError(f"{path.name}: cannot be read: {error.strerror or error}") from None
    if content is None:
        raise MeshError(f"{path.name}: is too large; {LARGEST_FILE >> 20} MiB are read")
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise MeshError(f"{path.name}: its name must end in .stl, .obj or .ply")
    try:
        vertices, triangles = reader(content)
    except DamagedError as fault:
        raise MeshError(f"{path.name}: {fault}") from None
    if not len(triangles):
        raise MeshError(f"{path.name}: no triangles in it; STL, OBJ and PLY files are read")
    used = vertices[triangles]
    if not np.isfinite(used).all():
        raise MeshError(f"{path.name}: some coordinates are not finite")
    if np.abs(used).max() > FARTHEST:
        raise MeshError(f"{path.name}: some coordinates are beyond {FARTHEST:g}; is it damaged?")
    return vertices, triangles


# ---------------------------------------------------------------- STL


def _stl(content: bytes) -> tuple[np.ndarray, np.ndarray]:
    count = int.from_bytes(content[80:84], "little") if len(content) >= 84 else -1
    if count >= 0 and len(content) == 84 + 50 * count:
        facets = np.frombuffer(content, [("f", "<f4", (4, 3)), ("attribute", "<u2")], count, 84)
        corners = facets["f"][:, 1:].reshape(-1, 3).astype(float)
    elif content.lstrip()[:5].lower() == b"solid":
        corners = _facets(content)
    elif count < 0:
        raise DamagedError("is cut: no STL file is so short")
    else:
        there = (len(content) - 84) / 50
        raise DamagedError(f"is cut or damaged: its header tells of {count} triangles, it holds {there:.6g}")
    return corners, np.arange(len(corners)).reshape(-1, 3)


def _facets(content: bytes) -> np.ndarray:
    """The corners (3 m, 3) of an STL file of text."""
    before, *parts = re.split(r"(?m)^[ \t]*((?:end)?solid)\b[^\n]*$", _text(content).lower())
    kinds, bodies = parts[::2], parts[1::2]
    if before.strip() or kinds != ["solid", "endsolid"] * (len(kinds) // 2):
        raise DamagedError("is cut or damaged: not every 'solid' ends with an 'endsolid'")
    if any(text.strip() for text in bodies[1::2]):
        raise DamagedError("is damaged: holds something after an 'endsolid'")
    numbers: list[str] = []
    for text in bodies[::2]:
        words, facets = text.split(), len(text.split()) // len(FACET)
        if len(words) % len(FACET):
            raise DamagedError(f"is cut or damaged: after {facets} facets comes half a one")
        for n, word in enumerate(FACET):
            wrong = (
                next((one for one in words[n :: len(FACET)] if one != word), None) if word != "#" else None
            )
            if wrong is not None:
                raise DamagedError(
                    f"is damaged: holds '{visible(wrong, LONGEST_VALUE)}' in place of '{word}'"
                )
        chosen = [n for n in range(7, len(FACET)) if FACET[n] == "#"]
        numbers += [words[k + n] for k in range(0, len(words), len(FACET)) for n in chosen]
    return _numbers(numbers).reshape(-1, 3)


# ---------------------------------------------------------------- OBJ


def _obj(content: bytes) -> tuple[np.ndarray, np.ndarray]:
    text = _text(content).replace("\\\n", " ")
    numbers: list[str] = []
    polygons: list[list[int]] = []
    count = 0
    for line, row in enumerate(text.splitlines(), 1):
        key, *words = row.partition("#")[0].split() or ("",)
        if key == "v":
            if len(words) < 3:
                raise DamagedError(f"line {line}: a vertex has three coordinates")
            numbers += words[:3]
            count += 1
        elif key == "f":
            polygons.append([_index(word, count, line) for word in words])
            if len(words) < 3:
                raise DamagedError(f"line {line}: a face has three corners or more")
        elif key and not IGNORED.fullmatch(key):
            raise DamagedError(
                f"line {line}: '{visible(key, LONGEST_VALUE)}' is no key of a mesh of vertices and faces"
            )
    highest = max((max(one) for one in polygons), default=-1)
    if highest >= count:
        raise DamagedError(f"is cut or damaged: a face has vertex {highest + 1} of {count}")
    vertices = _numbers(numbers).reshape(-1, 3)
    return vertices, triangulated(vertices, polygons)


def _index(word: str, count: int, line: int) -> int:
    """Index from 0 on of a corner such as 3, 3/1, 3//2 or -1, the last of `count` vertices so far."""
    number = word.partition("/")[0]
    if not re.fullmatch(r"-?[0-9]{1,15}", number):
        raise DamagedError(f"line {line}: '{visible(word, LONGEST_VALUE)}' is no corner of a face")
    index = int(number)
    index = index - 1 if index > 0 else count + index if index < 0 else -1
    if index < 0:
        raise DamagedError(f"line {line}: '{word}' is no corner of a face, which are counted from 1")
    return index


# ---------------------------------------------------------------- words


def _text(content: bytes) -> str:
    """Of comments and names any bytes do; the rest is ASCII."""
    return content.decode("utf-8", "replace").replace("\r\n", "\n").replace("\r", "\n")


def _numbers(words: Sequence[str]) -> np.ndarray:
    try:
        return np.fromiter(map(float, words), float, len(words))
    except ValueError as error:
        raise DamagedError(f"is damaged: {visible(error, LONGEST_VALUE)}") from None


READERS = {".stl": _stl, ".obj": _obj, ".ply": read_ply}
