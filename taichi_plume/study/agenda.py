"""Queue of a study: the runs and films that are still to be done, and the next job of an idle worker.

Runs that share an air wait until the air has been filmed. Airs are filmed in their order, a few at a time, as films are
large; a film is removed when the last of its runs is done. A worker prefers runs of the structure that it has compiled.
"""

from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Sequence
from math import ceil
from pathlib import Path
from typing import NamedTuple

import numpy as np

from taichi_plume.study.messages import Request

TARGET_S = 4.0
"""Duration of a task: long enough to hide Dask's overhead, short enough to lose little with a worker."""
PER_WORKER_S = 0.04
"""Least duration of a task per worker: the command and the scheduler need that long for the others' tasks."""
MOST_RUNS = 1000  # of a task
DEATHS = 2  # workers that a single run or film may kill before it has failed
REMEMBERED = 16  # last runs of a structure from which the cost of the next ones is estimated


class Job(NamedTuple):
    """Runs of one task or, if `solve`, the film of the air that the runs share.

    film: path of the film that the runs play. deaths: workers that this job has killed, alone.
    """

    requests: tuple[Request, ...]
    film: Path | None = None
    solve: bool = False
    deaths: int = 0

    @property
    def structure(self) -> str:
        """Structure of the simulation that the job's worker compiles."""
        return self.requests[0].structure

    @property
    def air(self) -> str:
        """Air that the job films or plays."""
        return self.requests[0].air


class Agenda:
    """Queue of runs.

    requests: in the plan's order; shared: ids of airs to film; film: path of an air's film; most_films: that may exist
    at a time; room: whether the disk has room for another film.
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
        self.left: Counter[str] = Counter()  # runs that are not done, by shared air
        self.unsolved: dict[str, None] = {}  # airs in their order
        self.filmed: set[str] = set()
        self.solving: set[str] = set()
        self._open: dict[tuple[str, str], deque[Request]] = {}  # by shared air ("" if none) and structure
        self._costs: dict[str, deque[float]] = {}
        self._tasks: Counter[tuple[str, str]] = Counter()  # given so far, by the keys of _open
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
        """Number of runs that are in no task."""
        return sum(map(len, self._open.values())) + sum(len(job.requests) for job in self.repeated)

    def next(self, structure: str, workers: int) -> Job | None:
        """Next job of a worker that has compiled `structure`; None if nothing can be done yet."""
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
            fair = ceil(total / (2 * workers))  # so that all workers end at the same time
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
        """Put back the runs of a job for which its worker had no time."""
        if requests:
            group = (job.air if job.film else "", job.structure)
            self._open.setdefault(group, deque()).extendleft(reversed(requests))

    def apart(self, job: Job) -> None:
        """Repeat the runs of a job that raised an error, one by one."""
        self.repeated.extend(job._replace(requests=(request,)) for request in job.requests)

    def died(self, job: Job) -> bool:
        """Repeat a job whose worker died, its runs one by one. Return whether a single run or film has failed."""
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
        """Remove the runs of an air that could not be solved; return these runs."""
        self.solving.discard(air)
        runs = self._runs_in(air)
        for group in [key for key in self._open if key[0] == air]:
            del self._open[group]
        del self.left[air]
        return runs

    def _runs_in(self, air: str) -> list[Request]:
        return [request for group, runs in self._open.items() if group[0] == air for request in runs]

    def done(self, request: Request) -> str | None:
        """Note that a run is over. Return the id of its air if no other run needs the air's film."""
        if request.air not in self.left:
            return None
        self.left[request.air] -= 1
        if self.left[request.air]:
            return None
        del self.left[request.air]
        self.filmed.discard(request.air)
        return request.air
