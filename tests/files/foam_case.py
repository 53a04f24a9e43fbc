"""OpenFOAM's case folders as the tests make them: any mesh of cells with faces, as text, binary or gzipped."""

import gzip
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

Cell = Sequence[Sequence[int]]
"""A cell as the corners of its faces, each seen from outside against the clock."""


def box(n: Sequence[int], place) -> tuple[np.ndarray, list[Cell]]:
    """A block of n hexahedra per axis; place takes (..., 3) in the unit cube to its points."""
    axes = [np.linspace(0.0, 1.0, m + 1) for m in n]
    points = place(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)).reshape(-1, 3)

    def corner(*index: int) -> int:
        return int(np.ravel_multi_index(index, [m + 1 for m in n]))

    cells = []
    for i, j, k in np.ndindex(*n):
        a = [[[corner(i + x, j + y, k + z) for z in (0, 1)] for y in (0, 1)] for x in (0, 1)]
        cells.append(
            prism(
                [a[0][0][0], a[1][0][0], a[1][1][0], a[0][1][0]],
                [a[0][0][1], a[1][0][1], a[1][1][1], a[0][1][1]],
            )
        )
    return points, cells


def prism(below: Sequence[int], above: Sequence[int]) -> Cell:
    """The cell between two polygons, both against the clock seen from above."""
    sides = [
        [below[n], below[(n + 1) % len(below)], above[(n + 1) % len(above)], above[n]]
        for n in range(len(below))
    ]
    return [list(reversed(below)), list(above), *sides]


class Writer:
    """Writes files of a case."""

    def __init__(self, folder: Path, binary: bool = False, packed: bool = False, region: str = ""):
        self.folder, self.binary, self.packed, self.region = folder, binary, packed, region

    def write(self, name: str, kind: str, body: bytes) -> None:
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        head = (
            "/*--- made by a test ---*/\nFoamFile\n{\n    version     2.0;\n"
            f"    format      {'binary' if self.binary else 'ascii'};\n"
            '    arch        "LSB;label=32;scalar=64";\n'
            f"    class       {kind};\n    object      {path.name};\n}}\n// * * * * //\n\n"
        )
        content = head.encode() + body + b"\n\n// ***** //\n"
        if self.packed:
            path.with_name(f"{path.name}.gz").write_bytes(gzip.compress(content))
        else:
            path.write_bytes(content)

    def listed(self, values: np.ndarray) -> bytes:
        """A list of integers, scalars or vectors; without entries as OpenFOAM writes it in binary files."""
        if not len(values):
            return b"0" if self.binary else b"0\n(\n)"
        if self.binary:
            kind = "<i4" if values.dtype.kind == "i" else "<f8"
            return f"{len(values)}\n(".encode() + values.astype(kind).tobytes() + b")"
        rows = values.tolist()
        texts = [f"({' '.join(map(repr, row))})" if isinstance(row, list) else repr(row) for row in rows]
        return "\n".join([str(len(rows)), "(", *texts, ")"]).encode()

    def mesh(self, points: np.ndarray, cells: list[Cell]) -> None:
        """Inner faces first, in the order of their owners, then those of one patch."""
        known: dict[frozenset[int], tuple[int, Sequence[int], int]] = {}
        for n, cell in enumerate(cells):
            for face in cell:
                key = frozenset(face)
                known[key] = (known[key][0], known[key][1], n) if key in known else (n, face, -1)
        faces = sorted((one for one in known.values() if one[2] >= 0), key=lambda one: (one[0], one[2]))
        inner = len(faces)
        faces += [one for one in known.values() if one[2] < 0]
        place = str(Path("constant") / self.region / "polyMesh") + "/"
        self.write(f"{place}points", "vectorField", self.listed(points))
        if self.binary:
            ends = np.cumsum([0, *(len(face) for _, face, _ in faces)])
            flat = np.array([corner for _, face, _ in faces for corner in face], int)
            self.write(f"{place}faces", "faceCompactList", self.listed(ends) + b"\n\n" + self.listed(flat))
        else:
            lines = [f"{len(face)}({' '.join(map(str, face))})" for _, face, _ in faces]
            self.write(f"{place}faces", "faceList", "\n".join([str(len(faces)), "(", *lines, ")"]).encode())
        self.write(f"{place}owner", "labelList", self.listed(np.array([one[0] for one in faces])))
        self.write(
            f"{place}neighbour", "labelList", self.listed(np.array([one[2] for one in faces[:inner]], int))
        )
        patch = f"1\n(\n    walls {{ type wall; nFaces {len(faces) - inner}; startFace {inner}; }}\n)"
        binary, self.binary = self.binary, False
        self.write(f"{place}boundary", "polyBoundaryMesh", patch.encode())
        self.binary = binary

    def raw_field(self, time: str, name: str, inner: str, dimensions: str = "0 1 -1 0 0 0 0") -> None:
        """A field whose internalField is written as given."""
        text = f"dimensions [{dimensions}];\ninternalField {inner};\nboundaryField\n{{\n}}\n"
        self.write(str(Path(time) / self.region / name), "volVectorField", text.encode())

    def field(self, time: str, name: str, values: np.ndarray, uniform: bool = False) -> None:
        """Of the cells: (n, 3) or (n,)."""
        kind = "vector" if values.ndim == 2 else "scalar"
        if uniform:
            inner = f"uniform ({' '.join(map(repr, values[0].tolist()))})".encode()
        else:
            inner = f"nonuniform List<{kind}> \n".encode() + self.listed(values) + b"\n"
        length = 1 if values.ndim == 2 else 2  # m/s; m^2/s of nut
        body = f"dimensions [0 {length} -1 0 0 0 0];\n\ninternalField   ".encode() + inner
        body += b";\n\nboundaryField\n{\n    walls { type zeroGradient; }\n}"
        self.write(str(Path(time) / self.region / name), f"vol{kind.title()}Field", body)


def decomposed(
    folder: Path, points: np.ndarray, cells: list[Cell], parts: Sequence[np.ndarray], **keys: Any
) -> list[Writer]:
    """The meshes of the processors, whose cells have these numbers."""
    writers = []
    for n, part in enumerate(parts):
        mine = [cells[one] for one in part]
        used = sorted({corner for cell in mine for face in cell for corner in face})
        number = {corner: m for m, corner in enumerate(used)}
        writers.append(Writer(folder / f"processor{n}", **keys))
        writers[-1].mesh(
            points[used].reshape(-1, 3), [[[number[c] for c in face] for face in cell] for cell in mine]
        )
    return writers
