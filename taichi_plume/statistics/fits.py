"""How concentrations are distributed while there is gas: gamma and lognormal distribution."""

from typing import NamedTuple

import numpy as np

FEWEST = 50  # samples that a fit needs
LEAST_SPREAD = 1e-3  # of logarithms, below which the gas is steady
MOST = 100_000  # samples that it takes, even among all


class Fit(NamedTuple):
    """A distribution of concentrations that begins at zero.

    kind: gamma or lognorm, as in scipy.stats; shape and scale: as there, of scipy's parameters. distance:
    Kolmogorov-Smirnov distance between it and the samples.
    """

    kind: str
    shape: float
    scale: float
    distance: float

    def density(self, c: np.ndarray) -> np.ndarray:
        """Its probability density."""
        from scipy import stats

        return getattr(stats, self.kind).pdf(c, self.shape, 0.0, self.scale)


def fits(within: np.ndarray) -> list[Fit]:
    """Gamma and lognormal distribution of concentrations (n,) within whiffs, by maximum likelihood.

    None of too few, or of steady ones.

    Samples near in time are alike, so that the distance has no usual significance: it compares fits. Concentrations are
    those above the threshold, the distributions begin at zero: a threshold that is not small shows in the distance.
    """
    from scipy import stats

    within = np.asarray(within, float)
    within = within[within > 0.0]
    if len(within) < FEWEST or np.std(np.log(within)) < LEAST_SPREAD:
        return []
    some = within[:: -(-len(within) // MOST)]
    found = []
    for kind in ("gamma", "lognorm"):
        one = getattr(stats, kind)
        shape, _, scale = one.fit(some, floc=0.0)
        distance = stats.ks_1samp(some, one.cdf, args=(shape, 0.0, scale)).statistic
        found.append(Fit(kind, float(shape), float(scale), float(distance)))
    return found
