"""Make a PlumeSim log of a Zarr movie: `concentration` over (time, y, x); attributes fps, pixel_to_grid, origin."""

import argparse

import numpy as np
import zarr

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("movie")
parser.add_argument("log")
parser.add_argument("--step", type=int, default=1, help="pixels to a node, and their mean is taken")
parser.add_argument("--wind", type=float, default=0.0, help="speed along x [m/s], as movies tell none")
args = parser.parse_args()

group = zarr.open_group(args.movie, mode="r")
movie, known = group["concentration"], dict(group.attrs) | dict(group["concentration"].attrs)
step, pixel = args.step, float(np.ravel(known.get("pixel_to_grid", 1.0))[0])
x0, y0 = known.get("origin", (0.0, 0.0))
frames, height, width = (n // k for n, k in zip(movie.shape, (1, step, step), strict=True))
cell, period = step * pixel, round(1000.0 / float(known.get("fps", 10.0)))
full = max(float(np.max(movie[n])) for n in range(frames))

with open(args.log, "w", encoding="utf-8") as file:
    file.write(f"{period},{frames},{cell:.6g}\n")
    for n in range(frames):
        image = np.asarray(movie[n], float)[: height * step, : width * step]
        image = 100.0 / full * image.reshape(height, step, width, step).mean(axis=(1, 3))
        file.write(f"+{n + 1} {image.size}\n")
        for (j, i), percent in np.ndenumerate(image):
            x, y = x0 + (i + 0.5) * cell, y0 + (j + 0.5) * cell
            file.write(f"{x:.5g},{y:.5g},0,{args.wind:g},0,{percent:.4g}\n")
