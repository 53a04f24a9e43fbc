"""Write a room of 4 x 3 x 1 m as GADEN has it: wind at cell centres, now and a second later, and an occupancy grid."""

import sys
from pathlib import Path

import numpy as np

CELL, SHAPE = 0.2, (20, 15, 5)
TABLE = (slice(9, 12), slice(6, 9), slice(0, 3))  # cells that are an obstacle

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
solid = np.zeros(SHAPE, int)
solid[TABLE] = 1
places = (np.argwhere(solid == 0) + 0.5) * CELL

for number, speed in enumerate((0.3, 0.35)):
    x, y, _ = places.T
    wind = np.zeros_like(places)
    wind[:, 0] = speed * (1.0 - 0.5 * np.exp(-((y - 1.5) ** 2) / 0.2) * (x > 1.8))  # slower behind the table
    table = np.hstack([wind, places])
    name = folder / f"wind_at_cell_centers_{number}.csv"
    np.savetxt(name, table, "%.5g", ",", header="U:0,U:1,U:2,Points:0,Points:1,Points:2", comments="")

nx, ny, nz = SHAPE
lines = ["#env_min(m) 0 0 0", f"#env_max(m) {nx * CELL:g} {ny * CELL:g} {nz * CELL:g}"]
lines += [f"#num_cells {nx} {ny} {nz}", f"#cell_size(m) {CELL:g}"]
for layer in range(nz):
    lines += [" ".join(map(str, row)) for row in solid[:, :, layer]] + [";"]
(folder / "OccupancyGrid3D.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
