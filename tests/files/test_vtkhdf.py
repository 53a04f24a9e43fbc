"""VTKHDF of a flat film, read by VTK; of one in space see test_run_data."""

import numpy as np
import pytest
import xarray

from taichi_plume.files import vtkhdf


def test_a_flat_film_is_a_layer_as_thick_as_its_slab(tmp_path):
    import pyvista

    u, gas = np.random.default_rng(3).random((2, 3, 4, 5), np.float32)
    data = xarray.Dataset(
        {"u": (("time", "y", "x"), u), "v": (("time", "y", "x"), -u), "gas_a": (("time", "y", "x"), gas)},
        {"time": [0.0, 1.0, 2.5]},
        {"spacing": 0.1, "depth": 0.5},
    )
    list(vtkhdf.write(tmp_path / "a.vtkhdf", data, lambda name, n: data[name].values[n]))
    reader = pyvista.get_reader(tmp_path / "a.vtkhdf").reader
    reader.UpdateTimeStep(2.5)
    mesh = pyvista.wrap(reader.GetOutputDataObject(0))
    np.testing.assert_allclose(mesh.bounds, [0, 0.5, 0, 0.4, 0, 0.5])
    np.testing.assert_array_equal(mesh["wind"], np.stack([u[2], -u[2], 0 * u[2]], -1).reshape(-1, 3))
    assert mesh.volume == pytest.approx(0.1)
    assert mesh.compute_cell_sizes()["Volume"] @ mesh["gas_a"] == pytest.approx(0.005 * gas[2].sum())
