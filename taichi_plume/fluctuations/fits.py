"""Gamma and lognormal distribution fitted to concentrations within whiffs."""

from typing import NamedTuple

import numpy as np

FEWEST = 50  # samples that a fit needs
LEAST_SPREAD = 1e-3  # least standard deviation of the logarithms; below, the gas is steady
MOST = 100_000  # most samples in a fit, evenly chosen from all


class Fit(NamedTuple):
    """A fitted distribution of concentrations above zero.

    kind: gamma or lognorm of scipy.stats; shape, scale: scipy's parameters; distance: Kolmogorov-Smirnov distance from
    the samples.
    """

    kind: str
    shape: float
    scale: float
    distance: float

    def density(self, c: np.ndarray) -> np.ndarray:
        """Return the probability density of the fitted distribution at concentrations c."""
        from scipy import stats

        return {"gamma": stats.gamma, "lognorm": stats.lognorm}[self.kind].pdf(c, self.shape, 0.0, self.scale)


def fits(within: np.ndarray) -> list[Fit]:
    """Fit a gamma and a lognormal distribution to concentrations (n,) within whiffs by maximum likelihood.

    Return an empty list for too few or constant samples. Samples close in time are correlated, so the distance only
    compares fits and is no significance test. The distributions start at zero, the samples at the threshold: a
    threshold that is not small increases the distance.
    """
    from scipy import stats

    within = np.asarray(within, float)
    within = within[within > 0.0]
    if len(within) < FEWEST or np.std(np.log(within)) < LEAST_SPREAD:
        return []
    sample = within[:: -(-len(within) // MOST)]
    found = []
    for kind, distribution in (("gamma", stats.gamma), ("lognorm", stats.lognorm)):
        shape, _, scale = distribution.fit(sample, floc=0.0)
        distance = stats.ks_1samp(sample, distribution.cdf, args=(shape, 0.0, scale)).statistic
        found.append(Fit(kind, float(shape), float(scale), float(distance)))
    return found
