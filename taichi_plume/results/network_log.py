"""Log of PlumeSim with the readings of a sensor network: fixed probes, or robots that never move, as its nodes.

Each frame of the log holds a node's wind and gas at one time of the run's table, until the next. The first row of the
table is at time 0 of the log; of robots that is the first one in which sensors have read.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Literal

import numpy as np

from taichi_plume.files.plumesim_log import frame, header
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.results.run import FILES, Run

if TYPE_CHECKING:
    import pandas

NEEDED = ("t", "x", "y", "wind_x", "wind_y")  # columns of the table
STEADY = 1e-3  # of a period: differences between the times of rows that count as rounding


def log_of(
    run: Run,
    *,
    source: Literal["probes", "robots"] | None = None,
    trial: int | None = None,
    full_scale: float = 100.0,
    cell: float | None = None,
) -> Iterator[str]:
    """Yield the text of the log of a run's nodes: its first line, then its frames. Raises RunFolderError.

    source: table of the nodes, by default the probes if any; trial: of robots, by default 0; full_scale: concentration
    [ppm] that is 100 percent; cell: distance [m] up to which a node counts, by default the largest to a nearest
    neighbour.
    """
    of_probes = source == "probes" or (source is None and any(map(run.has, FILES["probes"])))
    if of_probes and trial is not None:
        raise RunFolderError(f"{run.folder}: probes are of no trial; leave out --trial, or add --from robots")
    rows = run.probes if of_probes else _standing(run, trial or 0)
    gases = [name for name in rows if str(name).endswith("_ppm")] if of_probes else ["reading_ppm"]
    lacking = [name for name in (*NEEDED, *gases) if name not in rows]
    if lacking or not gases:
        raise RunFolderError(f"{run.folder}: the table of the nodes has no {', '.join(lacking) or 'gas'}")
    heights = np.unique(rows["z"].dropna()) if "z" in rows else np.zeros(1)
    if len(heights) > 1:
        span = f"{heights[0]:g} to {heights[-1]:g} m"
        raise RunFolderError(f"{run.folder}: the nodes are at heights from {span}; a log is of one height")
    rows = rows.sort_values("t", kind="stable")
    t, begin = np.unique(rows["t"].to_numpy(), return_index=True)
    period = _period(run, t)
    place = rows[["x", "y"]].to_numpy(float)
    wind = rows[["wind_x", "wind_y"]].to_numpy(float)
    percent = 100.0 / full_scale * rows[gases].to_numpy(float).sum(axis=1)
    yield header(period, len(t), cell or _spacing(run, place))
    for n, (a, b) in enumerate(zip(begin, [*begin[1:], len(rows)], strict=True), 1):
        yield frame(n, place[a:b], wind[a:b], percent[a:b])


def _standing(run: Run, trial: int) -> "pandas.DataFrame":
    """Return the rows of a trial's robots that never move. Raises RunFolderError."""
    robots = run.robots
    robots = robots[robots["trial"] == trial]
    if robots.empty:
        raise RunFolderError(f"{run.folder}: has no trial {trial}; trials are numbered from 0 on")
    places = robots.groupby(["group", "robot"], observed=True)[["x", "y"]]
    stands = (places.transform("max") == places.transform("min")).all(axis=1)
    if not stands.any():
        raise RunFolderError(
            f"{run.folder}: has no nodes: every robot moves; give nodes of a network speed: 0"
        )
    return robots.loc[stands & (robots["t"] > robots["t"].min())]  # at first no sensor has read


def _period(run: Run, t: np.ndarray) -> float:
    """Return the time [s] between the rows at times t. Raises RunFolderError if it is uneven."""
    steps = np.diff(t)
    if not len(steps):
        raise RunFolderError(f"{run.folder}: has rows of one time only; a log needs two or more")
    period = float(np.median(steps))
    if np.ptp(steps) > STEADY * period:
        span = f"{steps.min():.4g} to {steps.max():.4g} s"
        raise RunFolderError(
            f"{run.folder}: rows are {span} apart, a log's are even; use probes.every: 0.1 s"
        )
    milliseconds = round(1000 * period)
    if abs(1000 * period - milliseconds) > STEADY * 1000 * period or not milliseconds:
        raise RunFolderError(
            f"{run.folder}: rows are {1000 * period:.6g} ms apart, a log's whole milliseconds; change probes.every, or "
            "tick for robots"
        )
    return period


def _spacing(run: Run, place: np.ndarray) -> float:
    """Return the largest distance [m] of a node to its nearest neighbour. Raises RunFolderError for a single node."""
    from scipy.spatial import KDTree

    nodes = np.unique(place, axis=0)
    if len(nodes) < 2:
        raise RunFolderError(
            f"{run.folder}: has a single node; say by --cell how far from it its readings hold"
        )
    return float(KDTree(nodes).query(nodes, k=2)[0][:, 1].max())
