"""Results for GADEN's player, read back field by field as its source reads them; the occupancy by our own reader."""

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray

from taichi_plume.files import gaden, gaden_results
from taichi_plume.files.run_folder import RunFolderError


def film(shape=(4, 3, 2), seed: int = 0, **attrs: Any) -> xarray.Dataset:
    """Two frames of noise; shape: cells along x, y[, z]."""
    rng, axes = np.random.default_rng(seed), ("x", "y", "z")[: len(shape)][::-1]
    names = [*"uvw"[: len(shape)], "ethanol_ppm", "1-propanol_ppm"]
    size = (2, *shape[::-1])
    data = {name: (("time", *axes), rng.random(size, np.float32)) for name in names}
    air = (rng.random(shape[::-1]) > 0.3).astype(np.float32)
    return xarray.Dataset(
        {**data, "air": (axes, air)}, {"time": [0.0, 0.5]}, {"spacing": 0.25, "depth": 1.0} | attrs
    )


def written(folder: Path, data: xarray.Dataset) -> list[Path]:
    def read(name: str, n: int) -> np.ndarray:
        return data[name].values[n] if "time" in data[name].dims else data[name].values

    sources = [("ethanol", (0.3, 0.4, 0.1)), ("1-propanol", (0.6, 0.5))]
    return [path for _, path in gaden_results.write(folder, data, read, sources)]


class Buffer:
    """What is left of an unpacked result."""

    def __init__(self, path: Path):
        self.left = zlib.decompress(path.read_bytes())

    def take(self, form: str) -> tuple[Any, ...]:
        size = struct.calcsize(f"<{form}")
        part, self.left = self.left[:size], self.left[size:]
        return struct.unpack(f"<{form}", part)

    def text(self) -> bytes:
        return self.take(f"{self.take('Q')[0]}s")[0]


def test_a_result_has_the_concentration_of_every_cell_in_its_place(tmp_path):
    data = film()
    files = written(tmp_path, data)
    assert {str(path.relative_to(tmp_path)) for path in files} == {
        "OccupancyGrid3D.csv", "wind/wind_iteration_0", "wind/wind_iteration_1",
        *(f"simulations/{gas}/sim.yaml" for gas in ("ethanol", "1-propanol")),
        *(f"simulations/{gas}/result/iteration_{n}" for gas in ("ethanol", "1-propanol") for n in (0, 1)),
    }  # fmt: skip
    for gas, number, place in (("ethanol", 0, (0.3, 0.4, 0.1)), ("1-propanol", 3, (0.6, 0.5, 0.0))):
        for n in (0, 1):
            buffer = Buffer(tmp_path / f"simulations/{gas}/result/iteration_{n}")
            assert buffer.take("2i") == (3, 0)
            assert buffer.take("3i") == (4, 3, 2)
            assert buffer.take("7f") == (0.0, 0.0, 0.0, 1.0, 0.75, 0.5, 0.25)
            assert buffer.text() == b"point"
            assert buffer.take("3f") == pytest.approx(place)
            assert buffer.take("i") == (number,)
            assert buffer.take("2f")[1] == pytest.approx(4.0874e-5, rel=1e-4)  # mol/cm³ of air at 25 °C
            assert buffer.take("i") == (n,)
            assert buffer.text() == b"concentrations"
            count = buffer.take("Q")[0]
            ppm = np.array(buffer.take(f"{count}f"))
            assert not buffer.left
            for x, y, z in np.ndindex(4, 3, 2):
                assert ppm[x + 4 * y + 12 * z] == data[f"{gas}_ppm"].values[n, z, y, x]
    content = (tmp_path / "wind/wind_iteration_1").read_bytes()
    assert struct.unpack("<2i", content[:8]) == (3, 0)
    vectors = np.frombuffer(content, "<f4", offset=8).reshape(2, 3, 4, 3)
    for d, name in enumerate("uvw"):
        np.testing.assert_array_equal(vectors[..., d], data[name].values[1])


def test_occupied_cells_are_read_back(tmp_path):
    data = film((7, 4, 3), seed=2)
    written(tmp_path, data)
    grid = gaden.read(tmp_path / "OccupancyGrid3D.csv")
    np.testing.assert_array_equal(grid.cubes, data["air"].values.T < 0.5)
    assert (grid.size, tuple(grid.high)) == (0.25, pytest.approx((1.75, 1.0, 0.75)))


def test_a_flat_film_is_a_layer(tmp_path):
    data = film((5, 4), seed=3)
    written(tmp_path, data)
    assert gaden.read(tmp_path / "OccupancyGrid3D.csv").cubes.shape == (5, 4, 1)
    content = (tmp_path / "wind/wind_iteration_0").read_bytes()
    vectors = np.frombuffer(content, "<f4", offset=8).reshape(4, 5, 3)
    np.testing.assert_array_equal(vectors[..., 1], data["v"].values[0])
    assert (vectors[..., 2] == 0.0).all()


def test_what_players_do_not_take_is_reported(tmp_path):
    with pytest.raises(RunFolderError, match="the film has no gas"):
        written(tmp_path, film().drop_vars(["ethanol_ppm", "1-propanol_ppm"]))
    many = film((1300, 1000))
    with pytest.raises(RunFolderError, match="the film has 1,300,000 cells, GADEN's player takes 1,249,750"):
        written(tmp_path, many)
    assert not list(tmp_path.iterdir())
