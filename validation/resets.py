"""Check that a reset simulation equals a fresh process, to the bit.

    python -m taichi_plume.validation.resets [NAME ...] [--seconds S] [--times N] [--keep DIR]

Each scenario in `configs/` (or those named), shortened to S seconds of warm-up and S of robots, is assembled and run in
one process. Then the simulation is reset and run again: unchanged; with another seed; with changed speeds of the air,
rates of release and start positions; and unchanged once more. Each time `robots.parquet` and the mass budget are
compared with those of a fresh process that runs the same scenario. The check also reports the number of kernels
compiled by resets, which must be 0, and the growth of the process over N resets with a tick after each. Exit code 0: no
differences.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import psutil
import yaml

from taichi_plume.assembly.assemble import assemble
from taichi_plume.assembly.preparation import load_scenario
from taichi_plume.engine import program
from taichi_plume.execution.result import result, write_result
from taichi_plume.execution.robots_table import RobotTable
from taichi_plume.files.run_folder import to_yaml
from taichi_plume.guard.terminal import Parser, say
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.time_loop import TimeLoop
from taichi_plume.validation.case import Keys
from taichi_plume.validation.same_runs import differences, shortened

CONFIGS = Path(__file__).resolve().parent.parent / "configs"
MEGABYTES = 1e-6
FASTER, MORE, ASIDE = 1.1, 1.3, 0.04  # of speeds and rates; m, of starts
SPEEDS = ("speed", "velocity")
RATES = ("rate", "mass")
STARTS = ("low", "high", "begin", "end", "positions")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the check with these command-line arguments and return the exit code."""
    parser = Parser(prog="python -m taichi_plume.validation.resets")
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--times", type=int, default=100)
    parser.add_argument("--keep", type=Path, help="keep the runs here, and reuse fresh runs found here")
    parser.add_argument(
        "--one", type=Path, help=argparse.SUPPRESS
    )  # check a shortened scenario in this process
    args = parser.parse_args(argv)
    if args.one:
        return check(args.one, args.times)
    failed = 0
    with tempfile.TemporaryDirectory() as folder:
        keep = (args.keep or Path(folder)).resolve()
        for name in args.names or sorted(path.stem for path in CONFIGS.glob("*.yaml")):
            path = CONFIGS / f"{name}.yaml"
            data = shortened(yaml.safe_load(path.read_text()), args.seconds)
            (keep / name).mkdir(parents=True, exist_ok=True)
            file = keep / name / "scenario.yaml"
            scenario = load_scenario(path, [f"{key}={json.dumps(value)}" for key, value in data.items()])
            file.write_text(to_yaml(scenario, path.parent, file.parent))
            # a process per scenario, so that no state carries over
            command = [sys.executable, "-m", "taichi_plume.validation.resets", "--one", str(file)]
            failed += bool(subprocess.run([*command, "--times", str(args.times)], check=False).returncode)
    return int(failed > 0)


def check(path: Path, times: int) -> int:
    """Compare the resets of the scenario at `path` with fresh processes; return the exit code."""
    scenario = load_scenario(path, allow_outside=True)  # files lie in the folder of the config
    program.start("cpu")
    sim = assemble(scenario, path.parent, allow_outside=True)
    _run(sim, path.parent / "first")
    compiled, faults, idle = program.compiled(), [], []
    for name, other in variants(scenario):
        sim.reset(other)
        _run(sim, path.parent / f"reset-{name}")
        fresh = path.parent / f"fresh-{name}"
        if not (fresh / "result.json").exists():
            file = path.parent / f"{name}.yaml"
            file.write_text(to_yaml(other, path.parent, path.parent))
            command = [sys.executable, "-m", "taichi_plume.run", str(file), "--out", str(fresh), "--quiet"]
            subprocess.run([*command, "--no-recording", "--allow-outside"], check=True)
        changes = list(differences(fresh, path.parent / f"reset-{name}", ("steps", "gas")))
        faults += [f"{name}: {fault}" for fault in changes]
        if name != "same" and not list(differences(path.parent / "first", fresh, ("steps", "gas"))):
            idle.append(name)
    more, grown = program.compiled() - compiled, growth(sim, scenario, times)
    if more:
        faults.append(f"{more} kernels compiled by resets")
    say(
        f"{scenario.name}: {'; '.join(faults) or 'the same'} ({compiled} kernels, {more} more after "
        f"{len(list(variants(scenario)))} resets; {grown:+.1f} MB over {times} resets)"
        + (f"; nothing depends on its {', '.join(idle)}" if idle else ""),
        flush=True,
    )
    return int(bool(faults))


def growth(sim: TimeLoop, scenario: Scenario, times: int) -> float:
    """Return the growth of the process's memory [MB] over resets with a tick after each, from a tenth of them on."""
    process, begin = psutil.Process(), 0
    for n in range(times):
        sim.reset(scenario)
        sim.advance()
        if n == times // 10:
            begin = process.memory_info().rss
    return MEGABYTES * (process.memory_info().rss - begin) if times else 0.0


def _run(sim: TimeLoop, out: Path) -> None:
    """Run a simulation to the end and write its table of robots and its result."""
    out.mkdir(parents=True, exist_ok=True)
    table = None
    if sim.swarm.count:
        table = RobotTable(sim, out / "robots.parquet")
        table.start()
        sim.observers.append(table.observer())
    sim.run()
    if table is not None:
        table.close()
    write_result(out, result(sim, "completed", "", "cpu"))


def variants(scenario: Scenario) -> Iterator[tuple[str, Scenario]]:
    """Yield, with a name, the scenario unchanged, with another seed, other speeds, rates and starts, and unchanged."""
    yield "same", scenario
    data = scenario.model_dump(mode="json", exclude_none=True)
    others = {
        "seed": data | {"seed": data["seed"] + 1},
        "speed": data | {"wind": _scaled(data["wind"], SPEEDS, FASTER)},
        "rate": data | {"gas": _scaled(data["gas"], RATES, MORE)},
        "start": data | {"robots": [r | {"start": _moved(r["start"])} for r in data["robots"]]},
    }
    for name, other in others.items():
        if other != data:
            yield name, Scenario.model_validate(other)
    yield "same", scenario


def _scaled(value: Any, keys: Sequence[str], factor: float, within: bool = False) -> Any:
    """Return `value` with the numbers under `keys` multiplied by `factor`."""
    if isinstance(value, dict):
        return {key: _scaled(part, keys, factor, key in keys) for key, part in value.items()}
    if isinstance(value, list):
        return [_scaled(part, keys, factor, within) for part in value]
    return value * factor if within and isinstance(value, float) else value


def _moved(start: Keys) -> Keys:
    """Return a start section with its positions moved by -ASIDE along y."""

    def aside(value: Any) -> Any:
        if isinstance(value[0], list):
            return [aside(part) for part in value]
        return [value[0], value[1] - ASIDE]

    return {key: aside(value) if key in STARTS else value for key, value in start.items()}


if __name__ == "__main__":
    sys.exit(main())
