"""
Three quick configs
===================

``configs/gaussian.yaml``, ``configs/plumesim_casting.yaml`` and ``configs/playback.yaml`` solve no air flow and take
some seconds each.
"""

import json
import shlex
from pathlib import Path
from tempfile import mkdtemp

from taichi_plume.__main__ import main

CONFIGS = next(path for path in Path.cwd().resolve().parents if (path / "configs").is_dir()) / "configs"
RUNS = Path(mkdtemp())


def terminal(command):
    """Run a command, with this checkout's configs and a temporary runs folder."""
    name, *options = shlex.split(command.removeprefix("python -m taichi_plume")[1:])
    main([name, *(option.replace("configs", str(CONFIGS)).replace("runs", str(RUNS)) for option in options)])


def print_success(name):
    """Print how many trials of a run found the source."""
    for group in json.loads((RUNS / name / "result.json").read_text())["groups"]:
        found = group["success_rate"] * group["trials"]
        print(f"{group['name']}, {group['algorithm']}: {found:g} of {group['trials']} trials succeeded")


# %%
# The plume of the textbooks
# --------------------------
# The plume is smooth, and a gradient leads to its axis.

terminal("python -m taichi_plume.run configs/gaussian.yaml --out runs/gaussian --quiet")
terminal("python -m taichi_plume picture runs/gaussian --width 900 --out gaussian.png")
print_success("gaussian")

# %%
# PlumeSim's experiment
# ---------------------
# A Roomba zigzags to a leak at the upwind wall.

terminal("python -m taichi_plume.run configs/plumesim_casting.yaml --out runs/plumesim_casting --quiet")
terminal("python -m taichi_plume picture runs/plumesim_casting --width 900 --out plumesim_casting.png")
print_success("plumesim_casting")

# %%
# A plume from a file
# -------------------
# Wind and gas of a PlumeSim log, constant around each of its nodes.

terminal("python -m taichi_plume.run configs/playback.yaml --out runs/playback --quiet")
terminal("python -m taichi_plume picture runs/playback --width 900 --out playback.png")
print_success("playback")
