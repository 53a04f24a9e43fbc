"""Work of test campaigns in place of simulations: sleep, fail or kill the process, as requested.

A request's `changes` say what it does: sleep [s], fail (a message), raise (a message), kills (how many times it kills
the process that does it; marks lie in the study's folder), burn [s of CPU].
"""

import os
import signal
import time

from taichi_plume.studies.messages import AirRecord, Cost, Record, Request, Task


def work(task: Task) -> list[Record] | AirRecord:
    if task.solve:
        return solve_air(task)
    begun, records = time.monotonic(), []
    for request in task.requests:
        records.append(run(task, request))
        if time.monotonic() - begun > task.limit_s:
            break
    return records


def run(task: Task, request: Request) -> Record:
    begun, clock = time.time(), time.perf_counter()
    reported = task.base | request.changes
    mark(task, request)
    if deaths(task, request) <= reported.get("kills", 0):
        os.kill(os.getpid(), signal.SIGKILL)
    if reported.get("full"):
        raise OSError(28, "No space left on device")
    if reported.get("raise"):
        raise ValueError(reported["raise"])
    if task.film is not None:
        assert (task.film / "whole").exists()
    time.sleep(reported.get("sleep", 0.0))
    until = time.process_time() + reported.get("burn", 0.0)
    while time.process_time() < until:
        pass
    simulated = 0.0 if reported.get("fail") else time.perf_counter() - clock
    cost = Cost(begun, time.perf_counter() - clock, simulated, 0, str(os.getpid()))
    if reported.get("fail"):
        return Record(request.run, "failed", reported["fail"], [], {}, cost)
    row = {"group": "robots", "algorithm": "casting", "trial": 0, "searched": True}
    row |= {"success": request.number % 3 > 0, "found": 1, "time_s": 1 / (1 + request.number)}
    return Record(request.run, "completed", "", [row], {"number": request.number / 7}, cost)


def mark(task: Task, request: Request) -> None:
    """A line for each time that a run was begun."""
    with (task.options.out / "begun.txt").open("a") as file:
        file.write(f"{request.run} {os.getpid()} {len(task.requests)}\n")


def deaths(task: Task, request: Request) -> int:
    text = (task.options.out / "begun.txt").read_text()
    return sum(line.startswith(request.run) for line in text.splitlines())


def solve_air(task: Task) -> AirRecord:
    reported, air = task.base, task.requests[0].air
    with (task.options.out / "airs.txt").open("a") as file:
        file.write(f"{air} {len(task.requests)}\n")
    time.sleep(reported.get("solve", 0.0))
    if air in reported.get("bad_airs", ()):
        return AirRecord(air, 0.1, 0, 0, "unstable at t = 1 s")
    assert task.film is not None
    films = [one for one in task.film.parent.glob("*.zarr")]
    with (task.options.out / "films.txt").open("a") as file:
        file.write(f"{len(films)}\n")
    fresh = task.film.with_suffix(".new")
    fresh.mkdir()
    (fresh / "whole").touch()
    fresh.rename(task.film)
    return AirRecord(air, reported.get("solve", 0.0), 10, 100)


def why_not(scenario: dict, outcomes: dict, share: str, keep: tuple = ()) -> str | None:
    return None if scenario.get("shared") else "nothing is solved for"
