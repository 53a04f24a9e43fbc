"""
2. A CAD model and 3-D
======================

Furniture from a CAD program, a fan, and a leak near the floor, in 3-D. Compared with :doc:`plot_1_room`, every
position has one more number; the rest of the scenario is the same.
"""

# %%
# The same two helpers as before replace your terminal and your editor.

import shlex
import sys
from contextlib import redirect_stderr
from pathlib import Path

import numpy as np

from taichi_plume.__main__ import main


def terminal(command):
    """Type a command, such as ``python -m taichi_plume.run room.yaml``."""
    with redirect_stderr(sys.stdout):
        main(shlex.split(command.strip().removeprefix("python -m taichi_plume")[1:]))


def write(text):
    """Save the scenario, as your editor would."""
    Path("lab.yaml").write_text(text)


# %%
# An STL file
# -----------
# You would export it from your CAD program: one or more closed bodies, as STL, OBJ or PLY. Here NumPy makes an L-shaped
# bench in millimetres, the unit of most CAD programs: an outline, extruded to its height.

# corners in mm, counter-clockwise, and triangles that fill the outline
OUTLINE = np.array([[0, 0], [1000, 0], [1000, 400], [400, 400], [400, 1200], [0, 1200]])
CAP = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)]
HEIGHT = 500  # mm


def bench():
    """Triangles of the bench, (n, 3, 3), counter-clockwise from outside."""
    low, high = (np.column_stack([OUTLINE, np.full(len(OUTLINE), z)]) for z in (0, HEIGHT))
    sides = []
    for n in range(len(OUTLINE)):
        m = (n + 1) % len(OUTLINE)
        sides += [(low[n], low[m], high[m]), (low[n], high[m], high[n])]
    floor = [(low[c], low[b], low[a]) for a, b, c in CAP]
    top = [(high[a], high[b], high[c]) for a, b, c in CAP]
    return np.array(sides + floor + top)


def save_stl(path, triangles):
    """Write a binary STL."""
    layout = [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")]
    record = np.zeros(len(triangles), layout)
    record["corners"] = triangles
    header = b"made with NumPy".ljust(80) + np.uint32(len(triangles)).tobytes()
    path.write_bytes(header + record.tobytes())


save_stl(Path("bench.stl"), bench())

# %%
# Into a room
# -----------
# Three numbers in ``size`` make the scenario 3-D. The fan is in the left wall, its middle 40 cm above the floor, and
# blows at 0.8 m/s; an outlet in the wall opposite lets the air out. The bench stands at (1.6, 1.8) m.

LAB = """
name: lab
seed: 1
duration: 60 s
warm_up: 15 s
domain: {size: [4 m, 3.2 m, 1.2 m], spacing: 8 cm}
wind:
  kind: cfd
  openings:
    - kind: fan
      face: x-
      center: [1.6, 0.4]       # y and z
      diameter: 60 cm
      speed: 0.8 m/s
      turbulence_intensity: 0.08
    - {kind: outlet, face: x+, center: [1.6, 0.6], size: [2.4, 0.8]}
obstacles:
  - {kind: mesh, file: bench.stl, translate: [1.6, 1.8, 0]}
gas:
  kind: eulerian
  species: acetone
  sources:
    - {position: [0.9, 1.5, 0.15], rate: 20 mg/s}
"""
write(LAB)
terminal("python -m taichi_plume.run lab.yaml --check")

# %%
# The bench is a thousand times too large: STL files have no unit, and the message suggests a factor. With ``scale`` the
# bench fits. There are 50 by 40 cells of 8 cm in each of 15 layers; at least six of them across the fan make a jet that
# widens as real ones do (:doc:`/air` states what a cell size resolves).

LAB = LAB.replace("file: bench.stl", "file: bench.stl, scale: 0.001")
ROBOTS = """
robots:
  - name: seekers
    count: 3
    start: {kind: line, begin: [3.6, 0.8], end: [3.6, 2.4]}
    algorithm: {kind: surge_cast, threshold_ppm: 3}
    sensors: {gas: {kind: mox, model: mics5524}, wind: {kind: ultrasonic}}
"""
write(LAB + ROBOTS)
terminal("""
python -m taichi_plume.run lab.yaml --set 'fields={rate: 1}' \
    --out runs/lab --force
""")

# %%
# Look at it
# ----------
# From above, each point shows the largest concentration over the height, so a plume at any height is visible.
# ``--allow-outside`` lets the command read the bench, which lies beside the scenario and not in the folder of the run.

terminal("""
python -m taichi_plume picture runs/lab --at 14 --allow-outside --out above.png
""")

# %%
# And from the side, in the plane of the source: in 3-D the readings depend on the heights of source and gas sensor.

terminal("""
python -m taichi_plume picture runs/lab --at 14 --view section \
    --allow-outside --out section.png
""")

# %%
# In the recording, ``rerun runs/lab/recording.rrd``, you can walk around the room, pause and rewind.
#
# A profile
# ---------
# ``fields`` in the scenario records wind and gas of every cell, as an xarray Dataset with units. This is the profile of
# the gas over the height, half-way between source and robots:

import matplotlib.pyplot as plt

from taichi_plume import open_run

fields = open_run("runs/lab").fields
column = fields.acetone_ppm.sel(x=2.2, y=1.5, method="nearest").mean("time")
figure, axes = plt.subplots(figsize=(4, 4), layout="constrained")
axes.plot(column, column.z)
axes.set(xlabel="acetone, mean [ppm]", ylabel="z [m]", ylim=(0, 1.2))

# %%
# Where to go from here
# ---------------------
# - What 8 cm cells resolve of a jet and of a floor: :doc:`/air`.
# - Record one flow and search it a hundred times: :doc:`/howto/many_trials`.
# - Open the fields in ParaView: :doc:`/howto/results`.
