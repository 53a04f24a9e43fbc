"""Posterior of the places, the strengths and the number of gas sources, by a sequential Monte Carlo sampler.

Each particle has n sources of places x_j and rates q_j. With the response a_k of the k-th measurement (see
`dispersion`) its mean reading would be m_k = Σ_j q_j a_k(x_j) + floor. The likelihood of a reading d_k (floor
included) is that of

    d = m (G / s) / (H / exp ψ(m0)),    G ~ Gamma(s),  H ~ Gamma(m0)

whiffs in the measured time whose mean varies as a gamma variable of shape s (Yee & Chan 1997, Atmospheric Environment
31, 991-1002), about a mean that the model knows up to an inverse gamma variable of shape m0. The ratio has a scaled F
distribution: its tails are power laws, so that neither a miss in the plume nor a hit beside it rules out a place.
s is a parameter of each particle. A detection, or a count of k in n samples above a threshold, has the binomial law
with the probability that d is above the threshold.

Priors: places by a map of cells; rates log-uniform or log-normal; each further source is a quarter as probable. Errors
of the mean wind and of the diffusivity are common to measurements that lie close together: a measurement counts
1 / Σ_i exp(-(d_i / correlation)²), i over all measurements, at distances d_i, itself included. This weight is ours, as
are the law's combination and the choice of moves.

Sampler: after each measurement the particles are weighted by the change of their likelihood, in steps of an
exponent that keep enough particles effective (Del Moral, Doucet & Jasra 2006,
doi:10.1111/j.1467-9868.2006.00553.x), resampled systematically, and moved by Metropolis steps: differential evolution
(ter Braak 2006, doi:10.1007/s11222-006-8769-1) of a source, its rate or s, and births and deaths of sources (Green
1995, doi:10.1093/biomet/82.4.711). Hutchinson, Oh & Chen 2017 (doi:10.1016/j.inffus.2016.11.010) review such
estimates of source terms.
"""

from itertools import permutations
from typing import NamedTuple

import numpy as np
from scipy.special import betainc, betaln, digamma

MODEL_SHAPE = 4.0  # m0: a factor of 1.7 between a model's mean and the true one, as standard deviation
MODEL_SCALE = float(np.exp(digamma(MODEL_SHAPE)))  # makes the geometric mean of the factors 1
SHAPE_MEAN, SHAPE_SPREAD = 0.0, 0.7  # of ln s, normal
SWEEPS = 2  # of Metropolis steps after a resampling
STEP = 0.3  # cells, or of a logarithm: smallest random step
LEAPS = 0.1  # chance that differential evolution adds a whole difference
FEWER = 0.25  # prior probability of n + 1 sources over that of n
SHARE_EFFECTIVE = 0.3  # least effective number of particles in a step, over their number
LEAST_EXPONENT = 0.02  # smallest step of the exponent
LEAST = 1e-6  # least probability of a count
INTERVAL = (0.05, 0.95)  # quantiles of strengths


class Rates(NamedTuple):
    """Prior of the rate of a source: log-uniform between low and high [kg/s], or log-normal about a median.

    median, factor: median [kg/s], None for log-uniform, and factor of a standard deviation.
    """

    low: float
    high: float
    median: float | None = None
    factor: float = 1.0

    def draw(self, rng: np.random.Generator, size: tuple[int, ...]) -> np.ndarray:
        """Return logarithms of random rates."""
        if self.median is not None:
            return np.log(self.median) + np.log(self.factor) * rng.normal(size=size)
        return rng.uniform(np.log(self.low), np.log(self.high), size)

    def log_density(self, log_rate: np.ndarray) -> np.ndarray:
        """Return the logarithm of the prior density of logarithms of rates, up to a constant."""
        if self.median is not None:
            return -0.5 * ((log_rate - np.log(self.median)) / np.log(self.factor)) ** 2
        inside = (log_rate >= np.log(self.low)) & (log_rate <= np.log(self.high))
        return np.where(inside, 0.0, -np.inf)


class Estimate(NamedTuple):
    """Estimate of a source: place (2,) [m], its spread [m], rate [kg/s] with an interval of 90 %, and the probability
    of at least so many sources."""

    place: np.ndarray
    spread: float
    rate: float
    low: float
    high: float
    probability: float


def log_likelihood(reading: np.ndarray, mean: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """Return the log density of readings about model means, all with the floor [ppm]; shape: s. They broadcast."""
    scale = MODEL_SCALE / shape
    x = reading / (mean * scale)
    return (
        (shape - 1.0) * np.log(x)
        - (shape + MODEL_SHAPE) * np.log1p(x)
        - betaln(shape, MODEL_SHAPE)
        - np.log(mean * scale)
    )


def exceedance(threshold: float, mean: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """Return the probability of a reading above the threshold, both with the floor [ppm]."""
    x = threshold / mean * shape / MODEL_SCALE
    return 1.0 - betainc(shape, MODEL_SHAPE, x / (1.0 + x))


class Particles(NamedTuple):
    """Particles: number of sources (n,), their places (n, most, 2) [m], log rates (n, most), log shapes ln s (n,), and
    the index of the model of dispersion (n,). Rows of sources from `number` on have no meaning.
    """

    number: np.ndarray
    place: np.ndarray
    log_rate: np.ndarray
    log_shape: np.ndarray
    model: np.ndarray

    @property
    def exists(self) -> np.ndarray:
        """Mask (n, most) of the sources that exist."""
        return np.arange(self.place.shape[1]) < self.number[:, None]

    @property
    def rate(self) -> np.ndarray:
        """Rates (n, most) [kg/s], 0 where there is no source."""
        return np.where(self.exists, np.exp(self.log_rate), 0.0)

    def take(self, chosen: np.ndarray) -> "Particles":
        """Return the particles with these numbers."""
        return Particles(*(part[chosen] for part in self))

    def where(self, accepted: np.ndarray, other: "Particles") -> "Particles":
        """Return the particles of `other` where `accepted` (n,), else these."""
        pairs = zip(self, other, strict=True)
        return Particles(*(np.where(accepted.reshape(-1, *[1] * (a.ndim - 1)), b, a) for a, b in pairs))


class SourcePosterior:
    """Weighted particles of source terms, given measurements.

    prior: probability of a source in each cell (nx, ny), zero where there can be none. low, cell: lower corner (2,) and
    edge of the cells [m]. most: largest number of sources. floor: reading [ppm] below which differences do not count.
    threshold: None for the likelihood of readings; else counts of samples above this reading [ppm]. correlation: length
    [m] over which model errors are alike.
    """

    STATE = ("rng", "particles", "likelihood", "used", "response", "at", "reading", "samples", "prior")

    def __init__(
        self,
        prior: np.ndarray,
        low: np.ndarray,
        cell: float,
        rates: Rates,
        rng: np.random.Generator,
        *,
        particles: int = 500,
        most: int = 1,
        floor: float = 1.0,
        threshold: float | None = None,
        correlation: float = 0.25,
        models: int = 1,
    ):
        self.cells, self.low, self.cell = prior.shape, np.asarray(low, float), cell
        self.rates, self.rng, self.size, self.most = rates, rng, particles, most
        self.floor, self.threshold, self.correlation = floor, threshold, correlation
        self.prior = prior.ravel() / prior.sum()
        self.response, self.samples = np.zeros((models, 0, prior.size)), 1
        self.at, self.reading = np.zeros((0, 2)), np.zeros(0)
        self.used = np.zeros(0)  # weights of the measurements in `likelihood`
        self.particles = self._drawn(particles)
        self.likelihood = np.zeros(particles)

    # ------------------------------------------------------------ measurements

    def learn(self, at: np.ndarray, reading: np.ndarray, response: np.ndarray, samples: int = 1) -> None:
        """Update the posterior to all measurements up to now, the earlier ones in the same order.

        at: points (k, 2) [m]; reading: mean readings (k,) [ppm], or counts of so many `samples` above the threshold;
        response: by each model, of each measurement to a source of unit rate in each cell, (models, k, nx, ny)
        [ppm/(kg/s)].
        """
        self.at, self.reading = np.asarray(at, float), np.asarray(reading, float)
        self.response, self.samples = response.reshape(*response.shape[:2], -1), samples
        self.update()

    def rule_out(self, cells: np.ndarray) -> None:
        """Exclude cells (nx, ny) of the floor, in which a source would have been found. Ignored if nothing is left."""
        left = np.where(cells.ravel(), 0.0, self.prior)
        if left.sum() > 0.0:
            self.prior = left / left.sum()

    def update(self) -> None:
        """Weight, resample and move the particles after measurements, responses or the prior have changed."""
        after = self.weights()
        before = np.concatenate([self.used, np.zeros(len(after) - len(self.used))])
        self.used = after
        old = self._terms(self.particles) @ before
        allowed = np.isfinite(self._log_prior(self.particles))
        if not allowed.any():  # all are ruled out
            self.particles = self._drawn(self.size)
        elif not allowed.all() or not np.allclose(old, self.likelihood):
            self._resample(np.where(allowed, old - self.likelihood, -np.inf))
        done = 0.0
        while done < 1.0:
            change = self._terms(self.particles) @ (after - before)
            part = self._exponent(change, 1.0 - done)
            done = done + part if done + part < 1.0 - 1e-9 else 1.0
            self._resample(part * change)
            self._move(before + done * (after - before))

    def weights(self) -> np.ndarray:
        """Return the weight of each measurement: those that are close together share their model errors."""
        apart = ((self.at[:, None] - self.at) ** 2).sum(axis=-1)
        return 1.0 / np.exp(-apart / self.correlation**2).sum(axis=1)

    # ------------------------------------------------------------ results

    def probability(self) -> np.ndarray:
        """Return the expected share of the sources in each cell, (nx, ny); the sum is 1."""
        exists = self.particles.exists
        share = np.where(exists, 1.0 / exists.sum(axis=1, keepdims=True), 0.0)
        total = np.bincount(self.cell_of(self.particles.place).ravel(), share.ravel(), self.prior.size)
        return (total / total.sum()).reshape(self.cells)

    def estimates(self) -> list[Estimate]:
        """Return estimates of the sources of the most probable number, the surest first."""
        numbers = np.bincount(self.particles.number, minlength=self.most + 1)
        number = int(numbers.argmax())
        of = self.particles.number == number
        place, log_rate = self.particles.place[of, :number], self.particles.log_rate[of, :number]
        middle = place[np.argmax(self.likelihood[of])]
        for _ in range(10):  # sources have no order: match each particle's sources to the middles
            order = _matched(place, middle)
            middle = np.take_along_axis(place, order[..., None], axis=1).mean(axis=0)
        place = np.take_along_axis(place, order[..., None], axis=1)
        log_rate = np.take_along_axis(log_rate, order, axis=1)
        spread = np.sqrt(((place - middle) ** 2).sum(axis=-1).mean(axis=0))
        low, rate, high = np.exp(np.quantile(log_rate, (INTERVAL[0], 0.5, INTERVAL[1]), axis=0))
        surest = np.argsort(spread)
        at_least = numbers[::-1].cumsum()[::-1] / self.size
        return [
            Estimate(middle[n], *(float(x) for x in (spread[n], rate[n], low[n], high[n], at_least[k + 1])))
            for k, n in enumerate(surest)
        ]

    def draw(self, count: int) -> tuple[np.ndarray, Particles]:
        """Return the rates in cells of some of the particles, (count, nx, ny) [kg/s], and these particles."""
        part = self.particles.take(np.linspace(0, self.size - 1, count).astype(int))
        rates, cells = np.zeros((count, self.prior.size)), self.cell_of(part.place)
        np.add.at(rates, (np.arange(count)[:, None], cells), part.rate)
        return rates.reshape(count, *self.cells), part

    # ------------------------------------------------------------ densities

    def cell_of(self, place: np.ndarray) -> np.ndarray:
        """Return the number of the cell of each point (..., 2) [m]; that of the nearest cell beyond the edges."""
        at = np.clip(((place - self.low) / self.cell).astype(int), 0, np.array(self.cells) - 1)
        return at[..., 0] * self.cells[1] + at[..., 1]

    def _log_prior(self, of: Particles) -> np.ndarray:
        """Return the log prior density of particles up to a constant, (n,)."""
        with np.errstate(divide="ignore"):
            each = np.log(self.prior)[self.cell_of(of.place)] + self.rates.log_density(of.log_rate)
        beyond = ((of.place < self.low) | (of.place >= self.low + self.cell * np.array(self.cells))).any(
            axis=-1
        )
        each = np.where(beyond, -np.inf, each)
        shape = -0.5 * ((of.log_shape - SHAPE_MEAN) / SHAPE_SPREAD) ** 2
        return np.where(of.exists, each, 0.0).sum(axis=1) + shape

    def _terms(self, of: Particles) -> np.ndarray:
        """Return the log likelihood of each measurement by each particle, (n, measurements)."""
        response = self.response[of.model[:, None], :, self.cell_of(of.place)]  # (n, most, measurements)
        mean = (response * of.rate[..., None]).sum(axis=1) + self.floor
        shape = np.exp(of.log_shape)[:, None]
        if self.threshold is None:
            return log_likelihood(self.reading + self.floor, mean, shape)
        hit = np.clip(exceedance(self.threshold + self.floor, mean, shape), LEAST, 1.0 - LEAST)
        return self.reading * np.log(hit) + (self.samples - self.reading) * np.log1p(-hit)

    # ------------------------------------------------------------ sampler

    def _drawn(self, count: int) -> Particles:
        """Return particles drawn from the prior."""
        cell = self.rng.choice(self.prior.size, (count, self.most), p=self.prior)
        corner = np.stack([cell // self.cells[1], cell % self.cells[1]], axis=-1)
        place = self.low + self.cell * (corner + self.rng.random((count, self.most, 2)))
        chance = FEWER ** np.arange(self.most)
        number = self.rng.choice(self.most, count, p=chance / chance.sum()) + 1
        shape = SHAPE_MEAN + SHAPE_SPREAD * self.rng.normal(size=count)
        model = self.rng.integers(0, len(self.response), count)
        return Particles(number, place, self.rates.draw(self.rng, (count, self.most)), shape, model)

    def _exponent(self, change: np.ndarray, most: float) -> float:
        """Return the largest exponent up to `most` that keeps enough of the particles effective."""

        def keeps(part: float) -> bool:
            w = np.exp(part * (change - change.max()))
            return w.sum() ** 2 >= SHARE_EFFECTIVE * self.size * (w**2).sum()

        if keeps(most):
            return most
        low, high = 0.0, most
        for _ in range(20):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if keeps(middle) else (low, middle)
        return max(low, LEAST_EXPONENT)

    def _resample(self, log_weight: np.ndarray) -> None:
        """Resample the particles systematically by their log weights (n,)."""
        total = np.exp(log_weight - log_weight.max()).cumsum()
        mark = (np.arange(self.size) + self.rng.random()) / self.size
        chosen = np.searchsorted(total / total[-1], mark).clip(0, self.size - 1)
        self.particles = self.particles.take(self.rng.permutation(chosen))

    def _move(self, weights: np.ndarray) -> None:
        """Move the particles by Metropolis steps, by the likelihood with these weights of the measurements."""
        density = self._log_prior(self.particles) + self._terms(self.particles) @ weights
        steps = [self._evolved, self._evolved, self._rescaled] + [self._born] * (self.most > 1)
        for step in steps * SWEEPS:
            other, log_ratio = step(self.particles)
            there = self._log_prior(other) + self._terms(other) @ weights
            accepted = np.log(self.rng.random(self.size)) < there - density + log_ratio
            self.particles = self.particles.where(accepted, other)
            density = np.where(accepted, there, density)
        self.likelihood = self._terms(self.particles) @ weights

    def _evolved(self, of: Particles) -> tuple[Particles, np.ndarray]:
        """Propose a source moved by the difference of two other particles' sources, or drawn from the prior."""
        rng, n = self.rng, self.size
        row = np.arange(n)
        source = (rng.random(n) * of.number).astype(int)
        a, b = rng.integers(0, n, (2, n))
        first, second = ((k, (rng.random(n) * of.number[k]).astype(int)) for k in (a, b))
        scale = np.where(rng.random(n) < LEAPS, 1.0, rng.random(n))
        place, log_rate = of.place.copy(), of.log_rate.copy()
        noise = STEP * self.cell * rng.normal(size=(n, 2))
        place[row, source] += scale[:, None] * (of.place[first] - of.place[second]) + noise
        log_rate[row, source] += scale * (of.log_rate[first] - of.log_rate[second]) + STEP * rng.normal(
            size=n
        )
        return of._replace(place=place, log_rate=log_rate), np.zeros(n)

    def _rescaled(self, of: Particles) -> tuple[Particles, np.ndarray]:
        """Propose other rates of all sources, by a common factor, another shape, and another model of dispersion."""
        factor = self.rng.normal(size=(self.size, 1))
        log_shape = of.log_shape + STEP * self.rng.normal(size=self.size)
        other = self.rng.integers(0, len(self.response), self.size)
        model = np.where(self.rng.random(self.size) < 0.5, other, of.model)
        return Particles(of.number, of.place, of.log_rate + STEP * factor, log_shape, model), np.zeros(
            self.size
        )

    def _born(self, of: Particles) -> tuple[Particles, np.ndarray]:
        """Propose one more source, drawn from the prior, or one less; the sources have no order."""
        n, row = self.size, np.arange(self.size)
        birth = self.rng.random(n) < 0.5
        fresh = self._drawn(n)
        number = of.number + np.where(birth, 1, -1)
        possible = (number >= 1) & (number <= self.most)
        number = np.where(possible, number, of.number)
        place, log_rate = of.place.copy(), of.log_rate.copy()
        last = np.minimum(of.number, self.most - 1)  # of the new source
        born = birth & possible
        place[row[born], last[born]], log_rate[row[born], last[born]] = (
            fresh.place[born, 0],
            fresh.log_rate[born, 0],
        )
        dies = ~birth & possible  # the last source takes the number of the one that dies
        which, end = (self.rng.random(n) * of.number).astype(int), of.number - 1
        place[row[dies], which[dies]] = of.place[row[dies], end[dies]]
        log_rate[row[dies], which[dies]] = of.log_rate[row[dies], end[dies]]
        other = of._replace(number=number, place=place, log_rate=log_rate)
        # the densities of the proposal and of the prior of the source that is born or dies cancel out
        prior = self._log_prior(other) - self._log_prior(of)
        ratio = np.where(birth, np.log(FEWER), -np.log(FEWER)) - np.nan_to_num(prior, neginf=0.0, posinf=0.0)
        return other, np.where(possible, ratio, -np.inf)


def _matched(place: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Return the order of each particle's sources (n, sources, 2) that is nearest to the middles (sources, 2)."""
    orders = np.array(list(permutations(range(len(middle)))))
    apart = ((place[:, orders] - middle) ** 2).sum(axis=(2, 3))
    return orders[apart.argmin(axis=1)]
