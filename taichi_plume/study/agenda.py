"""What of a study is still to be done, and what a worker that is free does next.

Runs that share an air wait until it has been filmed; airs are filmed in their order, a few at a time, as films are
large, and each goes when the last of its runs is done. A worker goes on with runs of the structure that it has.
"""

from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Sequence
from math import ceil
from pathlib import Path
from typing import NamedTuple

import numpy as np

from taichi_plume.study.messages import Request

TARGET_S = 4.0
"""Of a task: so long that Dask's cost for it vanishes, so short that little is lost with a worker."""
PER_WORKER_S = 0.04
"""Of a task, for each worker: so long the command and the scheduler take for the tasks of the others."""
MOST_RUNS = 1000  # of a task
DEATHS = 2  # of workers that had nothing but this run or film, after which it has failed
REMEMBERED = 16  # runs of a structure, whose cost tells that of the next ones


class Job(NamedTuple):
    """What one task does: runs, or where `solve` the film of the air that all of these share.

    film: that they play. deaths: of workers that did it, a single run or a film.
    """

    requests: tuple[Request, ...]
    film: Path | None = None
    solve: bool = False
    deaths: int = 0

    @property
    def structure(self) -> str:
        """That its worker has compiled afterwards."""
        return self.requests[0].structure

    @property
    def air(self) -> str:
        """That it films or plays."""
        return self.requests[0].air


class Agenda:
    """Runs that are to be done.

    requests: in the plan's order; shared: ids of airs that are filmed; film: where the film of an air lies, if it is
    whole; most_films: at a time; room: whether the disk has room for another film.
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
        self._open: dict[tuple[str, str], deque[Request]] = {}  # by shared air ("" of none) and structure
        self._costs: dict[str, deque[float]] = {}
        self._attended: Counter[tuple[str, str]] = Counter()  # tasks that were given
        for request in requests:
            air = request.air if request.air in shared else ""
            self._open.setdefault((air, request.structure), deque()).append(request)
            if air:
                self.left[air] += 1
                self.unsolved[air] = None
        for air in list(self.unsolved):
            if film(air).exists():
                del self.unsolved[air]
                self.filmed.add(air)
        self.airs = len(self.left)

    @property
    def open(self) -> int:
        """Runs that no task has been given."""
        return sum(map(len, self._open.values())) + sum(len(job.requests) for job in self.repeated)

    def next(self, structure: str, workers: int) -> Job | None:
        """What a worker does next that has compiled this structure; None where nothing can be done yet."""
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
        """Of the group whose structure the worker has, else of the one that fewest others attend to."""
        group = min(groups, key=lambda one: (one[1] != structure, self._attended[one]))
        requests = self._open[group]
        each = self.expected(group[1])
        wanted = 1
        if each is not None:
            fair = ceil(
                sum(len(self._open[one]) for one in groups) / (2 * workers)
            )  # all end at the same time
            wanted = max(1, min(int(self.target(workers) / max(each, 1e-4)), fair, MOST_RUNS))
        some = tuple(requests.popleft() for _ in range(min(wanted, len(requests))))
        if not requests:
            del self._open[group]
        self._attended[group] += 1
        film = self.film(group[0]) if group[0] else None
        return Job(some, film)

    def target(self, workers: int) -> float:
        """How long a task should take [s], of so many workers."""
        return max(TARGET_S, PER_WORKER_S * workers)

    def expected(self, structure: str) -> float | None:
        """What a run of a structure takes [s]; None where that is not known yet."""
        costs = self._costs.get(structure)
        return float(np.median(costs)) if costs else None

    # ------------------------------------------------------------ what came of it

    def took(self, structure: str, seconds: float) -> None:
        """A run of that structure has taken so long."""
        self._costs.setdefault(structure, deque(maxlen=REMEMBERED)).append(seconds)

    def again(self, job: Job, requests: Sequence[Request]) -> None:
        """These runs of a job were not done: its worker had no more time for them."""
        if not requests:
            return
        group = (job.air if job.film else "", job.structure)
        self._open.setdefault(group, deque()).extendleft(reversed(requests))

    def apart(self, job: Job) -> None:
        """Do the runs of a job that went wrong one by one."""
        self.repeated.extend(job._replace(requests=(one,)) for one in job.requests)

    def died(self, job: Job) -> bool:
        """Do a job again whose worker died, its runs one by one. Return whether a single run or film has failed."""
        if len(job.requests) > 1 and not job.solve:
            self.apart(job)
        elif job.deaths + 1 >= DEATHS:
            return True
        else:
            self.repeated.append(job._replace(deaths=job.deaths + 1))
        return False

    def solved(self, air: str) -> None:
        """The film of an air is there."""
        self.solving.discard(air)
        self.filmed.add(air)

    def without(self, air: str) -> list[Request]:
        """The air could not be solved: its runs, which cannot be done."""
        self.solving.discard(air)
        runs = self._runs_in(air)
        for group in [one for one in self._open if one[0] == air]:
            del self._open[group]
        del self.left[air]
        return runs

    def _runs_in(self, air: str) -> list[Request]:
        return [request for group, some in self._open.items() if group[0] == air for request in some]

    def done(self, request: Request) -> str | None:
        """A run is over; returns the id of its air where its film is not needed any more."""
        if request.air not in self.left:
            return None
        self.left[request.air] -= 1
        if self.left[request.air]:
            return None
        del self.left[request.air]
        self.filmed.discard(request.air)
        return request.air
