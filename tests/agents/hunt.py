"""What tests of plume tracking share: a room with a steady plume, and many trials that search in it."""

from types import SimpleNamespace

from arena import Run
from robots import AWAY, Arena

from taichi_plume.engine import ti
from taichi_plume.scenario.species import SPECIES

SOURCE = (0.5, 1.5)
CONE, STRIP, PATCH = range(3)


class Plume:
    """Wind along +x and gas: behind SOURCE a Gaussian CONE with `peak` ppm at its tip, a STRIP along the axis of the
    room, or a PATCH downwind of x = 2.5 m.
    """

    species = (SPECIES["ethanol"],)

    def __init__(self):
        self.peak, self.wind = ti.field(ti.f32, ()), ti.field(ti.f32, ())
        self.shape = ti.field(ti.i32, ())

    def set(self, peak, wind, shape):
        self.peak[None], self.wind[None], self.shape[None] = peak, wind, shape

    @ti.func
    def ppm(self, x, t):
        behind = x[0] - SOURCE[0]
        width = 0.08 + 0.1 * ti.max(behind, 0.0)
        across = (x[1] - SOURCE[1]) / width
        share = ti.select(behind > 0.0, ti.exp(-0.5 * across * across) * 0.08 / width, 0.0)
        if self.shape[None] == STRIP:
            share = ti.select(ti.abs(x[1] - 1.5) < 0.3, 1.0, 0.0)
        elif self.shape[None] == PATCH:
            share = ti.select(x[0] > 2.5, 1.0, 0.0)
        return ti.Vector([self.peak[None] * share])

    @ti.func
    def velocity(self, x, t):
        return ti.Vector([self.wind[None], 0.0])


class Hunt(Run):
    """60 trials of one robot for each of the gas sensors, that neither see nor touch each other."""

    TRIALS = 60

    def __init__(self, kind, gases=({"kind": "ideal"},)):
        self.kind, self.gases = kind, gases
        rivals = self._rivals((2.8, 0.3), (3.7, 2.7), {})
        super().__init__(rivals, Plume(), (), self.TRIALS, sources=[SOURCE], arena=Arena(), seed=3, reach=0.3)

    def _rivals(self, low, high, model):
        usual = {
            "count": 1,
            "start": {"kind": "area", "low": low, "high": high},
            "algorithm": {"kind": self.kind, **model},
            "body": {},
        }
        return [usual | {"sensors": {"gas": gas, "wind": {"kind": "ultrasonic"}}} for gas in self.gases]

    def search(
        self,
        peak,
        seconds,
        shape=CONE,
        wind=0.5,
        box=AWAY[1],
        low=(2.8, 0.3),
        high=(3.7, 2.7),
        trials=TRIALS,
        **model,
    ):
        """Search anew. For each sensor what the robots of the first `trials` trials have in the end (`found`,
        `path_length`, `wind_known`), their `states` (ticks, robots) and `tracks` (ticks, robots, 2).
        """
        self.gas.set(peak, wind, shape)
        self.arena.set(plate=box)
        self.begin(self._rivals(low, high, model))
        states, tracks = self.go(seconds)
        ends = {name: getattr(self.swarm, name).to_numpy() for name in ("found", "path_length", "wind_known")}
        parts = [slice(one.start, one.start + trials) for one in self.swarm.groups]
        return [
            SimpleNamespace(
                states=states[:, part],
                tracks=tracks[:, part],
                **{name: values[part] for name, values in ends.items()},
            )
            for part in parts
        ]
