"""
1. A room in 2-D
================

From an empty file to robots that find a leak of ethanol: you write one text file, step by step, and run one command.
Each run takes some seconds on a laptop.

You would do this in an empty folder: write the file ``room.yaml`` with your editor, and type commands in a terminal.
This page is a Python file instead, so that the build can execute it.
"""

# %%
# Two helpers replace your terminal and your editor here; you do not need them.

import shlex
import sys
from contextlib import redirect_stderr
from pathlib import Path

from taichi_plume.__main__ import main


def terminal(command):
    """Type a command, such as ``python -m taichi_plume.run room.yaml``."""
    with redirect_stderr(sys.stdout):
        main(shlex.split(command.strip().removeprefix("python -m taichi_plume")[1:]))


def write(text):
    """Save the scenario, as your editor would."""
    Path("room.yaml").write_text(text)


# %%
# What a scenario needs
# ---------------------
# Start with an empty file. ``--check`` validates a scenario and reports its errors, without running anything.

write("")
terminal("python -m taichi_plume.run room.yaml --check")

# %%
# So four things are needed: the duration, the size of the room, the wind, and the gas.
#
# The room is 5 m by 4 m. A run in 2-D is a view from above on a slab of air. ``depth`` is the height of the slab; it
# determines how many ppm a leak of a given mg/s produces. The grid has square cells of ``spacing``: smaller cells
# resolve more and take longer (:doc:`/air`). Air enters through a window in the left wall (``x-``) and leaves through
# the right one (``x+``); the rest of the boundary is wall. Numbers may have a unit, else they are SI.

write("""
name: room
duration: 20 s
warm_up: 20 s
domain: {size: [5 m, 4 m], spacing: 5 cm, depth: 0.5 m}
wind:
  kind: cfd
  openings:
    - {kind: inlet, face: x-, center: [2], size: [2.4], velocity: 0.5 m/s}
    - {kind: outlet, face: x+}
gas:
  kind: eulerian
  species: ethanol
  sources:
    - {position: [0.8, 2.1], rate: 20 mg/s}
""")
terminal("python -m taichi_plume.run room.yaml --check")

# %%
# One line per error, with the path of the key and the allowed values: an inlet has a ``speed``, as it always blows
# straight in. A run starts only when no error is left.
#
# Here is the corrected file, with furniture that reaches to the ceiling of the slab: a cupboard and a pillar.

AIR = """
name: room
seed: 1
duration: 20 s
warm_up: 20 s                  # wind and gas before t = 0
domain: {size: [5 m, 4 m], spacing: 5 cm, depth: 0.5 m}
wind:
  kind: cfd                    # solve for the air flow
  openings:
    - kind: inlet
      face: x-
      center: [2]              # middle of the window, along the wall
      size: [2.4]
      speed: 0.5 m/s
      turbulence_intensity: 0.1
    - {kind: outlet, face: x+}
obstacles:
  - {kind: box, center: [2.2, 2.9], size: [0.8, 0.4]}
  - {kind: cylinder, center: [2.4, 1.3], radius: 0.15}
gas:
  kind: eulerian               # gas on the same cells as the air
  species: ethanol
  sources:
    - {position: [0.8, 2.1], rate: 20 mg/s}
"""
write(AIR)
terminal("python -m taichi_plume.run room.yaml --out runs/air --force")

# %%
# That was the whole run: the flow was solved for 40 seconds, of which the first 20 were a warm-up, and the ethanol was
# advected. ``unaccounted for`` is the mass balance: gas that is neither in the room nor blown out.
#
# ``--out`` names the folder of the run; the default is ``runs/room-1``, then ``runs/room-2``. ``--force`` renames the
# folder of an earlier run to ``runs/air.old``. The folder holds a recording, which ``rerun runs/air/recording.rrd``
# plays and rewinds, and ``report.html`` for your browser. A picture for your talk:

terminal("python -m taichi_plume picture runs/air --at 20 --out air.png")

# %%
# Robots
# ------
# A robot has a body, a gas sensor, perhaps an anemometer, and a search algorithm. These three are small wheeled robots
# with a TGS2620, a metal-oxide sensor that rises within seconds and decays more slowly, and an ultrasonic anemometer.
# They *cast*: upwind while they detect gas, across the wind after losing it. They do not know the source position.

ROBOTS = """
robots:
  - name: seekers
    count: 3
    start: {kind: line, begin: [4.5, 0.6], end: [4.5, 3.4]}
    algorithm: {kind: casting, threshold_ppm: 5}
    sensors: {gas: {kind: mox, model: tgs2620}, wind: {kind: ultrasonic}}
"""
write(AIR.replace("duration: 20 s", "duration: 120 s") + ROBOTS)
terminal("python -m taichi_plume.run room.yaml --out runs/robots --force")

# %%
# A picture of the search:

terminal("python -m taichi_plume picture runs/robots --at 26 --out robots.png")
# sphinx_gallery_thumbnail_number = 2

# %%
# All three found the source long before the 120 seconds were over, so the run ended there. ("Found" means: within 35 cm
# of the source, the key ``reach``. The robot itself does not know.)
#
# A table records states and readings, one row per robot and tick.

from taichi_plume import open_run

table = open_run("runs/robots").robots
table.tail(3)

# %%
# The paths of all robots, and the readings of one. The grey line is the true concentration at its gas sensor; the
# reading is delayed and smoothed. Search algorithms have to cope with this, so they are tested with such a sensor here.

import matplotlib.pyplot as plt

figure, (plan, series) = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
for number, path in table.groupby("robot"):
    plan.plot(path.x, path.y, label=f"robot {number}")
    plan.plot(path.x.iloc[0], path.y.iloc[0], "k.")
plan.plot(0.8, 2.1, "*", color="crimson", markersize=14, label="source")
plan.set(xlim=(0, 5), ylim=(0, 4), aspect="equal", xlabel="x [m]", ylabel="y [m]")
plan.legend(loc="upper right")
one = table[table.robot == 1]
series.plot(one.t, one.true_ppm, color="0.6", label="true")
series.plot(one.t, one.reading_ppm, label="TGS2620")
series.set(xlabel="t [s]", ylabel="ethanol [ppm]", title="robot 1")
series.legend()

# %%
# Is that luck?
# -------------
# One search says little. ``trials`` puts many independent copies of the team into the same flow realisation, at once:
# they do not meet, and each has its own sensors, noise and random numbers. ``--set`` changes any key for one run,
# without editing the file.

terminal("""
python -m taichi_plume.run room.yaml --duration 90 --set robots.0.trials=50 \
    --no-recording --out runs/casting --force
""")

# %%
# The result has a confidence interval, as 50 trials are still few, and a warning: all trials share *one* flow
# realisation, an *air* for short. Another ``--seed`` gives another one. Another algorithm, in the same realisation, for
# a fair comparison:

terminal("""
python -m taichi_plume.run room.yaml --duration 90 --set robots.0.trials=50 \
    --set 'robots.0.algorithm={kind: surge_spiral}' \
    --no-recording --out runs/spiral --force
""")

# %%
# ``result.json`` has the figures too, per trial and with 95 % intervals. Where two intervals overlap, the difference
# may be chance.

import json

for name in ("casting", "spiral"):
    (team,) = json.loads(Path(f"runs/{name}/result.json").read_text())["groups"]
    time = team["summary"]["time_s"]
    print(f"{team['algorithm']:13} {time['mean']:5.1f} s, 95 %: {time['low']:.1f} to {time['high']:.1f} s")

# %%
# Where to go from here
# ---------------------
# - :doc:`plot_2_mesh` takes furniture from a CAD file and goes to 3-D.
# - :doc:`/howto/results` reads the files of a run: tables, fields, pictures, the report.
# - :doc:`/howto/own_algorithm` adds your own search algorithm to this room.
# - :doc:`/reference/index` lists every key of a scenario, with its unit, range and default.
