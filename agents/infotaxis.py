"""Infotaxis: move to where a detection or miss is expected to reduce the entropy of the posterior most.

Vergassola, Villermaux & Shraiman, Nature 445 (2007) 406-409, doi:10.1038/nature05464.

ACQUIRE  stand still; a mean reading at the threshold or above is a detection, and the belief is updated by it
MOVE     drive by a step in one of four directions, or stay, whichever has the least expected entropy

The belief is a map of posterior probabilities over the cells of the search area. The likelihood of a detection of a
source at a displacement r from the robot is 1 - exp(-R(r) T) in an acquisition of T seconds; along and across the
mean wind V

    R = rate / ln(lambda/a) exp(-V r_along/2D) K0(|r|/lambda),  lambda = sqrt(D tau/(1 + V² tau/4D))

for a searcher of size a in a plane with an effective diffusivity D and a lifetime tau of gas patches. If a search ends
by reaching a source, a continued search rules out the cells that are wholly within reach. With a reach of about a cell
this is the published update, which rules out visited cells.
"""

from math import hypot, log, pi

import numpy as np
from scipy.special import k0e

from taichi_plume.agents.acquisition import MEAN, Acquisition
from taichi_plume.agents.beliefs import LEAST, SPREAD, Beliefs, Declaring
from taichi_plume.agents.decisions import Decision
from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.parameters import Numbers
from taichi_plume.agents.path_segments import Legs
from taichi_plume.agents.shared_readings import SharedReadings, TeamInference
from taichi_plume.agents.swarm import wrap
from taichi_plume.engine import ti
from taichi_plume.grid.rng import uniform4
from taichi_plume.scenario import belief_algorithms

ACQUIRE, MOVE = range(2)

STAY = 4  # number of the move "stay"; moves 0 to 3 are each 90° further left
FINER = 2  # nodes of the likelihood table per cell
NEAR = 1e-3  # steps, the smallest D + 2^(H - 1) - 1/2 of space-aware infotaxis


def detection_rate(
    model: belief_algorithms.AnyInfotaxis, along: np.ndarray, across: np.ndarray
) -> np.ndarray:
    """Return the rate R [1/s] of detections from a source at (along, across) [m] from the robot, `along` downwind."""
    D, V, reach = model.diffusivity, model.wind_speed, model.reach
    r = np.maximum(np.hypot(along, across), model.size)
    return model.rate / log(reach / model.size) * np.exp(-V * along / (2.0 * D) - r / reach) * k0e(r / reach)


class AnyInfotaxis(TeamInference):
    """Base class of infotaxis algorithms for the robots of a group, each with its own belief.

    A subclass defines the `_cost` of an acquisition at a position. tick: control period [s].
    """

    PER_GROUP: bool = True  # has a single table of probabilities and size of cells
    STREAM = "infotaxis"
    WORK = 4
    STATE: tuple[str, ...] = (
        *("legs", "acquisition", "declaring", "belief", "downwind", "detection", "entropy", "cost", "move"),
        "readings",
    )
    STATE_NAMES: tuple[str, ...] = ("ACQUIRE", "MOVE")
    DECISIONS: tuple[Decision, ...] = (
        MEAN,
        Decision("detection", "1", "1: the last acquisition was a detection, 0: not"),
        Decision("entropy", "nat", "entropy of the belief after the last acquisition"),
        SPREAD,
        Decision("chosen_move", "1", "direction of the chosen move, in units of 90°; 4: stay", "move"),
    )

    def _allocate(self) -> None:
        super()._allocate()
        self.legs = Legs(self.members, self.p)
        self.acquisition = Acquisition(self.members, self.p)
        self.declaring = Declaring(self.members, self.p)
        self.belief = Beliefs(self.members, self.model.cell)
        self.belief_cell, self.belief_low = self.belief.cell, np.array(self.belief.low)
        self.spacing = self.belief_cell / FINER
        self.half = int(np.ceil(hypot(*self.belief.extent) / self.spacing)) + 1
        self.chance = ti.filled(self._chances())
        self.downwind = ti.vector_field(2, ti.f32, self.size)  # mean of the measured wind so far
        self.detection, self.entropy, self.cost, self.move = (
            ti.filled(np.full(self.size, np.nan), ti.f32) for _ in range(4)
        )  # of the last acquisition; NaN before

    def numbers(self, group: GroupRange, model: belief_algorithms.AnyInfotaxis) -> Numbers:
        return {
            **Legs.numbers(group, model.speed),
            **Acquisition.numbers(group, self.tick),
            **Declaring.numbers(model, group),
            **SharedReadings.numbers(group, self.tick),
            "threshold": model.threshold_ppm,
            "step": model.step,  # m
        }

    def _chances(self) -> np.ndarray:
        """Return a table of detection likelihoods over the source's displacement, along and across the wind."""
        places = (np.arange(2 * self.half + 1) - self.half) * self.spacing
        rate = detection_rate(self.model, *np.meshgrid(places, places, indexing="ij"))
        return -np.expm1(-rate * self.model.acquisition)

    def beliefs(self) -> np.ndarray:
        return self.belief.p.to_numpy()

    @ti.func
    def _measure(self, n, tick):
        i = self.robot[n]
        if self.swarm.wind_known[i] == 1:
            self.downwind[n] += self.swarm.wind[i]
        if self.swarm.state[i] == ACQUIRE:
            if self.acquisition.listen(n):
                detected = self.acquisition.mean(n) >= self.p.threshold[n]
                self.swarm.hits[i] += ti.cast(detected, ti.i32)
                self.readings.end(n, tick, ti.cast(detected, ti.f32), self._wind_axis(n))

    @ti.func
    def _proceed(self, n, tick, t, dt):
        i = self.robot[n]
        if self.readings.ended[n] == 1:
            self.detection[n], self.entropy[n] = self.readings.value[n], self.belief.entropy(n)
            mean = self.belief.mean(n)
            spread = self.belief.spread(n, mean)
            self.declaring.consider(n, mean + ti.Vector(self.belief.low), spread, t)
            self._choose(n, tick)
        if self.swarm.state[i] == MOVE and not self.legs.advance(n, dt):
            self.swarm.state[i] = ACQUIRE

    @ti.func
    def _wind_axis(self, n):
        """Return the unit vector downwind by robot n's measurements; along x until wind is measured."""
        v = self.downwind[n]
        length = v.norm()
        e = ti.Vector([1.0, 0.0])
        if length > 0.0:
            e = v / length
        return e

    @ti.func
    def _place(self, n):
        """Return the believed position of robot n relative to the lower corner of the search area (2,) [m]."""
        return self.swarm.believed_position[self.robot[n]] - ti.Vector(self.belief.low)

    @ti.func
    def _chance_at(self, r, e):
        """Return the likelihood of detecting a source at a displacement r [m] from the robot, with the wind along e."""
        along = (r[0] * e[0] + r[1] * e[1]) / self.spacing + self.half
        across = (r[1] * e[0] - r[0] * e[1]) / self.spacing + self.half
        k = ti.math.clamp(ti.cast(along + 0.5, ti.i32), 0, 2 * self.half)
        m = ti.math.clamp(ti.cast(across + 0.5, ti.i32), 0, 2 * self.half)
        return self.chance[k, m]

    @ti.func
    def _learn(self, n, k):
        p, e = self.readings.place[k] - ti.Vector(self.belief.low), self.readings.wind[k]
        detected = self.readings.value[k] > 0.0
        total = 0.0
        for a in range(self.belief.cells[0]):
            for b in range(self.belief.cells[1]):
                r = self.belief.middle(a, b) - p
                chance = self._chance_at(r, e)
                now = self.belief.p[n, a, b] * ti.select(detected, chance, 1.0 - chance)
                if self.belief.is_within(r, self.p.ends_at[n]):
                    now = 0.0
                self.belief.p[n, a, b] = now
                total += now
        self.belief.normalize(n, total)

    @ti.func
    def _outcomes(self, n, p):
        """Return sums over the two possible outcomes (rows: detection, no detection) of an acquisition of robot n at p.

        Each row has the probability w of the outcome, the sum of q ln q over the cells and the sum of q times the
        distance to the cell along the axes [m]; q: joint probability of the outcome and the cell. The remaining
        probability, one minus both w, is that of finding the source.
        """
        e = self._wind_axis(n)
        sums = ti.Matrix.zero(ti.f32, 2, 3)
        for a in range(self.belief.cells[0]):
            for b in range(self.belief.cells[1]):
                r = self.belief.middle(a, b) - p
                if not self.belief.is_within(r, self.p.ends_at[n]):
                    chance, now = self._chance_at(r, e), self.belief.p[n, a, b]
                    way = ti.abs(r[0]) + ti.abs(r[1])
                    for k in ti.static(range(2)):
                        q = now * (chance if k == 0 else 1.0 - chance)
                        sums[k, 0] += q
                        sums[k, 1] += q * ti.log(ti.max(q, LEAST))
                        sums[k, 2] += q * way
        return sums

    @ti.func
    def _draw(self, n, tick):
        return uniform4(self.swarm.key[None], self.p.stream[n], self.number[n], tick, 0)

    @ti.func
    def _best(self, n, tick):
        """Return robot n's move with the least cost (0 to 3, or STAY); among equal costs a random one."""
        i = self.robot[n]
        here = self._place(n)
        turn = ti.floor(self._draw(n, tick)[0] * 4.0)
        best, least = -1, 1e30
        for k in range(STAY + 1):
            move = ti.cast((k + turn) % 4, ti.i32)
            angle = 0.5 * pi * move
            target = here + self.p.step[n] * ti.Vector([ti.cos(angle), ti.sin(angle)])
            if k == STAY:
                move, target = STAY, here
            room = self.swarm.radius[i]
            for d in ti.static(range(2)):
                room = ti.min(room, ti.min(target[d], self.belief.extent[d] - target[d]))
            if room == self.swarm.radius[i] or move == STAY:
                cost = self._cost(n, target)
                if cost < least - 1e-6:
                    best, least = move, cost
        self.cost[n], self.move[n] = least, ti.cast(best, ti.f32)
        return best

    @ti.func
    def _choose(self, n, tick):
        """Start robot n's best move, unless the best move is to stay."""
        i, best = self.robot[n], self._best(n, tick)
        if best != STAY:
            turn_by = wrap(0.5 * pi * best - self.swarm.believed_heading[i])
            side = ti.select(self._draw(n, tick)[1] > 0.5, 1.0, -1.0)
            self.legs.set_out(n, turn_by, self.p.step[n], side)
            self.swarm.state[i] = MOVE


class Infotaxis(AnyInfotaxis):
    """Infotaxis search algorithm for the robots of a group, each with its own belief."""

    DECISIONS: tuple[Decision, ...] = (
        *AnyInfotaxis.DECISIONS,
        Decision("expected_entropy", "nat", "expected entropy after the chosen move and acquisition", "cost"),
        Decision("expected_gain", "nat", "entropy less expected entropy", "expected_gain"),
    )

    @property
    def expected_gain(self) -> np.ndarray:
        """Expected reduction of the entropy by the chosen move of each robot, (size,) [nat]."""
        return self.entropy.values - self.cost.values

    @ti.func
    def _cost(self, n, p):
        """Return the expected entropy [nat] of robot n's belief after an acquisition at p; 0 for finding the source."""
        outcome = self._outcomes(n, p)
        cost = 0.0
        for k in ti.static(range(2)):
            cost += outcome[k, 0] * ti.log(ti.max(outcome[k, 0], LEAST)) - outcome[k, 1]
        return cost


class SpaceAwareInfotaxis(AnyInfotaxis):
    """Space-aware infotaxis, which also prefers positions near the source.

    Loisy & Eloy, Proc. R. Soc. A 478 (2022) 20220118, doi:10.1098/rspa.2022.0118. A move minimises the mean over the
    outcomes of the acquisition, a detection or none, of

        J = log2(D + 2^(H - 1) - 1/2),

    0 if the source is found. D is the mean distance to the source along the axes, in steps, and 2^H the number of
    positions among which a uniform belief has the entropy H [bit]. In the paper a position is a step wide; here a cell
    counts as the part of a step that it covers, and all cells as one position at least.
    """

    DECISIONS: tuple[Decision, ...] = (
        *AnyInfotaxis.DECISIONS,
        Decision("expected_cost", "1", "expected J after the chosen move and acquisition", "cost"),
    )

    @ti.func
    def _cost(self, n, p):
        """Return the mean of J over the outcomes of an acquisition of robot n at p (2,) [m]."""
        outcome = self._outcomes(n, p)
        step = self.p.step[n]
        cost = 0.0
        for k in ti.static(range(2)):
            w = outcome[k, 0]
            if w > LEAST:
                entropy = ti.log(w) - outcome[k, 1] / w  # nat
                places = ti.max(1.0, ti.exp(entropy) * (self.belief.cell / step) ** 2)
                cost += (
                    w * ti.log(ti.max(outcome[k, 2] / (w * step) + 0.5 * places - 0.5, NEAR)) / ti.log(2.0)
                )
        return cost
