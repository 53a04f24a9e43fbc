"""Job queue of a study: pending runs and films, and the choice of an idle worker's next job.

Runs that share an air (one realisation of flow and gas) wait for the film of the air. Films are large: only a few exist
at a time, and a film is removed after its last run. A worker prefers runs of a structure that it has compiled already.
"""

from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Sequence
from math import ceil
from pathlib import Path
from typing import NamedTuple

import numpy as np

from taichi_plume.study.messages import Request

TARGET_S = 4.0
"""Desired duration of a task: long enough to hide Dask's overhead, short enough to lose little if a worker dies."""
PER_WORKER_S = 0.04
"""Least duration of a task per worker: the command and the scheduler handle the other workers' tasks meanwhile."""
MOST_RUNS = 1000  # in a task
DEATHS = 2  # worker deaths after which a single run or film counts as failed
REMEMBERED = 16  # recent runs of a structure that the expected cost of a run is estimated from


class Job(NamedTuple):
    """Runs of one task or, if `solve`, the film of the air that the runs share.

    film: path of the film that the runs play. deaths: number of workers that died while executing this job alone.
    """

    requests: tuple[Request, ...]
    film: Path | None = None
    solve: bool = False
    deaths: int = 0

    @property
    def structure(self) -> str:
        """Structure of the simulation that the worker must have compiled for the job."""
        return self.requests[0].structure

    @property
    def air(self) -> str:
        """Id of the air that the job films or plays."""
        return self.requests[0].air


class Agenda:
    """Queue of runs.

    requests: runs in the plan's order; shared: ids of airs to film; film: returns the path of an air's film;
    most_films: number of films that may exist at a time; room: returns whether the disk has room for another film.
    """

    def __init__(
        self,
        requests: Iterable[Request],
        shared: Collection[str],
        film: Callable[[str], Path],
        most_films: int,
        room: Callable[[], bool] = lambda: True,
    ):
        self.film, self.most_films, self.room = film, most_films, room
        self.repeated: deque[Job] = deque()
        self.left: Counter[str] = Counter()  # number of pending runs by shared air
        self.unsolved: dict[str, None] = {}  # airs without a film, in the plan's order
        self.filmed: set[str] = set()
        self.solving: set[str] = set()
        self._open: dict[tuple[str, str], deque[Request]] = {}  # by shared air ("" if none) and structure
        self._costs: dict[str, deque[float]] = {}
        self._tasks: Counter[tuple[str, str]] = Counter()  # number of tasks so far, by the keys of _open
        for request in requests:
            air = request.air if request.air in shared else ""
            self._open.setdefault((air, request.structure), deque()).append(request)
            if air:
                self.left[air] += 1
        for air in self.left:
            if film(air).exists():
                self.filmed.add(air)
            else:
                self.unsolved[air] = None
        self.airs = len(self.left)

    @property
    def open(self) -> int:
        """Number of runs that no worker has."""
        return sum(map(len, self._open.values())) + sum(len(job.requests) for job in self.repeated)

    def next(self, structure: str, workers: int) -> Job | None:
        """Return the next job of a worker that has compiled `structure`; None if no job is ready."""
        if self.repeated:
            return self.repeated.popleft()
        played = [group for group in self._open if group[0] in self.filmed]
        if played:
            return self._runs(played, structure, workers)
        if self.unsolved and len(self.filmed) + len(self.solving) < self.most_films and self.room():
            air = next(iter(self.unsolved))
            del self.unsolved[air]
            self.solving.add(air)
            return Job(tuple(self._runs_in(air)), self.film(air), solve=True)
        alone = [group for group in self._open if not group[0]]
        return self._runs(alone, structure, workers) if alone else None

    def _runs(self, groups: Sequence[tuple[str, str]], structure: str, workers: int) -> Job:
        """Take runs of the group with the worker's structure, else of the group with the fewest tasks so far."""
        group = min(groups, key=lambda key: (key[1] != structure, self._tasks[key]))
        requests = self._open[group]
        seconds = self.expected(group[1])
        count = 1
        if seconds is not None:
            total = sum(len(self._open[key]) for key in groups)
            fair = ceil(total / (2 * workers))  # all workers then finish at about the same time
            count = max(1, min(int(self.target(workers) / max(seconds, 1e-4)), fair, MOST_RUNS))
        taken = tuple(requests.popleft() for _ in range(min(count, len(requests))))
        if not requests:
            del self._open[group]
        self._tasks[group] += 1
        return Job(taken, self.film(group[0]) if group[0] else None)

    def target(self, workers: int) -> float:
        """Desired duration of a task [s] for a number of workers."""
        return max(TARGET_S, PER_WORKER_S * workers)

    def expected(self, structure: str) -> float | None:
        """Expected cost of a run of a structure [s]; None before the first run."""
        costs = self._costs.get(structure)
        return float(np.median(costs)) if costs else None

    # ------------------------------------------------------------ results

    def took(self, structure: str, seconds: float) -> None:
        """Record the cost of a run [s]."""
        self._costs.setdefault(structure, deque(maxlen=REMEMBERED)).append(seconds)

    def again(self, job: Job, requests: Sequence[Request]) -> None:
        """Put back the runs of a job that its worker did not execute within the time limit."""
        if requests:
            group = (job.air if job.film else "", job.structure)
            self._open.setdefault(group, deque()).extendleft(reversed(requests))

    def apart(self, job: Job) -> None:
        """Queue the runs of a job that raised an error again, one run per job."""
        self.repeated.extend(job._replace(requests=(request,)) for request in job.requests)

    def died(self, job: Job) -> bool:
        """Queue the job of a dead worker again, one run per job. Return whether a single run or film has failed."""
        if len(job.requests) > 1 and not job.solve:
            self.apart(job)
        elif job.deaths + 1 >= DEATHS:
            return True
        else:
            self.repeated.append(job._replace(deaths=job.deaths + 1))
        return False

    def solved(self, air: str) -> None:
        """Note that an air has been filmed."""
        self.solving.discard(air)
        self.filmed.add(air)

    def without(self, air: str) -> list[Request]:
        """Remove and return the runs of an air whose simulation failed."""
        self.solving.discard(air)
        runs = self._runs_in(air)
        for group in [key for key in self._open if key[0] == air]:
            del self._open[group]
        del self.left[air]
        return runs

    def _runs_in(self, air: str) -> list[Request]:
        return [request for group, runs in self._open.items() if group[0] == air for request in runs]

    def done(self, request: Request) -> str | None:
        """Note that a run has ended. Return the id of the run's air if no pending run needs the film of the air."""
        if request.air not in self.left:
            return None
        self.left[request.air] -= 1
        if self.left[request.air]:
            return None
        del self.left[request.air]
        self.filmed.discard(request.air)
        return request.air
