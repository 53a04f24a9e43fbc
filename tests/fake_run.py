"""A TimeLoop with closed-form air, gas and robots, for tests of what watches a run."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import yaml

from taichi_plume.agents.columns import COLUMNS
from taichi_plume.agents.groups import GroupRange
from taichi_plume.engine import ti
from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import Gas, Mixture, Wind
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.outlines import faceted
from taichi_plume.grid.series import Series
from taichi_plume.scenario.obstacles import Mesh
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.shapes import shape
from taichi_plume.scenario.species import SPECIES
from taichi_plume.time_loop import TimeLoop


class FakeWind(Wind):
    """A parallel stream along x with a slow sway, from the walls' zero to U in the middle."""

    def __init__(self, grid: Grid, speed: float):
        self.dim, self.speed, self.width = grid.dim, speed, grid.extent[1]

    def advance(self, t: float, dt: float) -> None:
        pass

    @ti.func
    def velocity(self, x, t):
        u = ti.Vector.zero(ti.f32, self.dim)
        s = x[1] / self.width
        u[0] = self.speed * 4.0 * s * (1.0 - s)
        u[1] = 0.3 * self.speed * ti.sin(0.8 * t - 2.0 * x[0])
        return u

    def diagnostics(self) -> dict[str, float]:
        return {"max_divergence": 1e-6, "max_courant": 0.5, "max_speed": self.speed}


class FakeGas(Gas):
    """A meandering Gaussian plume with a wavy intensity: c = a exp(-r²/2s²) (1 + cos(...))/2 [kg/m³]."""

    species = SPECIES["ethanol"]

    def __init__(self, grid: Grid, source: tuple[float, ...], peak_ppm: float = 400.0):
        self.dim = grid.dim
        self.source = (*source, *[0.0] * (3 - len(source)))
        self.peak = peak_ppm / self.species.ppm_per_density

    def advance(self, t: float, dt: float) -> None:
        pass

    @ti.func
    def concentration(self, x, t):
        along = x[0] - self.source[0]
        s = 0.05 + 0.08 * ti.max(along, 0.0)
        across = x[1] - self.source[1] - 0.12 * along * ti.sin(0.8 * t - 2.0 * x[0])
        r2 = across**2
        if ti.static(self.dim == 3):
            r2 += (x[2] - self.source[2]) ** 2
        puffs = 0.55 + 0.45 * ti.cos(8.0 * along - 5.0 * t)
        c = self.peak * (0.05 / s) ** 2 * ti.exp(-r2 / (2 * s * s)) * puffs
        return ti.select(along < -0.05, 0.0, c)

    def budget(self) -> dict[str, float]:
        return {"emitted_kg": 2.0, "in_domain_kg": 0.5, "outflow_kg": 1.4}


@dataclass
class FakeSwarm:
    """Robots on sine tracks against the stream; robot 0 of each team finds the source at `find_at`.

    says: time, place and truth of what robot 1 of the swarm declares.
    """

    scenario: Scenario
    find_at: float = 8.0
    says: Sequence[tuple[float, tuple[float, float], bool]] = ()
    t: float = 0.0
    groups: list[Any] = field(default_factory=list)
    columns = COLUMNS
    clearance = SimpleNamespace(
        distance_at=lambda points: np.ones(points.shape[:-1]), low=np.zeros(2), high=np.array([4.0, 3.0])
    )

    def __post_init__(self) -> None:
        start = row = 0
        for model in self.scenario.robots:
            self.groups.append(
                GroupRange(len(self.groups), model.name, start, model.count, model.trials, model, row)
            )
            start += model.count * model.trials
            row += model.trials if self.scenario.rivals else 0
        self.count = start

    def all_over(self) -> bool:
        return False

    def move(self, tick: int, t: float, dt: float) -> None:
        self.t = t

    def snapshot(self) -> dict[str, np.ndarray]:
        n = np.arange(self.count)
        lx, ly = self.scenario.domain.extent[:2]
        member = np.concatenate([np.tile(np.arange(g.count), g.trials) for g in self.groups])
        share = np.clip(self.t / self.scenario.duration, 0, 1)
        x = lx * (0.9 - 0.7 * share) + 0.02 * n
        y = ly * (0.5 + 0.35 * np.sin(0.5 * self.t + member))
        found = (member == 0) & (self.t >= self.find_at)
        reading = 20 * np.abs(np.sin(self.t + member))
        heading = np.pi + np.cos(0.5 * self.t + member)
        now = {column.key: column.zeros(self.count) for column in COLUMNS if column.key}
        known = {
            "position": np.stack([x, y], -1),
            "heading": heading,
            "believed_position": np.stack([x + 0.03, y - 0.1], -1),
            "believed_heading": heading + 0.4,
            "odometer": np.full(self.count, 0.21 * self.t),
            "reading_ppm": reading,
            "above_ppm": reading,
            "true_ppm": reading + 1,
            "wind": np.tile([0.3, 0.0], (self.count, 1)),
            "state": (reading > 10).astype(np.int32),
            "found": found,
            "path_length": np.full(self.count, 0.2 * self.t),
            "found_time": np.where(found, self.find_at, np.nan),
            "reached_time": np.where(found, self.find_at, np.nan),
            "resistance_ohm": np.full(self.count, 1e4),
            **{name: np.full(self.count, 3) for name in ("acquisitions", "hits", "bumps")},
        }
        assert known.keys() <= now.keys()
        said = [one for one in self.says if self.t >= one[0] - 1e-9]
        if said:
            now["declarations"][1], now["false_declarations"][1] = len(said), sum(not one[2] for one in said)
            kept = next((one for one in said if one[2]), said[-1])
            now["declared_time"][1], now["declared_position"][1] = kept[:2]
        return now | known | {"start": np.tile([3.0, 1.0], (self.count, 1))}


class FakeMap:
    """Half the truth wherever the first robot has been near."""

    levels = None

    def __init__(self, kind: str, cell: float, sim: TimeLoop):
        self.kind, self.cell, self.sim, self.window = kind, cell, sim, None
        lx, ly = sim.grid.extent[:2]
        self.shape = (round(lx / cell), round(ly / cell))
        trials = [group.trials for group in sim.scenario.robots]
        self.trials = sum(trials) if sim.scenario.rivals else max(trials)
        self.seen = np.zeros(self.shape, bool)
        self.errors = Series(self.trials)

    def update(self, swarm: Any, t: float, dt: float) -> None:
        i, j = (swarm.snapshot()["position"][0] / self.cell).astype(int)
        self.seen[max(0, i - 1) : i + 2, max(0, j - 1) : j + 2] = True
        if round(t / dt) % 50 == 0:
            self.errors.append((t, np.full(self.trials, 10.0 / (1 + t))))

    def estimate(self) -> np.ndarray:
        from taichi_plume.scoring import trials as scores

        half = 0.5 * scores.true_gas(self.sim, self.cell, self.shape)
        return np.tile(np.where(self.seen, half, np.nan), (self.trials, 1, 1))

    def weight(self) -> np.ndarray:
        return np.tile(np.where(self.seen, 2.0, 0.0), (self.trials, 1, 1))


SCENARIO = """
name: fake-{dim}d
seed: 7
duration: 10
domain: {{size: [4.0, 3.0{height}], spacing: 0.05}}
wind:
  kind: cfd
  openings:
    - {{kind: fan, face: x-, center: [1.5{middle}], diameter: 0.4, speed: 0.9, schedule: [{{at: 3, speed: 0.6}}]}}
    - {{kind: honeycomb, face: x+}}
obstacles:
  - {{kind: box, center: [2.0, 0.6{low}], size: [0.4, 0.3{tall}], yaw_deg: 20}}
  - {{kind: cylinder, center: [2.6, 2.3], radius: 0.15}}
  - {{kind: sphere, center: [1.5, 2.4{ball}], radius: 0.2}}
  - {{kind: prism, vertices: [[3.2, 0.3], [3.7, 0.3], [3.7, 0.9], [3.5, 0.5]]}}
  - {{kind: mesh, file: tetra.stl}}
gas: {{kind: eulerian, sources: [{{position: [0.6, 1.5{source}], rate: 2.0e-5}}]}}
robots:
  - name: team
    count: 4
    trials: 2
    start: {{kind: area, low: [3, 0.5], high: [3.8, 2.5]}}
    algorithm: {{kind: casting}}
maps: [{{kind: time_series}}, {{kind: inverse_distance}}]
"""
HEIGHTS = {"height": 0.5, "middle": 0.25, "low": 0.15, "tall": 0.3, "ball": 0.2, "source": 0.1}


def scenario(dim: int = 3, **changes: Any) -> Scenario:
    """A small arena with one of everything."""
    heights = {name: f", {z}" if dim == 3 else "" for name, z in HEIGHTS.items()}
    return Scenario.model_validate(yaml.safe_load(SCENARIO.format(dim=dim, **heights)) | changes)


def simulation(model: Scenario) -> TimeLoop:
    """The fake run of a scenario."""
    grid = Grid.of(model.domain)
    swarm: Any = FakeSwarm(model)
    about = {
        "algorithm": SimpleNamespace(DECISIONS=()),
        "state_names": ("search", "surge"),
        "act": lambda *_: None,
    }
    teams: list[Any] = [SimpleNamespace(numbers=(n,), **about) for n in range(len(model.robots))]
    sensors: Any = SimpleNamespace(measure=lambda *_: None)
    source = model.gas.sources[0].position
    wind = FakeWind(grid, 0.9)
    air = Air.everywhere(grid)
    obstacles: list[Any] = [
        _Facets(one) if isinstance(one, Mesh) else shape(one, model.domain, Path()) for one in model.obstacles
    ]
    gas = Mixture([FakeGas(grid, source)])
    sim = TimeLoop(model, grid, wind, gas, swarm, sensors, teams, [], obstacles, air)
    sim.maps = [FakeMap(m.kind, m.cell, sim) for m in model.maps]
    return sim


class _Facets:
    """Mesh that needs no file and no open3d."""

    def __init__(self, model: Mesh):
        corners = np.array([[3.2, 2.3, 0], [3.6, 2.3, 0], [3.4, 2.7, 0], [3.4, 2.45, 0.3]])
        self.model, self.triangles = model, corners[[[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]]

    def mesh(self, size: tuple[float, float, float]) -> Any:
        """Return the mesh for the recording."""
        return faceted(self.triangles)
