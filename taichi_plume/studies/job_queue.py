"""Job queue of a study: pending runs and films, and the choice of an idle worker's next job.

Runs that share an air (one realisation of flow and gas) wait for the film of the air. Films are large: only a few exist
at a time, and a film is removed after its last run. A worker prefers runs of the structure of its last
run, whose files it has open.
"""

from collections import Counter, deque
from collections.abc import Callable, Collection, Sequence
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from taichi_plume.studies.messages import Request

if TYPE_CHECKING:
    from taichi_plume.studies.shards import Claims

MOST_RUNS = 1000  # in a job
DEATHS = 2  # worker deaths after which a single run or film counts as failed


class Job(NamedTuple):
    """Job of a worker: execute runs or, if `solve`, compute and film the flow and gas that these runs share.

    film: path of the film that the runs play. deaths: number of workers that died while executing this job alone.
    """

    requests: tuple[Request, ...]
    film: Path | None = None
    solve: bool = False
    deaths: int = 0

    @property
    def structure(self) -> str:
        """Hash of all but the numbers and seeds of the job's runs."""
        return self.requests[0].structure

    @property
    def air(self) -> str:
        """Id of the realisation of flow and gas that the job films or plays."""
        return self.requests[0].air


class JobQueue:
    """Queue of the runs of a study and of the films (recorded flow and gas, an air) that runs share.

    requests: runs in the plan's order; shared: ids of airs to film; film: returns the path of an air's film;
    most_films: number of films that may exist at a time; room: returns whether the disk has room for another film.
    claims: of the airs that the shard shares with other shards, which film some of them.
    """

    def __init__(
        self,
        requests: Sequence[Request],
        shared: Collection[str],
        film: Callable[[str], Path],
        most_films: int,
        room: Callable[[], bool] = lambda: True,
        claims: "Claims | None" = None,
    ):
        self.claims = claims
        self.film, self.most_films, self.room = film, most_films, room
        self.repeated: deque[Job] = deque()
        self.left = Counter(
            request.air for request in requests if request.air in shared
        )  # pending runs by air
        self.airs = len(self.left)
        self.filmed = {air for air in self.left if film(air).exists()}
        self.solving: set[str] = set()
        self._open: dict[tuple[str, str], deque[Request]] = {}  # by shared air ("" if none) and structure
        self._sizes: dict[str, int] = {}  # number of runs of the next job, by structure
        self._jobs: Counter[tuple[str, str]] = Counter()  # number of jobs so far, by the keys of _open
        for request in requests:
            air = request.air if request.air in self.left else ""
            self._open.setdefault((air, request.structure), deque()).append(request)

    @property
    def open(self) -> int:
        """Number of queued runs that have not been given to a worker."""
        return sum(map(len, self._open.values())) + sum(len(job.requests) for job in self.repeated)

    @property
    def unsolved(self) -> str | None:
        """Id of the next shared air, in the plan's order, that nobody has filmed or is filming; None if none."""
        begun, claims = self.filmed | self.solving, self.claims
        airs = (air for air in self.left if air not in begun)
        return next((air for air in airs if claims is None or claims.solver(air) is None), None)

    def next(self, structure: str, workers: int) -> Job | None:
        """Return the next job for a worker whose last simulation has the hash `structure`; None if none is ready."""
        if self.repeated:
            return self.repeated.popleft()
        if self.claims is not None:
            self.filmed |= {air for air in self.claims.common & self.left.keys() if self.film(air).exists()}
        groups = [group for group in self._open if group[0] in self.filmed]
        if groups:
            return self._runs(groups, structure, workers)
        air = self.unsolved
        room = len(self.filmed) + len(self.solving) < self.most_films
        if air is not None and room and self.room() and (self.claims is None or self.claims.claim(air)):
            if self.film(air).exists():  # another shard has just completed the film, and ended
                return self.next(structure, workers)
            self.solving.add(air)
            return Job(tuple(self._runs_in(air)), self.film(air), solve=True)
        groups = [group for group in self._open if not group[0]]
        return self._runs(groups, structure, workers) if groups else None

    def _runs(self, groups: Sequence[tuple[str, str]], structure: str, workers: int) -> Job:
        """Take runs from the queue of one (air, structure) group as a job; prefer the worker's last structure."""
        group = min(groups, key=lambda key: (key[1] != structure, self._jobs[key]))
        requests = self._open[group]
        total = sum(len(self._open[key]) for key in groups)
        fair = ceil(total / (2 * workers))  # all workers then finish at about the same time
        count = min(self._sizes.get(group[1], 1), fair, MOST_RUNS, len(requests))
        taken = tuple(requests.popleft() for _ in range(count))
        if not requests:
            del self._open[group]
        self._jobs[group] += 1
        return Job(taken, self.film(group[0]) if group[0] else None)

    # ------------------------------------------------------------ results

    def executed(self, job: Job, count: int) -> list[str]:
        """Record that a worker has executed the first `count` runs of a job; queue the other runs again.

        Later jobs of the same structure have up to twice as many runs. Return the air if no pending run needs its film.
        """
        complete = count == len(job.requests)
        self._sizes[job.structure] = max(2 * count, self._sizes.get(job.structure, 1) if complete else 1)
        if not complete:
            group = (job.air if job.film else "", job.structure)
            self._open.setdefault(group, deque()).extendleft(reversed(job.requests[count:]))
        if job.air not in self.left:
            return []
        self.left[job.air] -= count
        if self.left[job.air]:
            return []
        del self.left[job.air]
        self.filmed.discard(job.air)
        return [job.air]

    def apart(self, job: Job) -> None:
        """Queue each run of a failed job again as a job of its own, to isolate the run at fault."""
        self.repeated.extend(job._replace(requests=(request,)) for request in job.requests)

    def died(self, job: Job) -> bool:
        """Queue a dead worker's runs again, one per job. Return True if a single run or film has failed too often."""
        if len(job.requests) > 1 and not job.solve:
            self.apart(job)
        elif job.deaths + 1 >= DEATHS:
            return True
        else:
            self.repeated.append(job._replace(deaths=job.deaths + 1))
        return False

    def lost(self, air: str) -> None:
        """Record that another shard has taken over the film of an air."""
        self.solving.discard(air)

    def solved(self, air: str) -> None:
        """Record that the film of an air is complete, so that its runs may start."""
        self.solving.discard(air)
        self.filmed.add(air)

    def without(self, air: str) -> list[Request]:
        """Remove from the queue, and return, all runs of an air that could not be filmed."""
        self.solving.discard(air)
        runs = self._runs_in(air)
        for group in [key for key in self._open if key[0] == air]:
            del self._open[group]
        del self.left[air]
        return runs

    def _runs_in(self, air: str) -> list[Request]:
        return [request for group, runs in self._open.items() if group[0] == air for request in runs]
