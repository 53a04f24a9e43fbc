"""Gases that a formula tells, from the YAML file to the run directory."""

import json
from typing import Any

import numpy as np
import pytest
import zarr
from scripts import read_result

from taichi_plume.cli import run

pytestmark = pytest.mark.slow

SOURCE = {"position": [0.6, 1.0, 0.2], "rate": "5 mg/s"}
KINDS = {
    "continuous": {"diffusivity": 0.01, "sources": [SOURCE]},
    "gaussian_plume": {"intensity": 0.1, "sources": [SOURCE]},
    "meandering": {"width_fluctuation": 0.2, "sources": [SOURCE]},
    "gaussian_puff": {
        "diffusivity": 0.005,
        "releases": [{"position": [0.6, 1.0, 0.2], "mass": "5 mg", "time": t} for t in (-1, 0.5, 30)],
    },
}


def scenario(path, gas, dim, gusts):
    """Write a scenario with one robot."""
    flat = json.loads(json.dumps(gas).replace("0.6, 1.0, 0.2", "0.6, 1.0")) if dim == 2 else gas
    path.write_text(f"""
duration: 30
warm_up: 2
domain: {{size: {[3.0, 2.0, 0.8][:dim]}, spacing: 0.1}}
wind: {{kind: uniform, velocity: {[0.5, 0.0, 0.0][:dim]}{", gusts: {time: 1}" if gusts else ""}}}
gas: {json.dumps(flat)}
robots:
  - name: one
    count: 1
    start: {{kind: positions, positions: [[1.2, 1.0]]}}
    algorithm: {{kind: casting}}
    reach: 0.3
fields: {{rate: 1, start: -2}}
""")


def played(out, *options) -> Any:
    """Film of a run."""
    command = [str(out.parent / "s.yaml"), "--out", str(out), "--quiet", "--no-recording", *options]
    assert run.main(command) == 0
    return zarr.open_group(out / "fields.zarr", mode="r")


@pytest.mark.parametrize(
    ("kinds", "dim", "steady"),
    [(("continuous", "gaussian_plume"), 3, True), (("meandering", "gaussian_puff"), 2, False)],
)
def test_every_kind_runs_as_a_part_of_a_mixture(tmp_path, kinds, dim, steady):
    species = dict(zip(kinds, ("ethanol", "acetone"), strict=True))
    parts = [{"kind": kind, "species": species[kind]} | KINDS[kind] for kind in kinds]
    scenario(tmp_path / "s.yaml", {"kind": "mixture", "parts": parts}, dim, gusts=not steady)
    film = played(tmp_path / "a", "--duration", "2")
    for kind in kinds:
        c = np.asarray(film[f"gas_{species[kind]}"])
        assert np.isfinite(c).all()
        assert (c.max(axis=tuple(range(1, c.ndim))) > 0).sum() >= len(c) - 1  # puffs come after a second
        assert np.array_equal(c[0], c[-1]) == steady
    assert read_result(tmp_path / "a")["gas"] == {}


def test_a_robot_finds_where_a_puff_came_from(tmp_path):
    puffs = [{"position": [0.6, 1.0], "mass": "20 mg", "time": 0.5 * n} for n in range(60)]
    gas = {"kind": "gaussian_puff", "diffusivity": 0.002, "releases": puffs}
    scenario(tmp_path / "s.yaml", gas, 2, gusts=True)
    played(tmp_path / "a")
    assert read_result(tmp_path / "a")["groups"][0]["success_rate"] == 1.0


def test_a_film_of_puffs_can_be_played(tmp_path):
    scenario(tmp_path / "s.yaml", {"kind": "gaussian_puff"} | KINDS["gaussian_puff"], 2, gusts=True)
    options = ("--set", "gas={kind: playback, file: a/fields.zarr}", "--set", "fields.rate=1")
    films = played(tmp_path / "a", "--duration", "2"), played(tmp_path / "b", "--duration", "2", *options)
    first, again = (np.asarray(film["gas_ethanol"]) for film in films)
    np.testing.assert_allclose(again, first, rtol=1e-6)
