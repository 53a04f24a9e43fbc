"""Benchmarks of speed: time steps per second, beside the memory bandwidth measured in the same minute.

    python -m taichi_plume.validation.benchmark [NAMES] [--pressure] [--json] [--arch ARCH] [--seconds S]
    python -m taichi_plume.validation.benchmark start CONFIG ...
    python -m taichi_plume.validation.benchmark clock [ROW ...]
    python -m taichi_plume.validation.benchmark studies WHAT [CONFIG]
    python -m taichi_plume.validation.benchmark envs [--count N]
    python -m taichi_plume.validation.benchmark live [--minutes M]
    python -m taichi_plume.validation.benchmark gpu [--arch ARCH] [--minutes M]

A step advances the flow with its eddy viscosity and one gas; puffs, robots and maps are measured separately. With
--pressure, only the pressure is solved, in cubes of N³ cells with obstacles: iterations against N. Every figure is a
rate on a machine that may be shared: compare the ratios to the bandwidth, and rates of one run with each other.
Other benchmarks: `start` measures the first tick of a scenario, `clock` the wall times that users see, beside their
targets. `studies` measures the worker of a study, `envs` the environments of learners, `live` the service for
external robots, `gpu` all that concerns a GPU. See start.py, clock.py, studies.py, envs.py, live.py and gpu.py.
"""

import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any

from taichi_plume.guard.terminal import Parser, say
from taichi_plume.validation.arena import ARENA, arena
from taichi_plume.validation.benchmark import (
    clock,
    dispersion,
    envs,
    gpu,
    maps,
    pressure,
    puffs,
    robots,
    start,
    trials,
)
from taichi_plume.validation.benchmark.steps import CASES, measure


def _arena_puffs(count: int) -> puffs.PuffSolver:
    return puffs.in_arena(*arena((80, 60, 10), True), ARENA, count)


def _studies(arguments: Sequence[str]) -> int:
    from taichi_plume.validation.benchmark import studies  # imports the packages of workers

    return studies.main(arguments)


def _live(arguments: Sequence[str]) -> int:
    from taichi_plume.validation.benchmark import live  # needs the packages of the extra ros

    return live.main(list(arguments))


OTHERS = {
    "start": start.main,
    "clock": clock.main,
    "studies": _studies,
    "envs": envs.main,
    "live": _live,
    "gpu": gpu.main,
}
OTHER_CASES: dict[str, Callable[[str], Sequence[Any]]] = {
    "puffs_step": lambda arch: puffs.step("puffs_step", arch, _arena_puffs),
    "puffs_query": lambda arch: [
        *puffs.query("puffs_query room", arch, puffs.in_room),
        *puffs.query("puffs_query arena", arch, _arena_puffs),
    ],
    "robots": lambda arch: [robots.ticks("robots", arch, algorithm) for algorithm in ("casting", "spiral")],
    "spiral_trials": lambda arch: trials.spiral_trials("spiral_trials", arch),
    "maps": maps.maps,
    "dispersion": dispersion.rooms,
}


def main(argv: list[str] | None = None) -> int:
    """Measure the benchmark cases named on the command line, or all of them."""
    arguments = sys.argv[1:] if argv is None else argv
    other = OTHERS.get(arguments[0] if arguments else "")
    if other is not None:
        return other(arguments[1:])
    known = [*CASES, *OTHER_CASES]
    parser = Parser(prog="python -m taichi_plume.validation.benchmark", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"cases: {', '.join(known)}")
    parser.add_argument(
        "--pressure", action="store_true", help="measure iterations of the pressure solver against N instead"
    )
    parser.add_argument("--arch", default="cpu", choices=("auto", "cpu", "cuda", "vulkan", "metal"))
    parser.add_argument("--seconds", type=float, default=8.0, help="seconds per case (default: 8)")
    parser.add_argument("--json", action="store_true", help="print JSON")
    args = parser.parse_args(arguments)
    unknown = [name for name in args.names if name not in known]
    if unknown:
        say(f"unknown case {unknown[0]!r}; known: {', '.join(known)}", error=True)
        return 2
    rows: list[Any] = []

    def report(new_rows: Sequence[Any]) -> None:
        rows.extend(new_rows)
        if not args.json:
            for row in new_rows:
                say(row, flush=True)

    for n in pressure.SIDES if args.pressure else ():
        report(pressure.solve(n, args.arch))
    for name in () if args.pressure else args.names or known:
        report(
            OTHER_CASES[name](args.arch) if name in OTHER_CASES else [measure(name, args.arch, args.seconds)]
        )
    if args.json:
        say(*json.dumps([asdict(row) for row in rows], indent=2).splitlines(), longest=None)
    return 0


if __name__ == "__main__":
    sys.exit(main())
