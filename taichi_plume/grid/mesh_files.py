"""Triangle meshes of STL, OBJ and PLY files: read whole, with every count and index in range, or rejected.

Libraries read parts of a damaged file, and open3d ends the process at an index out of range. Size and grammar of an STL
file can be checked; an OBJ file has no counts, so bodies missing at the end of the file are not detected.

A byte order mark at the start and padding at the end are skipped. No format has a unit: comments that name one are only
reported.
"""

import codecs
import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taichi_plume.grid.ply_files import is_padding, numbers, read_ply
from taichi_plume.grid.polygons import DamagedError, triangulated
from taichi_plume.grid.shapes import ShapeError
from taichi_plume.guard.safe_open import content_of
from taichi_plume.guard.terminal import LONGEST_VALUE, visible
from taichi_plume.quantities import conversion

LARGEST_FILE = 1 << 26  # bytes: a million triangles and more
FARTHEST = 1e9  # in the file's units: larger numbers are damage
SOLID, END = re.compile(r"\s*solid\b[^\n]*\n"), re.compile(r"\s*endsolid\b[^\n]*")
FACET = re.compile(
    r"\s*facet\s+normal\s+\S+\s+\S+\s+\S+\s+outer\s+loop"
    + 3 * r"\s+vertex\s+(\S+)\s+(\S+)\s+(\S+)"
    + r"\s+endloop\s+endfacet\b"
)
IGNORED = re.compile("vt|vn|vp|g|o|s|mg|l|p|usemtl|mtllib|usemap|maplib|bevel|lod|[cd]_interp|shadow_obj")

UNIT = re.compile(
    rb"(?:\bunits?\b(?: ?(?:is|are|in|of|length)\b)*[ \t]*[:=]?[ \t]*(?P<size>[0-9.]{1,9})?|\bin(?=[ \t])|[(\[])[ \t]*"
    rb"[\"']?(?P<name>[a-z]{1,12})\b",
    re.IGNORECASE,
)  # units: mm, 1 unit = 1 mm, exported in mm, bench (mm)
COMMENTS = re.compile(rb"^[ \t]*(?:#|comment|obj_info|solid)[^\r\n]*", re.MULTILINE)
STL_HEADER, FACET_BYTES = 80, 50
MOST_COMMENTED = 1 << 16  # bytes in which a unit is looked for


@dataclass(frozen=True)
class MeshData:
    """Content of a mesh file. vertices (n, 3), in the file's unit; triangles (m, 3): indices of vertices.

    unit: metres of a unit that a comment names, and its name; None without. remarks: assumptions.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    unit: tuple[float, str] | None
    remarks: tuple[str, ...]


class MeshError(ShapeError):
    """A mesh file that is missing, unreadable or not closed."""


def read_mesh(path: Path) -> MeshData:
    """Return the vertices and triangles of an STL, OBJ or PLY file. Raises MeshError."""
    content = content_of(path, LARGEST_FILE, MeshError, path.name)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise MeshError(f"{path.name}: its name must end in .stl, .obj or .ply")
    try:
        vertices, triangles, left = reader(content)
    except DamagedError as fault:
        raise MeshError(f"{path.name}: {fault}") from None
    if not len(triangles):
        raise MeshError(f"{path.name}: no triangles in it; STL, OBJ and PLY files are read")
    used = vertices[triangles]
    if not np.isfinite(used).all():
        raise MeshError(f"{path.name}: some coordinates are not finite")
    if np.abs(used).max() > FARTHEST:
        raise MeshError(f"{path.name}: some coordinates are beyond {FARTHEST:g}; is it damaged?")
    remarks = (f"{left} bytes after the last triangle are not read",) if left else ()
    return MeshData(vertices, triangles, _unit(content), remarks)


def _unit(content: bytes) -> tuple[float, str] | None:
    """Return the unit of length that a comment or the header names: its metres and its name; None without one."""
    start = content[:MOST_COMMENTED]
    comments = [start[:STL_HEADER], *COMMENTS.findall(start)]
    for found in (found for comment in comments for found in UNIT.finditer(comment)):
        size, name = (found["size"] or b"").decode(), found["name"].decode()
        with suppress(ValueError):
            if (factor := float(size or 1.0) * conversion(name, "m")[0]) > 0.0:
                return factor, f"{size} {name}".strip()
    return None


# ---------------------------------------------------------------- STL


def _stl(content: bytes) -> tuple[np.ndarray, np.ndarray, int]:
    content = content.removeprefix(codecs.BOM_UTF8)
    count = int.from_bytes(content[80:84], "little") if len(content) >= 84 else -1
    end = 84 + FACET_BYTES * count
    left = 0
    rest = content[end:]
    padded = count > 0 and bool(rest) and (is_padding(rest, FACET_BYTES) or len(rest) % FACET_BYTES != 0)
    if padded or (count >= 0 and len(content) == end):
        facets = np.frombuffer(content, [("f", "<f4", (4, 3)), ("attribute", "<u2")], count, 84)
        corners, left = facets["f"][:, 1:].reshape(-1, 3).astype(float), len(content) - end
    elif (text := _text(content))[:1000].lstrip()[:5].lower() == "solid":
        corners = _facets(text)
    elif count < 0:
        raise DamagedError("is cut: no STL file is so short")
    else:
        there = (len(content) - 84) / 50
        raise DamagedError(f"is cut or damaged: its header announces {count} triangles, it holds {there:.6g}")
    return corners, np.arange(len(corners)).reshape(-1, 3), left


def _facets(text: str) -> np.ndarray:
    """Return the corners (3 m, 3) of the m triangles of an STL text file. Raises DamagedError."""
    text, at, ended = text.lower(), 0, True
    words: list[str] = []
    while ended and (solid := SOLID.match(text, at)):
        at = solid.end()
        while facet := FACET.match(text, at):
            words += facet.groups()
            at = facet.end()
        end = END.match(text, at)
        ended, at = end is not None, end.end() if end else at
    rest = " ".join(text[at : at + 1000].split())
    if rest or not ended:
        raise DamagedError(f"is cut or damaged: after {len(words) // 9} facets comes '{visible(rest, 60)}'")
    return numbers(words).reshape(-1, 3)


# ---------------------------------------------------------------- OBJ


def _obj(content: bytes) -> tuple[np.ndarray, np.ndarray, int]:
    text = _text(content).replace("\\\n", " ")
    coordinates: list[str] = []
    polygons: list[list[int]] = []
    for line, row in enumerate(text.splitlines(), 1):
        key, *words = row.partition("#")[0].split() or ("",)
        if key == "v":
            if len(words) < 3:
                raise DamagedError(f"line {line}: a vertex has three coordinates")
            coordinates += words[:3]
        elif key == "f":
            polygons.append([_index(word, len(coordinates) // 3, line) for word in words])
            if len(words) < 3:
                raise DamagedError(f"line {line}: a face has three corners or more")
        elif key and not IGNORED.fullmatch(key):
            raise DamagedError(
                f"line {line}: '{visible(key, LONGEST_VALUE)}' is no key of a mesh of vertices and faces"
            )
    vertices = numbers(coordinates).reshape(-1, 3)
    highest = max((max(polygon) for polygon in polygons), default=-1)
    if highest >= len(vertices):
        raise DamagedError(f"is cut or damaged: a face has vertex {highest + 1} of {len(vertices)}")
    return vertices, triangulated(vertices, polygons), 0


def _index(word: str, count: int, line: int) -> int:
    """Return the index from 0 on of a face's corner in OBJ: 3, 3/1, 3//2, or -1 for the last of `count` vertices."""
    number = word.partition("/")[0]
    if not re.fullmatch(r"-?[0-9]{1,15}", number):
        raise DamagedError(f"line {line}: '{visible(word, LONGEST_VALUE)}' is no corner of a face")
    index = int(number)
    index = index - 1 if index > 0 else count + index if index < 0 else -1
    if index < 0:
        raise DamagedError(f"line {line}: '{word}' is no corner of a face, which are counted from 1")
    return index


def _text(content: bytes) -> str:
    r"""Return the text of a mesh file with line ends "\n"; bytes that are not UTF-8 are replaced.

    A byte order mark (UTF-8 or UTF-16), and null bytes and an end-of-file character (Ctrl-Z) at the end are left out.
    """
    wide = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    text = content.decode("utf-16" if wide else "utf-8-sig", "replace").rstrip("\0\x1a \t\r\n")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _ply(content: bytes) -> tuple[np.ndarray, np.ndarray, int]:
    wide = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    return read_ply(_text(content).encode() if wide else content.removeprefix(codecs.BOM_UTF8))


READERS = {".stl": _stl, ".obj": _obj, ".ply": _ply}
