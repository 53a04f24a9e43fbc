"""Winds and gases of another scenario after a reset, and from a saved state."""

from collections.abc import Sequence

import numpy as np
import pytest
import yaml
from saved import assert_goes_on
from test_film import new_film
from test_imported import swirl, write
from test_plumesim import LOG

from taichi_plume.assembly.assemble import assemble
from taichi_plume.assembly.preparation import load_scenario
from taichi_plume.grid.fields import ppm_at, velocity_at
from taichi_plume.time_loop import TimeLoop

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

BASE = """
duration: 4
warm_up: 1
tick: 0.5
domain: {size: [6, 4], spacing: 0.1, depth: 0.5}
wind: {kind: uniform, velocity: [0.5, 0]}
gas: {kind: plumesim_gaussian, release_point: [0.1, 0.1]}
"""
CASES = yaml.safe_load("""
steady wind: [{}, ['wind.velocity=[-0.1, 0.2]']]
gusts:
- wind: {kind: uniform, velocity: [0.5, 0], gusts: {intensity: 0.2, time: 1.5}}
- ['wind.velocity=[-0.1, 0.2]', wind.gusts.intensity=0.4, wind.gusts.time=0.2]
mean plume above the ground:
- domain: {size: [6, 4, 2], spacing: 0.1}
  wind: {kind: uniform, velocity: [0.6, 0, 0]}
  gas: {kind: gaussian_plume, intensity: [0.15, 0.15], sources: [{position: [2, 2, 0.2], rate: 3.0e-5, radius: 0.05}]}
- ['wind.velocity=[-0.1, -0.4, 0]', 'gas.intensity=[0.1, 0.2]', 'gas.sources.0.position=[4, 3, 0.5]',
   gas.sources.0.rate=6e-5, gas.sources.0.radius=0.1]
mean plume in a channel:
- gas: {kind: gaussian_plume, walls: [y-, y+], diffusivity: 0.1, sources: [{position: [1, 1], rate: 3.0e-5}]}
- ['wind.velocity=[-0.3, 0]', 'gas.sources.0.position=[5, 3]']
meandering plume:
- wind: {kind: uniform, velocity: [0.5, 0], gusts: {intensity: 0.2, time: 1.5}}
  gas: {kind: meandering, sources: [{position: [1, 2], rate: 3.0e-5}]}
- ['wind.velocity=[0.3, 0.2]', wind.gusts.time=0.7, gas.width_fluctuation=0.3, 'gas.sources.0.position=[1, 1]']
continuous source:
- wind: {kind: uniform, velocity: [0.3, 0]}
  gas: {kind: continuous, walls: [y-], diffusivity: [0.01, 0.01],
        sources: [{position: [1, 1.5], rate: 2.0e-5, radius: 0.1, start: -0.5, stop: 2.5}]}
- ['wind.velocity=[-0.2, 0]', 'gas.diffusivity=[0.02, 0.01]', 'gas.sources.0.position=[2, 2]',
   gas.sources.0.rate=4e-5, gas.sources.0.radius=0.2, gas.sources.0.start=-0.9, gas.sources.0.stop=3.5]
puffs:
- wind: {kind: uniform, velocity: [0.3, 0], gusts: {intensity: 0.3, time: 1}}
  gas: {kind: gaussian_puff, diffusivity: [0.01, 0.01], releases: [
        {position: [1, 1.5], mass: 1.0e-6, radius: 0.1}, {position: [1, 1.5], mass: 1.0e-6, radius: 0.1, time: 1.5}]}
- ['wind.velocity=[0.1, 0.2]', 'gas.diffusivity=[0.02, 0.01]', 'gas.releases.0.position=[2, 1]',
   gas.releases.0.mass=3e-6, gas.releases.1.time=0.5]
points:
- wind: {kind: plumesim_log, file: a.pslog}
  gas: {kind: plumesim_log, file: a.pslog}
- [wind.rate=1.6, 'wind.offset=[0.1, 0]', gas.rate=1.6, gas.start=0.4, gas.full_scale_ppm=300]
puff of PlumeSim:
- gas: {kind: plumesim_gaussian, release_point: [0.33, 0.41], period: 0.5}
- ['gas.release_point=[0.5, 0.3]', 'gas.diffusion=[0.1, 0.02]', gas.amount=50, gas.cell=0.05, gas.start=1]
meander of PlumeSim:
- gas: {kind: plumesim_meandering, release_point: [0.2, 0.5]}
- ['gas.release_point=[0.3, 0.4]', gas.dispersion=0.02, gas.full_scale_ppm=50]
film: &film
- domain: {size: [0.6, 0.5, 0.4], spacing: 0.1}
  wind: {kind: playback, file: fields.zarr, start: 0.1}
  gas: {kind: playback, file: fields.zarr, start: 0.1}
- [wind.rate=1.7, wind.start=0.15, gas.rate=1.7, gas.start=0.15]
film in a loop: *film
gas on the grid:
- gas: {kind: eulerian, sources: [{position: [1, 1], rate: 3.0e-5, radius: 0.1}, {position: [2, 3], rate: 1.0e-5,
        puffing: {pulse: 0.3, pause: 0.4}}]}
- [seed=3, 'gas.sources.0.position=[1.5, 2]', gas.sources.0.rate=1e-5,
   gas.sources.1.puffing.pulse=0.1]
movie:
- gas: {kind: movie, file: m.npy, frame_rate: 1, pixel: 0.5}
- [gas.rate=1.7, gas.start=0.15, gas.ppm_per_unit=30]
imported wind:
- domain: {size: [1.6, 1.2, 0.4], spacing: 0.1}
  wind: {kind: imported, files: w_%d.csv}
  gas: {kind: eulerian, sources: [{position: [0.3, 0.6, 0.2], rate: 3.0e-5}]}
- [wind.rate=1.4, wind.start=0.1, wind.viscosity=3e-5, wind.schmidt=0.9]
synthetic wind:
- domain: {size: [3, 2], spacing: 0.2}
  wind: {kind: synthetic}
  gas: {kind: eulerian, sources: [{position: [0.3, 0.6], rate: 3.0e-5}]}
- [wind.speed=0.1, wind.longest=1.6, wind.unsteadiness=2, wind.wall_layer=0.1]
synthetic wind in 3-D:
- domain: {size: [2.4, 1.6, 1], spacing: 0.2}
  wind: {kind: synthetic}
  gas: {kind: eulerian, sources: [{position: [0.3, 0.6, 0.2], rate: 3.0e-5}]}
- [wind.speed=0.1, wind.longest=1.6, wind.unsteadiness=2, wind.wall_layer=0.1]
""")
"""Sections of a scenario, and what is other in the second scenario."""


@pytest.mark.parametrize("case", CASES)
def test_a_reset_is_as_good_as_new_and_a_saved_state_goes_on(case, tmp_path):
    (tmp_path / "a.pslog").write_text(LOG)
    np.save(tmp_path / "m.npy", np.random.default_rng(3).random((4, 5, 7)))
    if "film" in case:
        new_film(tmp_path / "fields.zarr", 5)
    if case == "imported wind":
        for n, scale in enumerate([1.0, 2.0, 0.5]):
            write(tmp_path / f"w_{n}.csv", swirl, scale=scale, extra=lambda x: 1e-3 * (1 + x[:, 0]))
    sections, others = CASES[case]
    (tmp_path / "a.yaml").write_text(yaml.safe_dump(yaml.safe_load(BASE) | sections))
    always = ["wind.loop=true", "gas.loop=true"] if "loop" in case else []
    first, other = (load_scenario(tmp_path / "a.yaml", [*always, *more]) for more in ([], others))
    sim, new = assemble(first, tmp_path), assemble(other, tmp_path)
    points = np.random.default_rng(2).uniform(0.0, sim.grid.extent, (300, sim.grid.dim))

    def play(begin: int, end: int, sim: TimeLoop = sim) -> Sequence[np.ndarray]:
        seen = []
        for _ in range(begin, end):
            sim.advance()
            seen += [velocity_at(sim.wind, points, sim.t), ppm_at(sim.gas, points, sim.t)]
        carrier = sim.wind.carrier
        if carrier is not None:
            seen += [sim.grid.read(field) for field in (*carrier.u, carrier.nu) if field is not None]
            seen.append(np.array([carrier.outflow_rate, carrier.max_viscosity, carrier.schmidt]))
        return seen

    assert_goes_on(sim, play)
    old = play(8, 12)
    sim.reset(other)
    found, expected = play(0, 4), play(0, 4, new)
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_array_equal(a, b)
    assert not all(np.array_equal(a, b, equal_nan=True) for a, b in zip(found, old, strict=True))
