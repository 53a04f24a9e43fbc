"""PLY files, of text or binary: a header that tells what there is, then just that."""

import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from taichi_plume.grid.polygons import DamagedError, triangulated
from taichi_plume.guard.terminal import LONGEST_VALUE, visible

MOST_UNLIKE = 2_000_000  # rows that are read one by one
LONGEST_HEADER = 1 << 16  # bytes
TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
CORNERS = ("vertex_indices", "vertex_index")


@dataclass
class Element:
    """`count` rows of properties: name, type of the number of values of a list, or "", type of the values."""

    name: str
    count: int
    properties: list[tuple[str, str, str]] = field(default_factory=list)


def read_ply(content: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) and triangles (m, 3), indices of them. Raises DamagedError."""
    head = content[:LONGEST_HEADER]
    start = re.match(rb"ply[ \t\r]*\n", head)
    found = start and re.compile(rb"\nend_header[ \t]*\r?\n").search(head, start.end() - 1)
    if not start or not found:
        raise DamagedError("is cut or damaged: has no header from 'ply' to 'end_header'")
    order, elements = _header(head[start.end() : found.start() + 1].decode("ascii", "replace"))
    body: _Words | _Bytes = _Bytes(content[found.end() :], order) if order else _Words(content[found.end() :])
    vertices, polygons = None, None
    for element in elements:
        columns = body.take(element)
        if element.name == "vertex":
            if not {"x", "y", "z"} <= columns.keys() or any(
                c for n, c, _ in element.properties if n in "xyz"
            ):
                raise DamagedError("its vertices have no x, y, z")
            vertices = np.stack([columns[axis].astype(float) for axis in "xyz"], axis=-1)
        elif element.name == "face":
            lists = [name for name, counted, _ in element.properties if counted and name in CORNERS]
            if not lists:
                raise DamagedError("its faces have no vertex_indices")
            polygons = columns[lists[0]]
    body.end()
    if vertices is None or polygons is None:
        raise DamagedError("has no vertices or no faces")
    return vertices, _triangles(vertices, polygons)


def _header(text: str) -> tuple[str, list[Element]]:
    """The order of bytes, "" of text, and what follows."""
    order, elements = None, []
    for line in text.splitlines():
        match line.split():
            case [] | ["comment" | "obj_info", *_]:
                pass
            case ["format", kind, "1.0"] if kind in FORMATS and order is None:
                order = FORMATS[kind]
            case ["element", name, count] if re.fullmatch(r"[0-9]{1,12}", count):
                elements.append(Element(name, int(count)))
            case ["property", "list", counted, kind, name] if elements and {counted, kind} <= TYPES.keys():
                elements[-1].properties.append((name, TYPES[counted], TYPES[kind]))
            case ["property", kind, name] if elements and kind in TYPES:
                elements[-1].properties.append((name, "", TYPES[kind]))
            case _:
                raise DamagedError(f"is damaged: its header has '{visible(line.strip(), LONGEST_VALUE)}'")
    if order is None:
        raise DamagedError("is damaged: its header has no format")
    for element in elements:
        names = [name for name, _, _ in element.properties]
        if len(set(names)) < len(names):
            raise DamagedError(
                f"is damaged: its header has two properties of {visible(element.name, 40)} of one name"
            )
    if len({element.name for element in elements}) < len(elements):
        raise DamagedError("is damaged: its header has two elements of one name")
    return order, elements


def _triangles(vertices: np.ndarray, polygons: Any) -> np.ndarray:
    if isinstance(polygons, np.ndarray):
        wrong = polygons.size and not ((polygons >= 0) & (polygons < len(vertices))).all()
        sizes = {polygons.shape[1]}
    else:
        wrong = any(((one < 0) | (one >= len(vertices))).any() for one in polygons)
        sizes = {len(one) for one in polygons}
    if wrong:
        raise DamagedError(f"is damaged: a face has a corner that is none of the {len(vertices)} vertices")
    if len(polygons) and min(sizes) < 3:
        raise DamagedError("is damaged: a face has fewer than three corners")
    if sizes == {3}:
        return np.asarray(polygons, int)
    return triangulated(vertices, [[int(n) for n in one] for one in polygons])


# ---------------------------------------------------------------- what follows the header


class _Body:
    """Rows one after the other. Of lists of one length for all rows a column is (rows, length), else a list of them."""

    def __init__(self) -> None:
        self.at = 0

    def take(self, element: Element) -> dict[str, Any]:
        """The columns of the next element."""
        if not element.count or not element.properties:
            return {name: np.empty((0, 3) if counted else 0) for name, counted, _ in element.properties}
        if element.count > self.left():
            raise self.cut(element)
        return self.alike(element) or self.one_by_one(element)

    def left(self) -> int:
        """The most rows that there may be."""
        raise NotImplementedError

    def alike(self, element: Element) -> dict[str, Any] | None:
        """The columns, if all rows have lists as long as the first one's."""
        raise NotImplementedError

    def one_by_one(self, element: Element) -> dict[str, Any]:
        """The columns, row by row."""
        if element.count > MOST_UNLIKE:
            raise DamagedError(f"has more than {MOST_UNLIKE:,} rows with lists of unlike lengths")
        columns: dict[str, list[Any]] = {name: [] for name, _, _ in element.properties}
        for _ in range(element.count):
            for name, counted, kind in element.properties:
                length = self.length(counted, element) if counted else None
                values = self.values(kind, 1 if length is None else length, element)
                columns[name].append(values[0] if length is None else values)
        lists = {name for name, counted, _ in element.properties if counted}
        return {name: one if name in lists else np.array(one) for name, one in columns.items()}

    def length(self, counted: str, element: Element) -> int:
        """How long the next list is."""
        return whole(self.values(counted, 1, element)[0])

    def values(self, kind: str, count: int, element: Element) -> np.ndarray:
        """The next values."""
        raise NotImplementedError

    def cut(self, element: Element) -> DamagedError:
        """What is wrong where there are too few rows."""
        return DamagedError(
            f"is cut or damaged: its header tells of {element.count} rows of {visible(element.name, 40)}, fewer follow"
        )


class _Bytes(_Body):
    def __init__(self, content: bytes, order: str):
        super().__init__()
        self.content, self.order = content, order

    def left(self) -> int:
        return len(self.content) - self.at

    def values(self, kind: str, count: int, element: Element) -> np.ndarray:
        dtype = np.dtype(self.order + kind)
        if count * dtype.itemsize > self.left():
            raise self.cut(element)
        found = np.frombuffer(self.content, dtype, count, self.at)
        self.at += count * dtype.itemsize
        return found

    def alike(self, element: Element) -> dict[str, Any] | None:
        begin, parts = self.at, []
        for n, (_, counted, kind) in enumerate(element.properties):
            if counted:
                length = self.length(counted, element)
                parts += [(f"n{n}", self.order + counted), (f"v{n}", self.order + kind, (length,))]
                self.values(kind, length, element)
            else:
                parts.append((f"v{n}", self.order + kind))
                self.values(kind, 1, element)
        self.at, row = begin, np.dtype(parts)
        if element.count * row.itemsize > self.left():
            return None
        rows = np.frombuffer(self.content, row, element.count, begin)
        columns = {}
        for n, (name, counted, _) in enumerate(element.properties):
            if counted and not (rows[f"n{n}"] == rows[f"n{n}"][0]).all():
                return None
            columns[name] = rows[f"v{n}"]
        self.at += element.count * row.itemsize
        return columns

    def end(self) -> None:
        if self.left():
            raise DamagedError(f"is damaged: holds {self.left()} bytes more than its header tells of")


class _Words(_Body):
    def __init__(self, content: bytes):
        super().__init__()
        words = (found[0] for found in re.finditer(rb"\S+", content))
        try:
            self.numbers = np.fromiter(map(float, words), float)
        except ValueError as error:
            raise DamagedError(f"is damaged: {visible(error, LONGEST_VALUE)}") from None

    def left(self) -> int:
        return len(self.numbers) - self.at

    def values(self, kind: str, count: int, element: Element) -> np.ndarray:
        if count > self.left():
            raise self.cut(element)
        self.at += count
        return _of(kind, self.numbers[self.at - count : self.at])

    def alike(self, element: Element) -> dict[str, Any] | None:
        begin, places = self.at, []
        for _, counted, kind in element.properties:
            length = self.length(counted, element) if counted else 1
            self.values(kind, length, element)
            places.append((self.at - begin - length, length))
        width, self.at = self.at - begin, begin
        if element.count * width > self.left():
            return None
        rows = self.numbers[begin : begin + element.count * width].reshape(element.count, width)
        columns = {}
        for (name, counted, kind), (first, length) in zip(element.properties, places, strict=True):
            if counted and not (rows[:, first - 1] == length).all():
                return None
            columns[name] = _of(kind, rows[:, first : first + length] if counted else rows[:, first])
        self.at += element.count * width
        return columns

    def end(self) -> None:
        if self.left():
            raise DamagedError(f"is damaged: holds {self.left()} numbers more than its header tells of")


def _of(kind: str, numbers: np.ndarray) -> np.ndarray:
    """Numbers of a text as values of that type; those of whole numbers have to be ones."""
    if kind[0] != "f" and not (np.isfinite(numbers) & (numbers == np.round(numbers))).all():
        raise DamagedError("is damaged: holds a fraction where a whole number has to be")
    return numbers


def whole(number: Any) -> int:
    """The length of a list."""
    if not (np.isfinite(number) and number >= 0 and number == int(number)):
        raise DamagedError("is damaged: the length of a list is no whole number")
    return int(number)
