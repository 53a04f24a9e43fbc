"""Draw the pictures of SPIRAL in algorithms.md from a run: ``python docs/models/make.py``.

spiral_path.png: paths of a robot that makes no HIT, and of one that does. spiral_states.png: states and transitions, as
both robots go through them in the run.
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1]))

import taichi_plume as tp  # noqa: E402

SOURCE = (4.4, 2.6)  # m
SCENARIO = {
    "duration": 700.0,
    "tick": 0.25,
    "stop_early": False,
    "domain": {"size": [6.0, 4.0], "spacing": 0.1},
    "wind": {"kind": "uniform", "velocity": [0.0, 0.0]},
    "robots": [
        {
            "name": name,
            "count": 1,
            "start": {"kind": "positions", "positions": [place]},
            "algorithm": {"kind": "spiral", "minimum_ppm": minimum},
            "body": {"kind": "momo"},
            "sensors": {"gas": {"kind": "ideal"}},
        }
        for name, place, minimum in (("no HIT", [2.5, 2.0], 1e6), ("HIT", [1.2, 1.2], 0.2))
    ],
}
TEXTS = {  # of transitions: from, to, whether the last acquisition was a HIT; with the bend of the arrow
    ("ARM", "ACQUIRE", None): ("end of the arm", 0.0),
    ("ACQUIRE", "ARM", True): ("HIT: PI ≥ T\nT becomes PI; a new spiral straight on", 0.35),
    ("ACQUIRE", "ARM", False): ("MISS: PI < T\nturn by 90°, next arm", -0.3),
    ("ACQUIRE", "ESCAPE", False): ("MISS after the last arm:\nT becomes the minimum,\nrandom turn", 0.0),
    ("ESCAPE", "ARM", None): ("end of the way:\na new spiral", 0.0),
}
PLACES = {"ARM": (0.0, 0.0), "ACQUIRE": (6.0, 0.0), "ESCAPE": (3.0, -3.2)}


def field(points: np.ndarray, t: float) -> np.ndarray:
    """Return the concentration [ppm] at points (n, 2): it falls with the distance from the source."""
    return 1.0 / (0.3 + np.hypot(*(points - np.array(SOURCE)).T))


def main() -> None:
    """Run both robots and draw the pictures."""
    gas = tp.Own(field) | {"sources": [{"position": list(SOURCE)}]}
    rows: list[pd.DataFrame] = []
    with tp.Simulation(SCENARIO, overrides={"gas": gas}) as sim:
        sim.every(0.25, lambda sim: rows.append(sim.robots))
        sim.run()
    robots = [robot for _, robot in pd.concat(rows).groupby("group", sort=False)]
    paths = Figure(figsize=(8.0, 3.4), layout="constrained")
    for axis, robot in zip(paths.subplots(1, 2), robots, strict=True):
        draw_path(axis, robot)
    paths.savefig(HERE / "spiral_path.png", dpi=120)
    states = Figure(figsize=(8.0, 5.4), layout="constrained")
    draw_states(states.subplots(), set().union(*map(transitions, robots)))
    states.savefig(HERE / "spiral_states.png", dpi=120)


def transitions(robot: pd.DataFrame) -> set[tuple[str, str, bool | None]]:
    """Return the transitions of a robot: from, to, and after acquisitions whether the last one was a HIT."""
    before, now = robot["state"].iloc[:-1], robot["state"].iloc[1:]
    each = zip(before, now, robot["index_hit"].iloc[1:], strict=True)
    return {(a, b, bool(hit) if a == "ACQUIRE" else None) for a, b, hit in each if a != b}


def draw_path(axis: Axes, robot: pd.DataFrame) -> None:
    """Draw the path of a robot with its acquisitions: the first spiral and escape, or up to the source."""
    ends = robot["found"] | robot["escapes"].gt(0) & (robot["state"] == "ARM")
    robot = robot.iloc[: int(np.argmax(ends)) + 1]
    axis.plot(robot["x"], robot["y"], color="0.5", linewidth=1.2)
    axis.plot(*robot[["x", "y"]].iloc[0], "k>", label="start")
    stops = robot[(robot["state"] != "ACQUIRE") & (robot["state"].shift() == "ACQUIRE")]
    for name, hit, mark in (("MISS", 0, "rx"), ("HIT", 1, "go")):
        these = stops[stops["index_hit"] == hit]
        if len(these):
            axis.plot(these["x"], these["y"], mark, label=name)
    escape = robot[robot["state"] == "ESCAPE"]
    if len(escape):
        axis.plot(escape["x"], escape["y"], "b--", label="ESCAPE")
    else:
        axis.plot(*SOURCE, "k*", markersize=10, label="source")
    axis.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    axis.legend(fontsize=8)


def draw_states(axis: Axes, seen: set[tuple[str, str, bool | None]]) -> None:
    """Draw states and the transitions between them."""
    for a, b, hit in seen:
        text, bend = TEXTS[a, b, hit]
        (x, y), (end_x, end_y) = PLACES[a], PLACES[b]
        style = {"arrowstyle": "-|>", "connectionstyle": f"arc3,rad={bend}", "shrinkA": 34, "shrinkB": 34}
        axis.annotate("", (end_x, end_y), (x, y), arrowprops=style | {"color": "0.3"})
        middle = (0.5 * (x + end_x + bend * (end_y - y)), 0.5 * (y + end_y - bend * (end_x - x)))
        axis.text(*middle, text, ha="center", va="center", fontsize=9, backgroundcolor="white")
    for name, place in PLACES.items():
        frame = {"boxstyle": "round,pad=0.7", "facecolor": "#e8eef7", "edgecolor": "0.3"}
        axis.text(*place, name, ha="center", va="center", bbox=frame)
    axis.set(xlim=(-1.0, 7.0), ylim=(-3.8, 1.6), aspect="equal")
    axis.axis("off")


if __name__ == "__main__":
    main()
