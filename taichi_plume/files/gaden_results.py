"""A film as GADEN's player reads simulations: cells, wind files and results, all in the folder of a configuration.

    OccupancyGrid3D.csv                          which cells are walls or furniture; see files/gaden.py
    wind/wind_iteration_N                        int32 major and minor version, then float32 u, v, w of each cell
    simulations/SPECIES/result/iteration_N       zlib of what follows, little-endian:
        int32 major, minor version; int32 cells along x, y, z; float32 lower and upper corner [m], edge of a cell [m]
        text "point", float32 position of the source [m], int32 number of the gas
        float32 moles in a filament, moles of air in a cm3; int32 number of the wind file
        text "concentrations", uint64 number of cells, float32 ppm of each

Cells count x first, then y, then z; a text is its length, uint64, and its bytes. This is GADEN 3's form for results of
`preCalculateConcentrations`, in which a cell has a concentration; versions before it know filaments alone, which a film
does not hold. A flat film becomes one layer of cells.
"""

import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_plume.files.run_folder import RunFolderError

if TYPE_CHECKING:
    import xarray

VERSION = (3, 0)
WIND = ("u", "v", "w")
PPM = "_ppm"  # end of the names of concentrations
MOST_BYTES = 5_000_000  # of a result before it is packed: the players' buffer
ROOM = 1000  # bytes of it for what is no concentration
AIR = 101325.0 / (8.314462618 * 298.15) * 1e-6  # mol/cm3, at 25 degC and 1 atm, as ppm are here
NUMBERS = {"ethanol": 0, "methane": 1, "hydrogen": 2, "propanol": 3, "chlorine": 4, "fluorine": 5, "acetone": 6,
           "neon": 7, "helium": 8, "biogas": 9, "butane": 10, "carbon_dioxide": 11, "carbon_monoxide": 12,
           "smoke": 13}  # fmt: skip
OTHER = 0  # shown as ethanol: players know no others


def write(
    folder: Path,
    data: "xarray.Dataset",
    read: Callable[[str, int], np.ndarray],
    sources: Sequence[tuple[str, Sequence[float]]],
) -> Iterator[tuple[int, Path]]:
    """Write the files of a film into a folder that there is; yields bytes and path of each before it is written.

    data: its variables at the cells' middles; read: how to get their values; sources: species and place [m] of each.
    Raises OSError, and RunFolderError where it has no gas or more cells than players take.
    """
    shape = [data.sizes.get(axis, 1) for axis in "xyz"]
    cells, gases = int(np.prod(shape)), [str(name) for name in data.data_vars if str(name).endswith(PPM)]
    if not gases:
        raise RunFolderError(f"{folder}: the film has no gas, of which results are made")
    if 4 * cells > MOST_BYTES - ROOM:
        raise RunFolderError(
            f"{folder}: the film has {cells:,} cells, GADEN's player takes {(MOST_BYTES - ROOM) // 4:,}; run with "
            "larger ones"
        )
    edge = float(data.attrs["spacing"])
    path = folder / "OccupancyGrid3D.csv"
    grid = _occupancy(read("air", 0).reshape(shape[::-1]), shape, edge)
    yield len(grid), path
    path.write_bytes(grid)
    wind = [name for name in WIND if name in data]
    frames = range(data.sizes["time"])
    places = {name: _place(name, sources) for name in gases}
    for part in ("wind", *(f"simulations/{name.removesuffix(PPM)}/result" for name in gases)):
        (folder / part).mkdir(parents=True, exist_ok=True)
    for n in frames:
        if wind:
            vectors = np.zeros((cells, 3), "<f4")
            for d, name in enumerate(wind):
                vectors[:, d] = np.nan_to_num(read(name, n)).ravel()
            path = folder / f"wind/wind_iteration_{n}"
            yield vectors.nbytes, path
            path.write_bytes(struct.pack("<2i", *VERSION) + vectors.tobytes())
        for name in gases:
            ppm = np.maximum(np.nan_to_num(read(name, n)).ravel(), 0.0).astype("<f4")
            result = zlib.compress(_head(shape, edge, places[name], n if wind else 0) + _values(ppm))
            path = folder / f"simulations/{name.removesuffix(PPM)}/result/iteration_{n}"
            yield len(result), path
            path.write_bytes(result)


def _place(name: str, sources: Sequence[tuple[str, Sequence[float]]]) -> tuple[int, list[float]]:
    """Number of a gas, and where its first source is [m]."""
    species = name.removesuffix(PPM)
    places = [list(place) for one, place in sources if one == species] or [[0.0, 0.0, 0.0]]
    return NUMBERS.get(species, OTHER), [*places[0], 0.0][:3]


def _occupancy(air: np.ndarray, shape: Sequence[int], edge: float) -> bytes:
    """Cells that are less than half air are occupied; air: axes (z, y, x)."""
    high = " ".join(f"{n * edge:.7g}" for n in shape)
    lines = ["#env_min(m) 0 0 0", f"#env_max(m) {high}", f"#num_cells {' '.join(map(str, shape))}"]
    lines.append(f"#cell_size(m) {edge:.7g}")
    for layer in (air < 0.5).astype(int):
        lines += [" ".join(map(str, row)) for row in layer.T.tolist()]
        lines.append(";")
    return ("\n".join(lines) + "\n").encode()


def _head(shape: Sequence[int], edge: float, gas: tuple[int, list[float]], wind: int) -> bytes:
    number, place = gas
    high = [n * edge for n in shape]
    return b"".join(
        [
            struct.pack("<5i", *VERSION, *shape),
            struct.pack("<7f", 0.0, 0.0, 0.0, *high, edge),
            _text("point"),
            struct.pack("<3fi", *place, number),
            struct.pack("<2fi", 0.0, AIR, wind),  # no filaments, so no moles in one
        ]
    )


def _values(ppm: np.ndarray) -> bytes:
    return _text("concentrations") + struct.pack("<Q", len(ppm)) + ppm.tobytes()


def _text(text: str) -> bytes:
    return struct.pack("<Q", len(text)) + text.encode()


def sources_of(scenario: Any) -> list[tuple[str, tuple[float, ...]]]:
    """Species and place [m] of each source of a scenario."""
    return [(gas.vapour.name, one.position) for _, gas in scenario.gases for one in gas.sources]
