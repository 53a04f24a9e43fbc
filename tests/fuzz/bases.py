"""Good scenarios to begin from, with their files: all that ship, made coarse, and others with what these have not."""

import re
import shutil
import struct
from pathlib import Path

import numpy as np

CONFIGS = Path(__file__).parents[2] / "configs"
COARSE = 2.5  # times a config's spacing
FINE = ("plumesim_casting", "gaussian", "meandering", "playback")  # no flow is solved there
OWN = """import numpy as np


class Upwind:
    STATE_NAMES = ("AWAY", "UPWIND")

    def __init__(self, speed=0.1):
        self.wanted = speed

    def act(self, robots):
        robots.turn_to(np.arctan2(-robots.wind[:, 1], -robots.wind[:, 0]))
        robots.speed[:] = self.wanted
        robots.state[:] = robots.wind_known
"""
LAWS = """def concentration(points, t):
    return 5.0 + points[:, 0]


def velocity(points, t, speed=0.4):
    return [speed] + [0.0] * (points.shape[1] - 1)
"""
OCCUPANCY = """#env_min(m) -5 2 0.5
#env_max(m) -3.4 3.2 0.9
#num_cells 8 6 2
#cell_size(m) 0.2
"""
PLY = """ply
format ascii 1.0
element vertex 8
property float x
property float y
property float z
element face 6
property list uchar int vertex_indices
end_header
"""
SCENARIOS = {
    "own_laws": """
duration: 3
domain: {size: [4, 2], spacing: 0.1}
wind: {kind: own, file: laws.py, parameters: {speed: 0.3}}
gas: {kind: own, file: laws.py, sources: [{position: [0.2, 1]}]}
""",
    "replay": """
duration: 3
domain: {size: [4, 2], spacing: 0.1, depth: 0.5}
wind: {kind: uniform, velocity: [0.4, 0]}
gas: {kind: gaussian_plume, intensity: 0.1, sources: [{position: [0.2, 1], rate: 5 mg/s}]}
robots:
  - name: real
    count: 2
    reach: 0
    start: {kind: positions, positions: [[3, 0.5], [3, 1.5]]}
    algorithm: {kind: replay, file: bag.mcap, robots: [r2, r1], origin: [0.2, 0.3], start: 0.5}
    sensors: {gas: {kind: mox, model: tgs2620}}
""",
    "imported": """
duration: 3
domain: {size: [1.6, 1.2, 0.4], spacing: 0.1}
wind: {kind: imported, files: wind_%d.csv, occupancy: occupancy.csv, interval: 0.5}
gas: {kind: eulerian, sources: [{position: [0.3, 0.6, 0.2], rate: 10 mg/s}]}
robots:
  - name: team
    count: 2
    start: {kind: line, begin: [1.3, 0.3], end: [1.3, 0.9], heading_deg: 180}
    algorithm: {kind: surge_cast, threshold_ppm: 2}
    body: {radius: 0.05, max_speed: 0.1}
    sensors: {gas: {kind: pid}, wind: {kind: thermal}}
maps: [{kind: gmrf, cell: 0.2}, {kind: wind_gmrf, cell: 0.2, memory: 2}]
""",
    "mesh": """
duration: 5
warm_up: 1
domain: {size: [2.0, 1.6], spacing: 0.1, depth: 0.5}
wind:
  kind: cfd
  openings: [{kind: inlet, face: x-, speed: 0.3 m/s}, {kind: outlet, face: x+}]
  screens: [{kind: honeycomb, axis: x, at: 0.3, loss_coefficient: 2}]
obstacles:
  - {kind: mesh, file: box.stl, section: 0.1}
  - {kind: prism, vertices: [[1.4, 0.2], [1.7, 0.2], [1.7, 0.5]]}
gas:
  kind: eulerian
  species: acetone
  sources: [{position: [0.5, 0.8], rate: 5 mg/s, start: 0.1, stop: 3}]
  inflow: [{opening: 0, concentration: 3 ppm, schedule: [{at: 2, concentration: 0.1 percent}]}]
  surfaces:
    walls: [{face: y-, uptake: 2 mm/s, transfer: 3 mm/s}, {face: y+, concentration: 5 ppm}]
    obstacles: [{number: 1, uptake: 1 mm/s}]
robots:
  - name: a
    count: 2
    start: {kind: area, low: [1.5, 0.7], high: [1.8, 1.4]}
    body: {radius: 0.05, max_speed: 0.2}
    algorithm: {kind: infotaxis, cell: 0.2}
    sensors: {gas: {kind: ideal}, wind: {kind: ideal}}
maps: [{kind: kernel_dmv, cell: 0.2}]
plumesim_log: {rate: 1, cell: 0.2}
""",
    "noses": """
duration: 3
domain: {size: [2.0, 1.6, 0.6], spacing: 0.1}
wind: {kind: synthetic, speed: 5 cm/s}
obstacles: [{kind: sphere, center: [1.2, 0.4, 0.3], radius: 0.2}]
gas:
  kind: mixture
  parts:
    - {kind: eulerian, species: methane, sources: [{position: [0.4, 0.8, 0.2], rate: 5 mg/s}]}
    - {kind: eulerian, species: toluene, sources: [{position: [0.4, 1.2, 0.2], rate: 1 mg/s}]}
robots:
  - name: several
    count: 2
    start: {kind: line, begin: [1.7, 0.6], end: [1.7, 1.2], heading_deg: 180}
    body: {radius: 0.05, max_speed: 0.2}
    algorithm: {kind: casting, threshold_ppm: 2}
    sensors:
      gas:
        - {kind: tdlas, gives: mean, range: 3 m, bearing_deg: 10, tilt_deg: 5, sweep_deg: 60, height: 0.3}
        - {kind: mox, model: tgs2611, heater: {period: 50 ms, hot_share: 0.4}, left: 5 cm, spread: 1, bits: 10}
        - {kind: mox, model: tgs2602, calibrated_for: ammonia, sensitivity: {methane: 0.1}, left: -5 cm}
        - {kind: pid, correction: {toluene: 0.6}, calibrated_for: toluene, ahead: 5 cm}
""",
    "own": """
duration: 4
domain: {size: [4, 3], spacing: 0.2}
wind: {kind: uniform, velocity: [0.5, 0]}
gas: {kind: eulerian, sources: [{position: [0.5, 1.5], rate: 1 mg/s}]}
robots:
  - name: mine
    count: 2
    trials: 2
    start: {kind: positions, positions: [[3, 1], [3, 2]], heading_deg: 90}
    algorithm: {kind: own, file: upwind.py, parameters: {speed: 0.15}}
    sensors: {wind: {kind: ideal}, gas: {kind: ideal}}
""",
    "mixture": """
duration: 4
warm_up: 0.3
domain: {size: [1.6, 1.2], spacing: 0.1, depth: 0.5}
wind:
  kind: cfd
  openings:
    - {kind: fan, face: x-, center: [0.6], diameter: 0.6, speed: 0.5, turbulence_intensity: 0.1}
    - {kind: outlet, face: x+}
obstacles:
  - {kind: cylinder, center: [0.9, 0.9], radius: 0.15}
  - {kind: cylinder, center: [1.3, 0.3], radius: 0.1, motion: {path: [[1, 1.3, 0.8]]}}
gas:
  kind: mixture
  parts:
    - {kind: eulerian, species: ethanol, sources: [{position: [0.3, 0.6], rate: 1.0e-5}]}
    - {kind: puffs, species: acetone, sources: [{position: [0.4, 0.4], rate: 1.0e-5}]}
robots:
  - name: a
    count: 2
    reach: 0.02
    body: {radius: 0.03}
    start: {kind: area, low: [1.0, 0.1], high: [1.5, 0.6]}
    algorithm: {kind: sweep, speed: 0.1}
    localization: {kind: odometry, distance_scale: 0.02, turn_noise_deg: 1}
    sensors: {gas: {kind: pid, calibrated_for: ethanol}}
  - name: b
    count: 1
    body: {radius: 0.03}
    start: {kind: area, low: [1.0, 0.1], high: [1.5, 0.6]}
    algorithm: {kind: least_known}
    localization: {kind: camera, rate: 3}
maps: [{kind: time_series, cell: 0.2, window: 0.5}, {kind: inverse_distance, cell: 0.2}]
""",
    "probed": """
duration: 3
warm_up: 0.4
domain: {size: [1.2, 1.0], spacing: 0.1}
wind:
  kind: cfd
  openings: [{kind: inlet, face: x-, speed: 0.3 m/s, turbulence_intensity: 0.1}, {kind: outlet, face: x+}]
  initial: {velocity: ["0.3 + 0.1*sin(pi*y)", 0]}
  buoyancy: {gravity: [0, -9.81], heat: {initial: {temperature: "where(y > 0.5, 300, 25 + 273.15)"}}}
obstacles: [{kind: cylinder, center: [0.5, 0.5], radius: 0.15}]
gas:
  kind: eulerian
  sources: [{position: [0.2, 0.5], rate: 1 mg/s}]
  initial: {concentration: "1e-5*exp(-((x - 0.3)**2 + (y - 0.4)**2)/0.05)"}
forces: {every: step}
probes:
  every: 0.03
  start: -0.1
  points:
    - {kind: point, name: a, at: [0.9, 0.5]}
    - {kind: line, name: b, start: [0.8, 0.2], end: [0.8, 0.8], count: 4}
    - {kind: grid, name: c, low: [0.1, 0.1], high: [0.3, 0.3], counts: [2, 1]}
""",
    "film": """
duration: 2
domain: {size: [0.6, 0.5, 0.4], spacing: 0.1}
wind: {kind: playback, file: fields.zarr}
gas: {kind: playback, file: fields.zarr, loop: true}
robots:
  - {name: a, count: 1, reach: 0.02, body: {radius: 0.03}, start: {kind: positions, positions: [[0.4, 0.3]]},
     algorithm: {kind: random_walk}}
""",
    "fluent": """
duration: 2
domain: {size: [0.6, 0.5], spacing: 0.1}
wind: {kind: synthetic}
gas: {kind: fluent, files: plume%03d.txt, period: 0.5, cell: 0.1, sources: [{position: [0.1, 0.1]}]}
robots:
  - {name: a, count: 1, reach: 0.02, body: {radius: 0.03}, start: {kind: positions, positions: [[0.4, 0.3]]},
     algorithm: {kind: surge_spiral}}
""",
}


def make(folder: Path, warm_up: float | None = None) -> dict[str, Path]:
    """Write all of them into a folder; their paths by name. warm_up: instead of the configs' [s]."""
    folder.mkdir(parents=True, exist_ok=True)
    for path in sorted(CONFIGS.glob("*.yaml")):
        text = path.read_text()
        if path.stem not in FINE:
            text = re.sub(
                r"spacing: ([\d.]+)", lambda m: f"spacing: {round(COARSE * float(m[1]), 6):g}", text
            )
        if warm_up is not None:
            text = re.sub(r"(warm_up|after): [\d.]+ s", rf"\1: {warm_up} s", text)
            text = re.sub(r"average: [\d.]+ s", f"average: {warm_up / 2} s", text)
        (folder / path.name).write_text(text.replace("trials: 500", "trials: 3"))
    shutil.copytree(CONFIGS / "plumes", folder / "plumes", dirs_exist_ok=True)
    for name, text in SCENARIOS.items():
        (folder / f"{name}.yaml").write_text(text)
    (folder / "upwind.py").write_text(OWN)
    (folder / "laws.py").write_text(LAWS)
    _write_wind(folder)
    _write_boxes(folder)
    _write_bags(folder)
    _write_plan(folder / "plan.yml")
    _write_film(folder / "fields.zarr")
    titles = "nodenumber, x-coordinate, y-coordinate, acetone\n"
    for n in (1, 2):
        rows = [f"{k + 1},{0.1 * (k % 6):.3g},{0.1 * (k // 6):.3g},{0.01 * (k + n):.4g}\n" for k in range(30)]
        (folder / f"plume{n:03d}.txt").write_text(titles + "".join(rows))
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def _write_bags(folder: Path) -> None:
    """Write bag.mcap, bag.db3 and the folder bag, of two robots."""
    from tests.files import recorded_bag as bag

    messages: list[bag.Message] = []
    for n in range(30):
        t = 1.0 + 0.2 * n
        for k in (1, 2):
            messages.append((t, f"/r{k}/odom", bag.pose(t, 0.5 + 0.1 * n, 0.4 * k, 0.1 * n)))
            messages.append((t, f"/r{k}/gas", bag.gas(t, 7.0 * n % 40, frame=f"r{k}/nose")))
        messages.append((t, "/r1/wind", bag.wind(t, 0.3, 0.1 * n)))
        messages.append((t, "/tf", bag.transforms(t, ("map", "r2/nose", 0.5 + 0.1 * n, 0.8, 0.0))))
    for storage, name in (("mcap", "bag.mcap"), ("sqlite3", "bag.db3")):
        made = folder / "bag"
        shutil.rmtree(made, ignore_errors=True)
        bag.write(made, messages, storage)
        (file,) = (one for one in made.iterdir() if one.suffix in (".mcap", ".db3"))
        shutil.copy(file, folder / name)


def _write_wind(folder: Path) -> None:
    """Points of a stream in no order, and an occupancy grid with a block."""
    axes = [low + 0.1 * (np.arange(n) + 0.5) for n, low in ((16, -5.0), (12, 2.0), (4, 0.5))]
    x = np.random.default_rng(5).permutation(np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3))
    u = 0.3 * np.sin(np.pi * (x[:, 1] - 2.0) / 1.2)
    header = '"U:0","U:1","U:2","Points:0","Points:1","Points:2"'
    for n in range(3):
        columns = np.column_stack([u * (1 + 0.1 * n), 0 * u, 0 * u, x])
        np.savetxt(folder / f"wind_{n}.csv", columns, fmt="%.7g", delimiter=",", header=header, comments="")
    solid = np.zeros((8, 6, 2), int)
    solid[3:5, 1:4, :1] = 1
    layers = ("\n".join(" ".join(map(str, row)) for row in solid[:, :, z]) for z in range(2))
    (folder / "occupancy.csv").write_text(OCCUPANCY + "".join(f"{layer}\n;\n" for layer in layers))


def _write_plan(path: Path) -> None:
    """A map of a room with a wall of one pixel in it, as ROS has it."""
    from PIL import Image

    shades = np.full((60, 80), 254, np.uint8)
    shades[0] = 205
    shades[:30, 30] = 0
    Image.fromarray(shades).save(path.with_suffix(".pgm"))
    path.write_text(
        "image: plan.pgm\nresolution: 0.05\norigin: [-1.0, -2.0, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )


def _write_boxes(folder: Path) -> None:
    """Write a box of six quads as OBJ and PLY, and of 12 triangles as STL."""
    corners = np.array([[x, y, z] for x in (0.8, 1.1) for y in (0.6, 0.9) for z in (0.0, 0.3)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    points = [f"{x:g} {y:g} {z:g}" for x, y, z in corners]
    faces = [f"f {a + 1} {b + 1} {c + 1} {d + 1}" for a, b, c, d in quads]
    (folder / "box.obj").write_text("\n".join([*(f"v {point}" for point in points), *faces]) + "\n")
    faces = [f"4 {a} {b} {c} {d}" for a, b, c, d in quads]
    (folder / "box.ply").write_text(PLY + "\n".join([*points, *faces]) + "\n")
    with (folder / "box.stl").open("wb") as file:
        file.write(b"\0" * 80 + struct.pack("<I", 12))
        for a, b, c, d in quads:
            for triangle in ((a, b, c), (a, c, d)):
                file.write(struct.pack("<12fH", 0, 0, 0, *corners[list(triangle)].ravel(), 0))


def _write_film(path: Path) -> None:
    """Three frames of noise, of a wind and a gas."""
    from taichi_plume.files.film import dimensions
    from taichi_plume.files.film_writer import NewFilm
    from taichi_plume.scenario.species import SPECIES

    shape = (6, 5, 4)
    more = {"": 0, "face": 1, "ghost": 2}

    def size(name: str) -> list[int]:
        return [shape["xyz".index(d[0])] + more[d.partition("_")[2]] for d in dimensions(name, 3)]

    rng = np.random.default_rng(5)
    moving = ["u_face", "v_face", "w_face", "gas_acetone"]
    names = ["volume", "air", *(kind + name for kind in ("open_", "area_") for name in moving[:3])]
    still = {name: np.ones(size(name), np.float32) for name in names}
    source = {"position": [0.3, 0.2, 0.2], "rate": 1e-5}
    facts = {
        "depth": 1.0,
        "periodic": [False] * 3,
        "viscosity": 1e-5,
        "schmidt": 1.0,
        "gases": {"gas_acetone": {"species": "acetone", "sources": [source]}},
    }
    shutil.rmtree(path, ignore_errors=True)
    film = NewFilm(path, shape, 0.1, facts, moving, still, (SPECIES["acetone"],))
    for n in range(3):
        film.append(0.5 * n, {name: 0.1 * rng.random(size(name), np.float32) for name in moving})
    film.flush()
