"""PLY mesh files, text or binary: a header that lists elements and their counts, then exactly these elements.

trimesh is not used: it refuses binary files whose lists differ in length (triangles and quads) and comments in Latin-1,
and cuts every polygon into a fan, even if the polygon is not convex.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from taichi_plume.grid.polygons import DamagedError, triangulated
from taichi_plume.guard.terminal import LONGEST_VALUE, visible

MOST_UNLIKE = 2_000_000  # values and lists in rows that are read one by one
LONGEST_HEADER = 1 << 16  # bytes
TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"}
TYPES |= {"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"}
TYPES |= {f"{sign}int{8 * size}": f"{sign or 'i'}{size}" for sign in ("", "u") for size in (1, 2, 4)}
FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
CORNERS = ("vertex_indices", "vertex_index")


@dataclass
class Element:
    """Table of `count` rows; properties: name, type of a list's length (None for a single value), type of values."""

    name: str
    count: int
    properties: list[tuple[str, np.dtype | None, np.dtype]] = field(default_factory=list)


def read_ply(content: bytes) -> tuple[np.ndarray, np.ndarray, int]:
    """Return vertices (n, 3), triangles (m, 3) of their indices, and the bytes of padding. Raises DamagedError."""
    head = content[:LONGEST_HEADER]
    start = re.match(rb"ply[ \t\r]*\n", head)
    found = start and re.compile(rb"\nend_header[ \t]*\r?\n").search(head, start.end() - 1)
    if not start or not found:
        raise DamagedError("is cut or damaged: has no header from 'ply' to 'end_header'")
    order, elements = _header(head[start.end() : found.start() + 1].decode("ascii", "replace"))
    properties = [(element.name, *values) for element in elements for values in element.properties]
    is_list = {(of, name): length is not None for of, name, length, _ in properties}
    if any(is_list.get(("vertex", axis), True) for axis in "xyz"):
        raise DamagedError("its vertices have no x, y, z")
    corners = next((name for name in CORNERS if is_list.get(("face", name))), None)
    if corners is None:
        raise DamagedError("its faces have no vertex_indices")
    rest = memoryview(content)[found.end() :]
    words = re.finditer(rb"[^\s\0\x1a]+", rest)
    body = _Body(rest if order else numbers(word[0] for word in words).data.cast("B"))
    columns = {element.name: body.columns(element) for element in elements}
    left = body.left() if order else 0
    if body.left() and not (order and is_padding(rest[body.at :], body.row)):
        more = f"{body.left()} bytes" if order else f"{body.left() // 8} numbers"
        raise DamagedError(f"is damaged: holds {more} more than its header announces")
    vertices = np.stack([columns["vertex"][axis].astype(float) for axis in "xyz"], axis=-1)
    return vertices, _triangles(vertices, columns["face"][corners]), left


def is_padding(rest: bytes | memoryview, row: float) -> bool:
    """Return whether the bytes after the last row of a table are padding: blank or null, or fewer than a row has."""
    return len(rest) < row or not bytes(rest).strip(b"\0\x1a \t\r\n")


def _header(text: str) -> tuple[str, list[Element]]:
    """Return the byte order ("" for a text file) and the elements of a PLY header. Numbers of a text are float64."""
    order, elements = None, []
    for line in text.splitlines():
        match line.split():
            case [] | ["comment" | "obj_info", *_]:
                pass
            case ["format", kind, "1.0"] if kind in FORMATS and order is None:
                order = FORMATS[kind]
            case ["element", name, count] if re.fullmatch(r"[0-9]{1,12}", count):
                elements.append(Element(name, int(count)))
            case ["property", *length, kind, name] if elements and _is_type(length, kind):
                types = [np.dtype(order + TYPES[name] if order else "f8") for name in (*length[1:], kind)]
                elements[-1].properties.append((name, types[0] if length else None, types[-1]))
            case _:
                raise DamagedError(f"is damaged: its header has '{visible(line.strip(), LONGEST_VALUE)}'")
    if order is None:
        raise DamagedError("is damaged: its header has no format")
    for element in elements:
        if len({name for name, _, _ in element.properties}) < len(element.properties):
            name = visible(element.name, 40)
            raise DamagedError(f"is damaged: its header has two properties of {name} of one name")
    if len({element.name for element in elements}) < len(elements):
        raise DamagedError("is damaged: its header has two elements of one name")
    return order, elements


def _is_type(length: list[str], kind: str) -> bool:
    """Return whether the type of a PLY property is valid: a known type, or 'list' and two known types."""
    return kind in TYPES and (not length or (len(length) == 2 and length[0] == "list" and length[1] in TYPES))


def _triangles(vertices: np.ndarray, polygons: np.ndarray | list[np.ndarray]) -> np.ndarray:
    if not len(polygons):
        return np.empty((0, 3), int)
    corners = polygons.ravel() if isinstance(polygons, np.ndarray) else np.concatenate(polygons)
    if not ((corners >= 0) & (corners < len(vertices)) & (corners == np.floor(corners))).all():
        raise DamagedError(f"is damaged: a face has a corner that is none of the {len(vertices)} vertices")
    if min(len(polygon) for polygon in polygons) < 3:
        raise DamagedError("is damaged: a face has fewer than three corners")
    if isinstance(polygons, np.ndarray) and polygons.shape[1] == 3:
        return polygons.astype(int)
    return triangulated(vertices, [[int(n) for n in polygon] for polygon in polygons])


def numbers(words: Iterable[str | bytes]) -> np.ndarray:
    """Return an array of the numbers that the words of a text represent. Raises DamagedError."""
    try:
        return np.fromiter(map(float, words), float)
    except ValueError as error:
        raise DamagedError(f"is damaged: {visible(error, LONGEST_VALUE)}") from None


class _Body:
    """Reader of the values that follow the header of a PLY file, one element after the other.

    row: mean size of the rows of the last element [bytes].
    """

    def __init__(self, content: memoryview):
        self.content, self.at, self.row = content, 0, 0.0

    def left(self) -> int:
        """Return the number of bytes of the file that have not been read yet."""
        return len(self.content) - self.at

    def columns(self, element: Element) -> dict[str, Any]:
        """Return an element's values by property: (count,), lists (count, length), or a list of arrays if unlike."""
        if not element.count or not element.properties:
            return {name: np.empty(0 if length is None else (0, 3)) for name, length, _ in element.properties}
        least = sum((kind if length is None else length).itemsize for _, length, kind in element.properties)
        if element.count * least > self.left():
            raise self._cut(element)
        begin = self.at
        first = self._row(element)
        fields: list[tuple] = []
        for n, (_, length, kind) in enumerate(element.properties):
            if length is None:
                fields.append((str(n), kind))
            else:
                fields += [(f"length {n}", length), (str(n), kind, (first[n].size,))]
        row = np.dtype(fields)
        if element.count * row.itemsize <= len(self.content) - begin:
            rows = np.frombuffer(self.content, row, element.count, begin)
            if all((rows[name] == rows[name][0]).all() for name, *_ in fields if name.startswith("length")):
                self.at, self.row = begin + rows.nbytes, row.itemsize
                return {name: rows[str(n)] for n, (name, _, _) in enumerate(element.properties)}
        if element.count * len(element.properties) > MOST_UNLIKE:
            raise DamagedError(f"has more than {MOST_UNLIKE:,} values in rows with lists of unlike lengths")
        table = [first, *(self._row(element) for _ in range(element.count - 1))]
        self.row = (self.at - begin) / element.count
        columns = zip(element.properties, zip(*table, strict=True), strict=True)
        return {
            name: np.concatenate(column) if length is None else list(column)
            for (name, length, _), column in columns
        }

    def _row(self, element: Element) -> list[np.ndarray]:
        """Read the next row of an element; return the values of each property as an array."""
        row = []
        for _, length, kind in element.properties:
            count = 1.0 if length is None else float(self._take(length, 1, element)[0])
            if count < 0 or not count.is_integer():
                raise DamagedError("is damaged: the length of a list is no whole number")
            row.append(self._take(kind, int(count), element))
        return row

    def _take(self, kind: np.dtype, count: int, element: Element) -> np.ndarray:
        begin, end = self.at, self.at + count * kind.itemsize
        if end > len(self.content):
            raise self._cut(element)
        self.at = end
        return np.frombuffer(self.content[begin:end], kind)

    def _cut(self, element: Element) -> DamagedError:
        return DamagedError(
            f"is cut or damaged: its header announces {element.count} rows of {visible(element.name, 40)}, fewer follow"
        )
