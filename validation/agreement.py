"""Agreement of computed with measured values at the same points, as models of dispersion are judged.

FAC2, fractional bias, normalised mean square error: Chang & Hanna 2004 (doi:10.1007/s00703-003-0070-7), who find that
good models reach FAC2 >= 0.5, a fractional bias within 0.3 and an error of at most 4. Hit rate: VDI 3783-9 (2017),
which asks for 0.66.
"""

import numpy as np


def above(limit: float, measured: np.ndarray, computed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the pairs of concentrations (n,) of which one exceeds the limit of detection; smaller ones become it."""
    pairs = (measured > limit) | (computed > limit)
    return np.maximum(measured[pairs], limit), np.maximum(computed[pairs], limit)


def fac2(measured: np.ndarray, computed: np.ndarray) -> float:
    """Return the fraction of points (n,) at which the computed value is 0.5 to 2 times the measured one."""
    return float(np.mean((computed >= 0.5 * measured) & (computed <= 2.0 * measured)))


def fractional_bias(measured: np.ndarray, computed: np.ndarray) -> float:
    """Return 2 (<m> - <c>) / (<m> + <c>) of measured and computed values (n,): positive if computed is too low."""
    m, c = float(measured.mean()), float(computed.mean())
    return 2.0 * (m - c) / (m + c)


def nmse(measured: np.ndarray, computed: np.ndarray) -> float:
    """Return the mean square of the difference of values (n,) over the product of their means."""
    return float(np.mean((measured - computed) ** 2) / (measured.mean() * computed.mean()))


def hit_rate(measured: np.ndarray, computed: np.ndarray, least: float, relative: float = 0.25) -> float:
    """Return the fraction of values whose difference is within `relative` of the measured one, or within `least`."""
    return float(np.mean(np.abs(computed - measured) <= np.maximum(relative * np.abs(measured), least)))
