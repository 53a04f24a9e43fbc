"""Meandering plume at fixed sensors: intermittency, moments and durations of whiffs and blanks.

The centre of the plume is Gaussian, so that intermittency and moments of the concentration have closed forms. On times
between the gusts' and the plume's age the centre is a random walk. Whiffs and blanks are its first returns,
p(T) ~ T^-3/2 (Celani, Villermaux & Vergassola 2014, doi:10.1103/PhysRevX.4.041015).
"""

from math import erf, exp, log, pi, sqrt

import numpy as np

from taichi_plume.fluctuations import durations
from taichi_plume.grid.fields import concentration_at
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.closed_forms import MeanderingGas
from taichi_plume.scenario.winds import UniformWind
from taichi_plume.solvers.plumes import Plumes
from taichi_plume.solvers.uniform_wind import UniformSolver
from taichi_plume.validation.case import Answer, Curve

U, Q = 1.0, 1e-3  # m/s, kg/s
SEED = 1
SOURCE_Y = 10.0


class Meander:
    """Meandering plume of a source at (0, SOURCE_Y) in a wind of U along x, in 2-D."""

    def __init__(self, length: float, intensity: float, time: float, slope: float):
        self.deviation, self.time, self.slope, self.radius = intensity * U, time, slope, 0.02
        gusts = {"intensity": intensity, "time": time}
        wind = UniformWind.model_validate({"kind": "uniform", "velocity": (U, 0.0), "gusts": gusts})
        source = {"position": (0.0, SOURCE_Y), "rate": Q, "radius": self.radius}
        gas = MeanderingGas.model_validate({"kind": "meandering", "width_slope": slope, "sources": [source]})
        grid = Grid((round(length), 20), 1.0)
        self.wind = UniformSolver(wind, grid, 0.0, SEED)
        self.gas = Plumes(gas, grid, self.wind)

    def relative(self, x: float) -> float:
        """Return the standard deviation [m] of the instantaneous plume at the distance x [m]."""
        return sqrt(self.radius**2 + (self.slope * x) ** 2)

    def peak(self, x: float) -> float:
        """Return the concentration at the centre of the plume at the distance x [m] [kg/m³]."""
        return Q / (U * sqrt(2.0 * pi) * self.relative(x))

    def wander(self, x: float) -> float:
        """Return the standard deviation [m] of the plume's centre at x [m]: gusts over its age (Taylor 1921)."""
        age = x / U / self.time
        return self.deviation * self.time * sqrt(2.0 * (age - 1.0 + exp(-age)))

    def moment(self, x: float, y: float, power: int) -> float:
        """Return the mean of c^power at x and y [m] from the axis: a Gaussian, averaged over the Gaussian centre."""
        s2, m2 = self.relative(x) ** 2 / power, self.wander(x) ** 2
        return self.peak(x) ** power * sqrt(s2 / (s2 + m2)) * exp(-(y**2) / (2.0 * (s2 + m2)))

    def presence(self, x: float, y: float, threshold: float) -> float:
        """Return the probability at x, y [m] that c is above `threshold` times its value at the plume's centre."""
        reach, m = self.relative(x) * sqrt(-2.0 * log(threshold)), self.wander(x)
        return 0.5 * (erf((y + reach) / (m * sqrt(2.0))) - erf((y - reach) / (m * sqrt(2.0))))

    def readings(self, places: np.ndarray, dt: float, count: int) -> np.ndarray:
        """Return the concentration at points (n, 2), x and y from the axis [m], every dt [s], (count, n)."""
        points = places + np.array([0.0, SOURCE_Y])
        result = np.empty((count, len(places)))
        for n in range(count):
            self.wind.advance(n * dt, dt)
            result[n] = concentration_at(self.gas, points, (n + 1) * dt)
        return result


def meander(n: int) -> Answer:
    """Return deviations of means over n independent times from the closed forms, in standard errors."""
    plume = Meander(length=12.0, intensity=0.3, time=1.0, slope=0.05)
    distances, y = np.array([0.3, 1.0, 3.0, 10.0]), np.linspace(-9.0, 9.0, 721)
    places = np.stack(np.meshgrid(distances, y, indexing="ij"), axis=-1).reshape(-1, 2)
    c = plume.readings(places, 18.0, n).reshape(
        n, len(distances), -1
    )  # the plume's age and eight integral times
    mass = c.sum(axis=2)
    centre = (c * y).sum(axis=2) / mass
    second = (c * y**2).sum(axis=2) / mass
    total = np.sqrt(second.mean(axis=0))
    exact = np.array([plume.relative(x) ** 2 + plume.wander(x) ** 2 for x in distances])
    walk = np.array([plume.wander(x) for x in distances])

    at, place, threshold = 2, 400, 0.1  # 3 m downwind, 1 m off the axis
    x, off = distances[at], y[place]
    seen = c[:, at, place]
    present = seen > threshold * plume.peak(x)
    odds = plume.presence(x, off, threshold)
    moments = [plume.moment(x, off, power) for power in (1, 2, 4)]
    gamma, inside = float(present.mean()), seen[present]
    mean = c[:, at].mean(axis=0)
    return {
        "width², standard errors": float(
            np.abs((second.mean(axis=0) - exact) / (walk**2 * sqrt(2.0 / n))).max()
        ),
        "centre, standard errors": float(np.abs(centre.mean(axis=0) / (walk / sqrt(n))).max()),
        "presence, standard errors": abs(gamma - odds) / sqrt(odds * (1.0 - odds) / n),
        "mean, standard errors": abs(seen.mean() - moments[0]) / sqrt((moments[1] - moments[0] ** 2) / n),
        "mean square, standard errors": abs((seen**2).mean() - moments[1])
        / sqrt((moments[2] - moments[1] ** 2) / n),
        "flux through planes": float(np.abs(mass[:, :3] * (y[1] - y[0]) * U / Q - 1.0).max()),
        "presence": gamma,
        "(1 + i_p²) / (1 + i²)": float(
            (1.0 + inside.var() / inside.mean() ** 2) / (1.0 + seen.var() / seen.mean() ** 2)
        ),
        "fluctuation, exact": sqrt(moments[1] / moments[0] ** 2 - 1.0),
        "width of the mean plume": Curve(
            "x [m]", "sigma [m]", distances, total, np.sqrt(exact), log_x=True, log_y=True
        ),
        "mean across, x = 3 m": Curve(
            "y [m]", "c [kg/m³]", y, mean, np.array([plume.moment(x, v, 1) for v in y])
        ),
    }


def whiffs(n: int) -> Answer:
    """Return exponents of whiffs and blanks in n seconds at sensors with gas for about half of the time.

    The plume is as wide as the wander of its centre. At nine sensors the threshold is met when the centre is near the
    axis, so that whiffs and blanks end when the centre returns there, not on the far side of the plume. Over the fitted
    range the exact law is about 0.065 less steep than T^-3/2 (40,000 s in NumPy alone). Half of this is due to the
    finite age of the plume, T^-3/2 (1 - T/(2 x/U))^-1/2 for uncorrelated gusts, half to the duration of gusts.
    """
    time, dt = 0.05, 0.1
    plume = Meander(length=50.0, intensity=0.3, time=time, slope=0.02)
    distances = np.array([40.0, 45.0, 50.0])
    sensors = [(x, plume.wander(x), level) for x in distances for level in (-0.6, 0.0, 0.6)]
    places = np.array([(x, (2.0 + level) * wander) for x, wander, level in sensors])
    least = [
        plume.peak(x) * exp(-((2.0 * wander / plume.relative(x)) ** 2) / 2.0) for x, wander, _ in sensors
    ]
    present = plume.readings(places, dt, round(n / dt)) > least
    several = [durations.spells(dt * np.arange(len(present)), series) for series in present.T]
    first = durations.halfway(20.0 * time - dt, dt)  # after the correlation time of gusts
    last = durations.halfway(0.5 * distances[0] / U, dt)
    answer: dict[str, float | Curve] = {}
    for name, parts in zip(("whiffs", "blanks"), zip(*several, strict=True), strict=True):
        found = durations.pooled(parts)
        slope = durations.exponent(found, first, last)
        assert slope is not None, name
        answer[f"slope of {name} + 3/2"] = abs(durations.CELANI - slope.value)
        answer[f"{name} counted"] = float(slope.count)
        lasted = found.lasted
        edges = (np.floor(np.geomspace(first, 60.0, 15) / dt) + 0.5) * dt  # between possible durations
        density = np.histogram(lasted, edges)[0] / np.diff(edges)
        middle = np.sqrt(edges[:-1] * edges[1:])
        full = density > 0
        law = middle**-durations.CELANI * slope.count / (2.0 * (first**-0.5 - last**-0.5))
        answer[f"duration of {name}"] = Curve(
            "T [s]", "number per second of T", middle[full], density[full], law[full], log_x=True, log_y=True
        )
    return answer
