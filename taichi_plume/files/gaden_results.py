"""Export of a film for GADEN's player: cells, wind files and results in the folder of a configuration.

    OccupancyGrid3D.csv                          cells that are walls or furniture; see files/gaden.py
    wind/wind_iteration_N                        int32 major and minor version, then float32 u, v, w of each cell
    simulations/SPECIES/sim.yaml                 time between results and between winds [s], source
    simulations/SPECIES/result/iteration_N       zlib of what follows, little-endian:
        int32 major, minor version; int32 cells along x, y, z; float32 lower and upper corner [m], edge of a cell [m]
        text "point", float32 position of the source [m], int32 number of the gas
        float32 moles in a filament, moles of air in a cm3; int32 number of the wind file
        text "concentrations", uint64 number of cells, float32 ppm of each

Cells count x first, then y, then z; a text is its length, uint64, and its bytes. This is GADEN 3's form for results of
`preCalculateConcentrations`, with a concentration per cell; earlier versions only know filaments, which a film lacks.
A flat film becomes one layer of cells.
"""

import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import yaml

from taichi_plume.files import disk
from taichi_plume.files.run_folder import RunFolderError

if TYPE_CHECKING:
    import xarray

    from taichi_plume.scenario.scenario import Scenario

VERSION = (3, 0)
WIND = ("u", "v", "w")
PPM = "_ppm"  # end of the names of concentrations
MOST_BYTES = 5_000_000  # of a result before it is packed: the players' buffer
ROOM = 1000  # bytes of the buffer for the header
AIR = 101325.0 / (8.314462618 * 298.15) * 1e-6  # mol/cm3, at 25 degC and 1 atm, as ppm are here
GASES = (
    "ethanol", "methane", "hydrogen", "1-propanol", "chlorine", "fluorine", "acetone", "neon", "helium", "biogas",
    "butane", "carbon_dioxide", "carbon_monoxide", "smoke",
)  # fmt: skip
"""Species in the order of GADEN's numbers."""
OTHER = 0  # unknown species are shown as ethanol


def write(
    folder: Path,
    data: "xarray.Dataset",
    read: Callable[[str, int], np.ndarray],
    sources: Sequence[tuple[str, Sequence[float]]],
) -> Iterator[tuple[int, Path]]:
    """Write a film as GADEN results into an existing folder; yield size and path of each file before it is written.

    data: variables at the cell centres; read: returns their values; sources: species and position [m] of each source.
    Raises OSError, and RunFolderError if the film has no gas or more cells than players take.
    """
    shape = [data.sizes.get(axis, 1) for axis in "xyz"]
    cells, gases = int(np.prod(shape)), [str(name) for name in data.data_vars if str(name).endswith(PPM)]
    if not gases:
        raise RunFolderError(f"{folder}: the film has no gas, which results need")
    if 4 * cells > MOST_BYTES - ROOM:
        raise RunFolderError(
            f"{folder}: the film has {cells:,} cells, GADEN's player takes {(MOST_BYTES - ROOM) // 4:,}; run with "
            "larger ones"
        )
    edge = float(data.attrs["spacing"])
    path = folder / "OccupancyGrid3D.csv"
    grid = _occupancy(read("air", 0).reshape(shape[::-1]), shape, edge)
    yield len(grid), path
    _put(path, grid)
    wind = [name for name in WIND if name in data]
    frames = range(data.sizes["time"])
    places = {name: _place(name, sources) for name in gases}
    for part in ("wind", *(f"simulations/{name.removesuffix(PPM)}/result" for name in gases)):
        (folder / part).mkdir(parents=True, exist_ok=True)
    step = float(np.median(np.diff(data["time"].values))) if len(frames) > 1 else 1.0
    for name, (number, place) in places.items():
        path = folder / f"simulations/{name.removesuffix(PPM)}/sim.yaml"
        source = {"sourceType": "point", "position": [float(x) for x in place], "gasType": number}
        times = {"saveDeltaTime": step, "windIterationDeltaTime": step, "expectedNumIterations": len(frames)}
        text = yaml.safe_dump({"source": source, **times}, sort_keys=False).encode()
        yield len(text), path
        _put(path, text)
    for n in frames:
        if wind:
            vectors = np.zeros((cells, 3), "<f4")
            for d, name in enumerate(wind):
                vectors[:, d] = np.nan_to_num(read(name, n)).ravel()
            path = folder / f"wind/wind_iteration_{n}"
            yield vectors.nbytes, path
            _put(path, struct.pack("<2i", *VERSION) + vectors.tobytes())
        for name in gases:
            ppm = np.maximum(np.nan_to_num(read(name, n)).ravel(), 0.0).astype("<f4")
            head = _head(shape, edge, places[name], n if wind else 0)
            result = zlib.compress(head + struct.pack("<Q", len(ppm)) + ppm.tobytes())
            path = folder / f"simulations/{name.removesuffix(PPM)}/result/iteration_{n}"
            yield len(result), path
            _put(path, result)


def _put(path: Path, content: bytes) -> None:
    with disk.written_whole(path, durable=False) as fresh:  # thousands of files
        fresh.write_bytes(content)


def _place(name: str, sources: Sequence[tuple[str, Sequence[float]]]) -> tuple[int, list[float]]:
    """Return GADEN's number of the gas in a variable NAME_ppm, and the position of its first source [m]."""
    species = name.removesuffix(PPM)
    places = [list(place) for source, place in sources if source == species] or [[0.0, 0.0, 0.0]]
    return GASES.index(species) if species in GASES else OTHER, [*places[0], 0.0][:3]


def _occupancy(air: np.ndarray, shape: Sequence[int], edge: float) -> bytes:
    """Return the bytes of OccupancyGrid3D.csv: cells with less than half air are solid; air: axes (z, y, x)."""
    high = " ".join(f"{n * edge:.7g}" for n in shape)
    lines = ["#env_min(m) 0 0 0", f"#env_max(m) {high}", f"#num_cells {' '.join(map(str, shape))}"]
    lines.append(f"#cell_size(m) {edge:.7g}")
    for layer in (air < 0.5).astype(int):
        lines += [" ".join(map(str, row)) for row in layer.T.tolist()]
        lines.append(";")
    return ("\n".join(lines) + "\n").encode()


def _head(shape: Sequence[int], edge: float, gas: tuple[int, list[float]], wind: int) -> bytes:
    """Return the header bytes of a GADEN result: version, grid, source, gas and wind index; no filaments."""
    number, place = gas
    high = [n * edge for n in shape]
    grid = struct.pack("<5i7f", *VERSION, *shape, 0.0, 0.0, 0.0, *high, edge)
    return (
        grid
        + _text("point")
        + struct.pack("<3fi2fi", *place, number, 0.0, AIR, wind)
        + _text("concentrations")
    )


def _text(text: str) -> bytes:
    return struct.pack("<Q", len(text)) + text.encode()


def sources_of(scenario: "Scenario") -> list[tuple[str, tuple[float, ...]]]:
    """Return species and position [m] of each gas source of a scenario."""
    return [(gas.vapour.name, source.position) for _, gas in scenario.gases for source in gas.sources]
