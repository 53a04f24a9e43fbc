"""Source-term estimation: place, strength and number of sources by a model of dispersion, and where to measure next.

ACQUIRE  stand still; the mean reading and the mean wind are a measurement, and the posterior is updated by it
MOVE     along a free path to the next place to measure at

After each acquisition (`acquisition`, with the sensor's lag deconvolved):

1. The wind on the floor is estimated from all measured winds by a Gauss-Markov random field with mass conservation
   (`wind_map`). In 3-D it is the same at all heights.
2. One factorisation of the steady advection-diffusion equation gives the response of each measurement to a source of
   unit rate in every cell, by the adjoint (`dispersion`), at the height of the sources.
3. Particles of place, rate and number of sources are weighted, resampled and moved (`source_posterior`).
4. The next place within `range` has the largest expected information per time, for the way there and an acquisition:

       I = ½ ln(1 + w Var(ln m) / (ψ'(s) + ψ'(m0)))

   m: mean reading there by each of some particles, from forward solutions; w: weight of a measurement beside those that
   were made. It is the information of a Gaussian reading of ln m whose variance is that of the likelihood's ratio.
   After convergence the next place is the expected one of the source.

The scheme is that of PMFS (Ojeda, Monroy & Gonzalez-Jimenez, IEEE Trans. Robotics 2024, arXiv:2304.08879): dispersion
on an estimated wind, compared with measurements. Theirs simulates filaments of each candidate and compares hits. The
adjoint of receptors is that of atmospheric source estimation (Keats, Yee & Lien 2007,
doi:10.1016/j.atmosenv.2006.08.044), free choice of the next place that of cognitive searches (Ristic, Skvortsov &
Gunatilaka 2016, Information Fusion 28, 1-9). Ours: the likelihood, the Gaussian information, and the limits of
`Declaring`.

Sources are taken to stand still. In a team a robot takes the acquisitions that it receives from team mates as its own,
see `shared_readings`.
"""

from functools import cached_property

import numpy as np
from scipy import ndimage
from scipy.special import polygamma

from taichi_plume.agents.acquisition import MEAN, Acquisition, Counting
from taichi_plume.agents.algorithm import KernelAlgorithm
from taichi_plume.agents.beliefs import SPREAD, Declaring
from taichi_plume.agents.decisions import Decision, way_point
from taichi_plume.agents.dispersion import Dispersion
from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.parameters import Numbers
from taichi_plume.agents.potential import Potential
from taichi_plume.agents.priors import prior_weights, require_prior
from taichi_plume.agents.serial_loops import runs_serially
from taichi_plume.agents.shared_readings import SharedReadings
from taichi_plume.agents.shortest_paths import FAR, Ways
from taichi_plume.agents.source_posterior import MODEL_SHAPE, Estimate, Rates, SourcePosterior
from taichi_plume.agents.way_points import WayPoints
from taichi_plume.agents.wind_map import FloorWind
from taichi_plume.engine import ti
from taichi_plume.grid.grid import centers
from taichi_plume.scenario.belief_algorithms import SourceTerm as Model
from taichi_plume.scenario.loading import ScenarioError

ACQUIRE, MOVE = range(2)

MODELS = 4  # diffusivities between the limits
DRAWS = 24  # particles whose plumes are solved for the expected information
WIND_CELL = 0.25  # m, least edge of the cells of the estimated wind
SCALE = np.array([0.0, *np.geomspace(1e-4, 1e6, 400)])  # ppm, of which the steady readings are tabulated
WIND_PRECISION = 1000.0  # s²/m², of the mean wind of an acquisition
THICK = 0.3  # cells: walls nearer to the centre of a cell fill it


class SourceTerm(KernelAlgorithm):
    """Search algorithm that estimates source terms. tick: control period [s]."""

    PER_GROUP: bool = True  # has a single map of paths
    TALKS = True
    STATE: tuple[str, ...] = (
        *("potential", "acquisition", "declaring", "felt", "course", "posteriors", "measured"),
        "readings",
        *("entropy", "information", "rate", "sources"),
    )
    STATE_NAMES: tuple[str, ...] = ("ACQUIRE", "MOVE")
    DECISIONS: tuple[Decision, ...] = (
        MEAN,
        Decision("entropy", "nat", "entropy of the belief after the last acquisition"),
        SPREAD,
        *way_point(),
        Decision("information", "nat/s", "expected information there per time; null on the way to the mean"),
        Decision("rate", "kg/s", "median of the posterior of the surest source's rate", "rate", 0),
        Decision("rate_low", "kg/s", "lower limit of its interval of 90 %", "rate", 1),
        Decision("rate_high", "kg/s", "upper limit of its interval of 90 %", "rate", 2),
        Decision("sources", "1", "most probable number of sources"),
    )

    def _allocate(self) -> None:
        model: Model = self.model
        swarm, (group,) = self.swarm, self.members.groups
        self.group, self.clearance, self.room = group, swarm.clearance, swarm.room
        self.nose, self.species = group.model.sensors.noses[0], swarm.room.species
        self._require_response()
        self.potential = Potential(self.members, self.p)
        self.acquisition = Counting(self.members, self.p)
        self.declaring = Declaring(self.members, self.p)
        gap = group.model.body.radius + model.avoidance
        self.roads = Ways(self.clearance, model.road_cell, gap)
        self.course = WayPoints(self.members, self.roads, self.potential)
        self.readings = SharedReadings(self.members, self.p)
        self.taken = ti.field(ti.i32, (self.size, group.count))  # readings that a robot takes in this tick
        self.felt = ti.vector_field(2, ti.f32, self.size)  # sum of the wind during an acquisition [m/s]
        self.entropy, self.information, self.sources = (
            np.full(self.size, np.nan, np.float32) for _ in range(3)
        )
        # median of the surest source's rate and its interval [kg/s]
        self.rate = np.full((self.size, 3), np.nan, np.float32)
        self.diffusivities = np.geomspace(*model.diffusivity, MODELS)
        self.pause, self.speed = model.settle + model.acquisition, group.speed(model.speed)
        self.ends_at = self.p.largest("ends_at")
        self.samples = int(self.p.largest("samples")) if model.likelihood == "counts" else 1
        self.per_rate = self.species.ppm_per_density
        self.steady = np.array([self.nose.reads(self.species.name, ppm) for ppm in SCALE])
        self.ways = self.roads.length.to_numpy()  # m
        low = np.array(self.roads.low)
        self.road_places = centers(self.roads.shape, self.roads.cell).reshape(-1, 2) + low
        self.belief_cell, self.belief_low = model.cell, np.array(self.clearance.low, float)
        extent = np.array(self.clearance.high) - self.belief_low
        self.cells = tuple(max(1, round(length / model.cell)) for length in extent)
        self.flat = Dispersion(np.zeros((*self.cells, 2)), model.cell, self._layer(self.solid, 0))
        sensor = self.nose.height + (group.model.start_altitude if group.model.body.flies else 0.0)
        self.sensor_layer = self._layer_at(sensor)
        self.source_layer = self._layer_at(sensor if model.source_height is None else model.source_height)
        # place (2) [m], wind (2) [m/s] and reading [ppm] of each measurement of each robot
        self.measured = [np.zeros((0, 5)) for _ in range(self.size)]
        prior = model.rate
        rates = Rates(*prior.limits, prior.median, prior.factor or 3.0)
        rngs = group.generators(swarm.seed, "source terms")
        self.posteriors = [
            SourcePosterior(
                self._prior(swarm.start[group.start + n]),
                self.belief_low,
                model.cell,
                rates,
                rngs[n // group.count].spawn(1)[0],
                particles=model.particles,
                most=model.sources,
                floor=model.threshold_ppm,
                threshold=None if model.likelihood == "readings" else model.threshold_ppm,
                correlation=model.correlation,
                models=MODELS,
            )
            for n in range(self.size)
        ]

    def _require_response(self) -> None:
        """Raise ScenarioError if the robot's sensor does not give the concentration of the gas at a point."""
        where = f"robots[{self.group.number}].sensors.gas"
        if self.species is None:
            raise ScenarioError([f"{where}: there is no gas with a source, which source_term needs"])
        if self.nose.law == "line":
            raise ScenarioError(
                [f"{where}.kind: a laser reads along its beam; source_term needs a reading at a point"]
            )
        if not self.nose.reads(self.species.name, 1.0) > 0.0:
            raise ScenarioError(
                [f"{where}: does not respond to {self.species.name}, which source_term is to find"]
            )

    def numbers(self, group: GroupRange, model: Model) -> Numbers:
        return {
            **Potential.numbers(self.swarm, group, model.speed, model.avoidance),
            **Acquisition.numbers(group, self.tick),
            **Declaring.numbers(model, group),
            **SharedReadings.numbers(group, self.tick),
            "threshold": model.threshold_ppm,
        }

    # ------------------------------------------------------------ results

    def beliefs(self) -> np.ndarray:
        return np.stack([posterior.probability() for posterior in self.posteriors])

    def estimates(self) -> list[list[Estimate]]:
        """Return the estimated sources of each robot, the surest first."""
        return [posterior.estimates() for posterior in self.posteriors]

    @property
    def way_point(self) -> np.ndarray:
        """Centre of the cell to which each robot drives (size, 2) [m]; NaN before the first."""
        return np.where(np.isnan(self.entropy)[:, None], np.nan, self.course.places)

    # ------------------------------------------------------------ search

    def act(self, tick: int, t: float, dt: float) -> None:
        self._advance(tick, dt)
        due = np.flatnonzero(self.readings.ended.values)
        if len(due):
            self._receive(tick)
            readings = self.readings
            place, wind, reading = readings.place.values, readings.wind.values, readings.value.values
            for n, m in np.argwhere(self.taken.values).tolist():
                k = n - n % self.group.count + m
                new = np.array([*place[k], *wind[k], self._datum(reading[k])])
                self.measured[n] = np.concatenate([self.measured[n], [new]])
                self._rule_out(n, place[k])
            goal = np.full(self.size, -1, np.int32)
            best, spread = np.zeros((self.size, 2), np.float32), np.full(self.size, np.inf, np.float32)
            for n in due.tolist():
                best[n], spread[n], goal[n] = self._infer(n, place[n])
            self._conclude(t, goal, best, spread, self.rate)

    @ti.kernel
    def _advance(self, tick: int, dt: float):
        """Advance acquisitions and ways of all robots by a control period of dt [s]."""
        ti.loop_config(serialize=ti.static(runs_serially(self.size)))
        for n in range(self.size):
            i = self.robot[n]
            self.readings.ended[n] = 0
            if self.swarm.searches(i):
                if self.swarm.state[i] == ACQUIRE:
                    self.potential.stand(n)
                    if self.acquisition.since[n] == 0:
                        self.felt[n] = ti.Vector([0.0, 0.0])
                    if self.swarm.wind_known[i] == 1:
                        self.felt[n] += self.swarm.wind[i]
                    ticks = self.acquisition.since[n] + 1
                    if self.acquisition.listen(n):
                        reading = self.acquisition.last[n]
                        if ti.static(self.model.likelihood == "counts"):
                            reading = ti.cast(self.acquisition.above[n], ti.f32)
                        self.readings.end(n, tick, reading, self.felt[n] / ticks)
                elif self.course.follow(n, dt):
                    self.swarm.state[i] = ACQUIRE

    @ti.kernel
    def _receive(self, tick: int):
        """Find the readings of this tick that each robot takes, its own among them."""
        ti.loop_config(serialize=ti.static(runs_serially(self.size)))
        for n, m in ti.ndrange(*self.taken.shape):
            taken = self.readings.ended[n] == 1 and self.readings.mate(n, m) == n
            if ti.static(self.readings.are_shared):
                taken = self.readings.takes(n, m, tick)
            self.taken[n, m] = ti.cast(taken, ti.i32)

    @ti.kernel
    def _conclude(
        self,
        t: float,
        goal: ti.types.ndarray(dtype=ti.i32, ndim=1),
        best: ti.types.ndarray(dtype=ti.f32, ndim=2),
        spread: ti.types.ndarray(dtype=ti.f32, ndim=1),
        rate: ti.types.ndarray(dtype=ti.f32, ndim=2),
    ):
        """Let robots whose acquisition has ended declare the surest source, if sure enough, and set out."""
        ti.loop_config(serialize=ti.static(runs_serially(self.size)))
        for n in range(self.size):
            i = self.robot[n]
            if self.readings.ended[n] == 1:
                hit = self.acquisition.last[n] >= self.p.threshold[n]
                self.swarm.hits[i] += ti.cast(hit, ti.i32)
                before = self.swarm.declarations[i]
                self.declaring.consider(n, ti.Vector([best[n, 0], best[n, 1]]), spread[n], t)
                if self.swarm.declarations[i] > before and self.swarm.declared_time[i] == t:
                    self.swarm.declared_rate[i] = ti.Vector([rate[n, 0], rate[n, 1], rate[n, 2]])
                start = self.roads.free_cell_of(self.swarm.believed_position[i])
                if goal[n] >= 0 and start >= 0:
                    self.course.set_out(n, start, goal[n])
                    self.swarm.state[i] = MOVE

    def _datum(self, reading: float) -> float:
        """Return the measurement that the likelihood takes: gas [ppm], 1 for a hit and 0 for a miss, or a count."""
        if self.model.likelihood == "readings":
            return float(np.interp(reading, self.steady, SCALE))
        is_hit = reading >= self.model.threshold_ppm
        return float(is_hit if self.model.likelihood == "hits" else reading)

    # ------------------------------------------------------------ inference

    def _infer(self, n: int, place: np.ndarray) -> tuple[np.ndarray, float, int]:
        """Update the posterior of robot n at a point [m]; return place and spread of the surest source, and the goal.

        The goal is a cell of the roads, -1 if there is none.
        """
        posterior, measured = self.posteriors[n], self.measured[n]
        air = self._dispersions(measured)
        weights = np.stack([self._sensor(at) for at in measured[:, :2]])
        response = np.stack([self._layer(model.adjoint(weights), self.source_layer) for model in air])
        posterior.learn(measured[:, :2], measured[:, 4], self.per_rate * response, self.samples)
        estimates = posterior.estimates()
        best = estimates[0]
        self.rate[n] = best.rate, best.low, best.high
        self.sources[n] = len(estimates)
        p = posterior.probability()
        self.entropy[n] = -(p * np.log(np.where(p > 0.0, p, 1.0))).sum()
        return best.place, best.spread, self._goal(n, place, air, best)

    def _rule_out(self, n: int, place: np.ndarray) -> None:
        """Rule out the cells around a point [m] by robot n, as the search that measured there has gone on."""
        if self.ends_at > 0.0:
            middle = centers(self.cells, self.belief_cell) + self.belief_low
            corner = np.abs(middle - place) + 0.5 * self.belief_cell
            self.posteriors[n].rule_out((corner**2).sum(axis=-1) <= self.ends_at**2)

    def _goal(self, n: int, place: np.ndarray, air: list[Dispersion], best: Estimate) -> int:
        """Return the next cell of the roads to measure in; -1 if there is none."""
        free = self.roads.free.values > 0
        start = int(np.where(free, np.linalg.norm(self.road_places - place, axis=1), np.inf).argmin())
        ways = self.ways[start]
        reached = ways < FAR
        self.information[n] = np.nan
        if not reached.any():
            return -1
        if best.spread <= self.model.converged:
            apart = np.where(reached, np.linalg.norm(self.road_places - best.place, axis=1), np.inf)
            goal = int(apart.argmin())
            if goal != start:
                return goal
        reached[start] = False
        within = reached & (ways <= self.model.range)
        candidates = np.flatnonzero(within if within.any() else reached)
        if not len(candidates):
            return -1
        gain = self._information(n, air, self.road_places[candidates])
        gain /= self.pause + ways[candidates] / self.speed
        self.information[n] = gain.max()
        return int(candidates[gain.argmax()])

    def _information(self, n: int, air: list[Dispersion], places: np.ndarray) -> np.ndarray:
        """Return the expected information [nat] of a measurement at each of these points (k, 2) [m]."""
        posterior = self.posteriors[n]
        rates, particles = posterior.draw(DRAWS)
        volume = np.zeros((DRAWS, *self.solid.shape))
        self._layer(volume, self.source_layer)[...] = rates
        for k, model in enumerate(air):
            volume[particles.model == k] = model.concentration(volume[particles.model == k])
        ppm = self.per_rate * self._layer(volume, self.sensor_layer).reshape(DRAWS, -1)
        mean = np.log(ppm[:, posterior.cell_of(places)] + posterior.floor)
        apart = ((places[:, None] - posterior.at) ** 2).sum(axis=-1)
        weight = 1.0 / (1.0 + np.exp(-apart / posterior.correlation**2).sum(axis=1))
        noise = polygamma(1, np.exp(np.median(particles.log_shape))) + polygamma(1, MODEL_SHAPE)
        return 0.5 * np.log1p(weight * mean.var(axis=0) / noise)

    # ------------------------------------------------------------ dispersion

    def _dispersions(self, measured: np.ndarray) -> list[Dispersion]:
        """Return the models of dispersion on the wind that the measurements (k, 5) let expect, by diffusivity."""
        model: Model = self.model
        low, field = self.belief_low, self.floor_wind
        wind = field.mean(measured[:, :2] - low, measured[:, 2:4])
        wind = np.where(np.isnan(wind), measured[:, 2:4].mean(axis=0), wind)
        at = (centers(self.cells, model.cell) / field.cell).astype(int)
        wind = wind[tuple(np.minimum(at, np.array(wind.shape[:2]) - 1).transpose(2, 0, 1))]
        layers = self.solid.shape[2:]
        if layers:  # the same at all heights
            flat = np.concatenate([wind, np.zeros((*self.cells, 1))], axis=-1)
            wind = np.broadcast_to(flat[:, :, None], (*self.solid.shape, 3))
        first = Dispersion(
            wind,
            model.cell,
            self.solid,
            diffusivity=self.diffusivities[0],
            lifetime=model.lifetime,
            depth=self.room.depth,
            open_edges=self.edges,
        )
        return [first.with_diffusivity(value) for value in self.diffusivities]

    @cached_property
    def floor_wind(self) -> FloorWind:
        """Random field of the wind over the floor."""
        low, size = self.belief_low, self.belief_cell * np.array(self.cells)
        parts = np.maximum(1, np.round(size / max(WIND_CELL, self.belief_cell)))
        return FloorWind(
            (size[0], size[1]),
            float((size / parts).min()),
            lambda points: self.clearance.obstacle_distance_at(points + low),
            self._passes_edge,
            observation=WIND_PRECISION,
        )

    def _passes_edge(self, axis: int, side: int, along: np.ndarray, width: float) -> np.ndarray:
        """Return whether air passes the edge of the floor, see `Floor`; edges within the room are open."""
        edge = (self.clearance.low, self.clearance.high)[side][axis]
        if abs(edge - side * self.room.extent[axis]) > 0.5 * width:
            return np.ones(len(along), bool)
        return self.room.passes_edge(axis, side, along + self.belief_low[1 - axis], width)

    @cached_property
    def edges(self) -> list[np.ndarray]:
        """Masks of the cells along each edge of the floor where air passes."""
        masks = []
        for axis in range(2):
            along = (np.arange(self.cells[1 - axis]) + 0.5) * self.belief_cell
            masks += [self._passes_edge(axis, side, along, self.belief_cell) for side in range(2)]
        if self.room.height is not None:
            masks = [np.repeat(mask[:, None], self.solid.shape[2], axis=1) for mask in masks]
            masks += [np.zeros(self.cells, bool)] * 2
        return masks

    @cached_property
    def solid(self) -> np.ndarray:
        """Mask of the cells without air, (nx, ny) or (nx, ny, nz)."""
        model: Model = self.model
        places = centers(self.cells, model.cell) + self.belief_low
        solid = self.clearance.obstacle_distance_at(places) < THICK * model.cell
        if self.room.height is None:
            return solid
        layers = max(1, round(self.room.height / model.cell))
        return np.repeat(solid[:, :, None], layers, axis=2)

    def _layer_at(self, height: float) -> int:
        """Return the index of the layer of cells at a height [m]; 0 in 2-D."""
        return min(int(height / self.belief_cell), self.solid.shape[2] - 1) if self.solid.ndim == 3 else 0

    def _layer(self, values: np.ndarray, layer: int) -> np.ndarray:
        """Return the values (..., nx, ny) in a layer of cells."""
        return values[..., layer] if self.solid.ndim == 3 else values

    def _sensor(self, place: np.ndarray) -> np.ndarray:
        """Return the weights of the cells in a reading at a point (2,) [m]."""
        weights = np.zeros(self.solid.shape)
        inside = np.clip(place - self.belief_low, 0.0, self.belief_cell * np.array(self.cells))
        self._layer(weights, self.sensor_layer)[...] = self.flat.at(inside.tolist())
        return weights

    def _prior(self, start: np.ndarray) -> np.ndarray:
        """Return weights of the source's cell (nx, ny): those of the prior where gas can come to the start [m]."""
        air = ~(self.solid if self.solid.ndim == 2 else self.solid[:, :, 0])
        regions: np.ndarray = ndimage.label(air)[0]
        at = np.clip(((start - self.belief_low) / self.belief_cell).astype(int), 0, np.array(self.cells) - 1)
        here = regions[tuple(at)]
        weights = ((regions == here) if here else air) * prior_weights(self.members, self.belief_cell)
        require_prior(self.members, weights[None])
        return weights
