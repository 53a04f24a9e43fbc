"""What workers do next: nothing is lost, nothing twice, structures stay with their workers, films are few."""

import random
from collections import Counter
from pathlib import Path

import pytest

from taichi_plume.studies.job_queue import DEATHS, MOST_RUNS, Job, JobQueue
from taichi_plume.studies.messages import Request


def nowhere(air: str) -> Path:
    return Path(f"/nowhere/{air}.zarr")


def requests(airs: int, structures: int, each: int) -> list[Request]:
    pairs = [(a, s) for a in range(airs) for s in range(structures) for _ in range(each)]
    return [
        Request(f"{n:016x}", n, n, {}, 0, 0, f"air{a}", True, {}, f"s{s}") for n, (a, s) in enumerate(pairs)
    ]


@pytest.mark.parametrize("seed", range(30))
def test_each_run_is_done_once_whatever_happens(seed):
    """Workers die, bring half of a task home, airs fail, at random."""
    chance = random.Random(seed)
    asked = requests(5, 3, 7)
    shared = {f"air{n}" for n in range(3)}
    queue = JobQueue(asked, shared, nowhere, most_films=2)
    over: Counter[str] = Counter()
    given: list[Job] = []
    removed = []

    def finish(job: Job, count: int):
        over.update(one.run for one in job.requests[:count])
        removed.extend(queue.executed(job, count))

    for _ in range(5000):
        job = queue.next(chance.choice(["s0", "s1"]), 4)
        if job:
            assert job.solve or job.film is None or job.air in queue.filmed
            given.append(job)
        assert len(queue.filmed | queue.solving) <= 2
        if not given:
            break
        job = given.pop(chance.randrange(len(given)))
        if chance.random() < 0.2:
            blamed = queue.died(job)
            assert not blamed or job.solve or len(job.requests) == 1
            if blamed and job.solve:
                over.update(one.run for one in queue.without(job.air))
            elif blamed:
                finish(job, 1)
        elif job.solve:
            queue.solved(job.air)
        else:
            finish(job, chance.randint(1, len(job.requests)))
    assert over == {one.run: 1 for one in asked}
    assert set(removed) <= shared
    assert not queue.left
    assert not queue.filmed


def test_a_worker_keeps_its_structure():
    """Two workers share three structures with no more than four changes between them."""
    queue = JobQueue(requests(4, 3, 20), set(), nowhere, 2)
    has = {0: "", 1: ""}
    changes = 0
    while job := queue.next(has[0], 2):
        changes += job.structure != has[0]
        has[0], has[1] = has[1], job.structure
        queue.executed(job, 1)
    assert changes <= 4


def test_jobs_grow_as_far_as_workers_execute_them_in_time():
    queue = JobQueue(requests(1, 1, 9000), set(), nowhere, 2)
    sizes = []
    for _ in range(12):
        job = queue.next("s0", 2)
        assert job
        sizes.append(len(job.requests))
        queue.executed(job, len(job.requests))
    assert sizes == [1, 2, 4, 8, 16, 32, 64, 128, 256, 512, *2 * [MOST_RUNS]]
    job = queue.next("s0", 2)
    assert job
    queue.executed(job, 5)  # the time was over
    assert len(queue.next("s0", 2).requests) == 10


def test_all_end_at_the_same_time():
    queue = JobQueue(requests(1, 1, 100), set(), nowhere, 2)
    sizes = []
    while job := queue.next("s0", 2):
        sizes.append(len(job.requests))
        queue.executed(job, len(job.requests))
    assert sum(sizes) == 100
    assert max(sizes) < 25
    assert sizes[-1] == 1


def test_airs_come_before_runs_that_need_none(tmp_path):
    """And a film that is there already is played at once."""
    (tmp_path / "air1.zarr").mkdir()
    queue = JobQueue(requests(4, 1, 2), {"air0", "air1", "air2"}, lambda air: tmp_path / f"{air}.zarr", 2)
    kinds = []
    for _ in range(6):
        job = queue.next("", 2)
        kinds.append((job.solve, job.air) if job else None)
    assert kinds[:5] == [
        (False, "air1"), (False, "air1"), (True, "air0"), (False, "air3"), (False, "air3"),
    ]  # fmt: skip
    assert kinds[5] is None  # two films at a time: air2 waits
    assert queue.executed(Job(tuple(requests(4, 1, 2)[2:4]), tmp_path / "air1.zarr"), 2) == ["air1"]
    job = queue.next("", 2)
    assert job
    assert (job.solve, job.air) == (True, "air2")


def test_a_full_disk_keeps_airs_waiting():
    room = [False]
    queue = JobQueue(requests(2, 1, 2), {"air0", "air1"}, nowhere, 2, lambda: room[0])
    assert queue.next("", 2) is None
    room[0] = True
    assert queue.next("", 2).solve


def test_a_run_that_kills_alone_has_failed():
    """A task of four, whose third run kills its worker: the others of the task are done."""
    queue = JobQueue(requests(1, 1, 11), set(), nowhere, 2)
    for size in (1, 2):
        job = queue.next("s0", 1)
        assert job
        queue.executed(job, size)
    job = queue.next("s0", 1)
    assert job
    assert len(job.requests) == 4
    killer, failed, begun = job.requests[2], [], 0
    while job:
        if killer in job.requests:
            begun += 1
            if queue.died(job):
                failed.append(*job.requests)
        job = queue.next("s0", 1)
    assert failed == [killer]
    assert begun == 1 + DEATHS
