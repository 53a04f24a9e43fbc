"""Properties that Marjovi & Marques (ICRA 2014) observe in gas maps: gradient to the source, stability, recovery.

The paper states them in words. The definitions are ours; docs/models/maps.md has them as formulas.
"""

import numpy as np

from taichi_plume.scoring.trials import mean_of

BEFORE = 6  # snapshots before a jump that give the usual error: 30 s of 5 s each
JUMP = 2.0  # change of a snapshot over the median of the changes before, from which it is a jump
RECOVERY = 3  # snapshots within which an error has to recover


def gradient_to_source(estimate: np.ndarray, cell: float, source: np.ndarray) -> np.ndarray:
    """Return the fraction (trials,) of cells whose map gradient points to the source, by less than 90 degrees off.

    estimate: (trials, nx, ny), NaN in unknown cells; cell: edge [m]; source: position (2,) [m]. Central differences,
    one-sided at the edges. Cells without a gradient, or with unknown neighbours, do not count. NaN without such cells.
    """
    gradient = np.stack([np.gradient(estimate, axis=axis) for axis in (1, 2)], axis=-1)
    axes = [(np.arange(n) + 0.5) * cell for n in estimate.shape[1:]]
    way = source - np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    counted = np.isfinite(gradient).all(axis=-1) & (gradient != 0.0).any(axis=-1)
    towards = counted & ((np.nan_to_num(gradient) * way).sum(axis=-1) > 0.0)
    return mean_of(towards.sum(axis=(1, 2)), counted.sum(axis=(1, 2)))


def relative_change(before: np.ndarray, now: np.ndarray) -> np.ndarray:
    """Return the mean change (trials,) of a map between snapshots, over the range of its values now.

    before, now: (trials, nx, ny), NaN in unknown cells. Cells known in both count. NaN for a map of one value.
    """
    known = np.isfinite(before) & np.isfinite(now)
    change = np.where(known, np.abs(now - before), 0.0).sum(axis=(1, 2))
    top = np.where(known, now, -np.inf).max(axis=(1, 2))
    bottom = np.where(known, now, np.inf).min(axis=(1, 2))
    spread = np.where(top > bottom, top - bottom, 0.0)
    return mean_of(change, spread * known.sum(axis=(1, 2)))


def recovered_jumps(errors: np.ndarray, changes: np.ndarray) -> tuple[int, int]:
    """Return the number of jumps after which a map's forecast error recovers, and the number of jumps.

    errors: (snapshots,) forecast errors of the map by eq 8; changes: (snapshots,) changes of the gathered data, the
    forecast errors of pure interpolation. A jump is a change of at least JUMP times the median of the BEFORE changes
    before, at which the map's error exceeds its own median over the same snapshots. The error recovers if one of the
    RECOVERY snapshots after the jump has at most the mean of this median and the error at the jump. A jump within
    RECOVERY snapshots after another one, or before the end, does not count.
    """
    jumps = recovered = 0
    n = BEFORE
    while n + RECOVERY < len(errors):
        usual = np.median(errors[n - BEFORE : n])
        if changes[n] >= JUMP * np.median(changes[n - BEFORE : n]) and errors[n] > usual:
            jumps += 1
            recovered += int((errors[n + 1 : n + 1 + RECOVERY] <= 0.5 * (usual + errors[n])).any())
            n += RECOVERY
        n += 1
    return recovered, jumps
