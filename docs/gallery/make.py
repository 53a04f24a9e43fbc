"""Renew the gallery's pictures: ``python docs/gallery/make.py [NAMES]``.

Runs each config and draws its recording with `python -m taichi_plume picture`, two at a time; all configs take some
five minutes on two cores. pictures.json stores the pictures and the digest of each config: a test fails if a config has
changed since. `--runs FOLDER` draws existing runs, FOLDER/NAME each. README.md shows the films in TILES.
"""

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from PIL import Image

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
CONFIGS = ROOT / "configs"
KEPT = HERE / "pictures.json"
LOCK = threading.Lock()
TILES = ("casting_room.gif", "arena_3d.gif", "drone_search.gif")  # films in README.md
LARGEST, LARGEST_TILE = 300_000, 700_000  # bytes of a picture
COLOURS = {".png": (256, 128, 64, 32, 16), ".gif": (64, 48)}  # tried in turn until a picture fits
FEWER = 0.85  # of the frames of a film that does not fit with the fewest colours
FILM = ("--frames", "30", "--fps", "6", "--width", "480")
SMOOTH_FILM = ("--frames", "60", "--fps", "8", "--width", "480")  # of TILES
STILL = ("--width", "1000")

PICTURES: dict[str, dict[str, tuple[str, ...]]] = {
    "casting_room": {"casting_room.gif": ("--end", "62")},
    "arena_3d": {"arena_3d.gif": ("--end", "40", "--view", "column")},
    "moving_obstacle": {"moving_obstacle.gif": ("--end", "24")},
    "drone_search": {"drone_search.gif": ("--view", "section")},
    "fan_array": {"fan_array.gif": ("--begin", "5", "--end", "55")},
    "gaussian": {"gaussian.png": ("--at", "75", "--view", "column")},
    "plumesim_gaussian": {"plumesim_gaussian.png": ("--at", "21")},
    "plumesim_meandering": {"plumesim_meandering.png": ("--at", "21")},
    "meandering": {"meandering.gif": ("--begin", "30", "--end", "60")},
    "whiffs": {"whiffs.gif": ("--begin", "100", "--end", "124")},
    "puffs_arena": {"puffs_arena.gif": ("--end", "20")},
    "frozen_room": {"frozen_room.png": ("--at", "20")},
    "dapso_arena": {"dapso_arena.png": ("--at", "60")},
    "odor_mapping_dapso": {"odor_mapping_dapso.png": ("--at", "60")},
    "odor_mapping_lineup": {"odor_mapping_lineup.png": ("--at", "60")},
    "quiet_room": {"quiet_room.gif": ("--end", "120", "--view", "section")},
    "playback": {"playback.png": ("--at", "23")},
    "plumesim_casting": {"plumesim_casting.png": ()},
    "sensor_network": {"sensor_network.png": ()},
    "spiral_room": {"spiral_room.png": ()},
    "heated_room": {
        "heated_room.png": ("--of", "temperature", "--view", "section_2"),
        "heated_room_gas.png": ("--view", "section"),
    },
}
"""Picture files of each config, with their drawing options; the default is the end of the run."""


def main() -> int:
    """Run the command line. Return 1 if drawing of a config failed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAMES", help="configs (default: all)")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="runs at a time (default: 2)")
    parser.add_argument("--runs", type=Path, metavar="FOLDER", help="draw the runs in this folder")
    args = parser.parse_args()
    names = args.names or sorted(path.stem for path in CONFIGS.glob("*.yaml"))
    failed = []
    with ThreadPoolExecutor(args.jobs) as pool:
        for name, fault in zip(names, pool.map(lambda name: _try(name, args.runs), names), strict=True):
            print(f"{name}: {fault or 'drawn'}", flush=True)
            failed += [name] if fault else []
    return 1 if failed else 0


def _try(name: str, runs: Path | None) -> str:
    """Draw a config. Return the error message, or an empty string."""
    try:
        if runs is not None:
            draw(name, runs / name)
        else:
            with tempfile.TemporaryDirectory() as folder:
                _python(
                    "taichi_plume.run", str(CONFIGS / f"{name}.yaml"), "--out", f"{folder}/{name}", "--quiet"
                )
                draw(name, Path(folder) / name)
    except subprocess.CalledProcessError as error:
        return (error.stderr or "").strip().splitlines()[-1:][0] if error.stderr else str(error)
    return ""


def draw(name: str, run: Path) -> None:
    """Draw the pictures of a run, and store the digest of its config."""
    pictures = PICTURES.get(name, {f"{name}.png": ()})
    for file, options in pictures.items():
        path = HERE / "pictures" / file
        path.parent.mkdir(exist_ok=True)
        film = path.suffix == ".gif"
        target = ["--film" if film else "--out", str(path)]
        size = SMOOTH_FILM if file in TILES else FILM if film else STILL
        _python("taichi_plume", "picture", str(run), *options, *size, *target)
        fit(path)
    with LOCK:
        known = json.loads(KEPT.read_text(encoding="utf-8")) if KEPT.exists() else {}
        known[name] = {"config": digest(CONFIGS / f"{name}.yaml"), "pictures": sorted(pictures)}
        KEPT.write_text(json.dumps(dict(sorted(known.items())), indent=1) + "\n", encoding="utf-8")


def digest(config: Path) -> str:
    """SHA-256 of a config, independent of its line ends."""
    return hashlib.sha256(config.read_bytes().replace(b"\r\n", b"\n")).hexdigest()


def fit(path: Path) -> None:
    """Reduce the colours of a picture until its file is small enough; for a film, then the frames."""
    with Image.open(path) as image:
        duration = image.info.get("duration", 0)
        frames = []
        for n in range(getattr(image, "n_frames", 1)):
            image.seek(n)
            frames.append(image.convert("RGB"))
    count = float(len(frames))
    while count >= 1.0:
        step = len(frames) / int(count)
        shown = [frames[int(n * step)] for n in range(int(count))]
        for colours in COLOURS[path.suffix]:
            # MAXCOVERAGE keeps rare colours of a film, such as those of robots; a still has enough colours
            how = Image.Quantize.MAXCOVERAGE if len(frames) > 1 else Image.Quantize.MEDIANCUT
            palette = _sheet(frames).quantize(colours, how, dither=Image.Dither.NONE)
            less = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in shown]
            more = {
                "save_all": True,
                "append_images": less[1:],
                "duration": round(duration * step),
                "loop": 0,
            }
            less[0].save(path, optimize=True, **(more if path.suffix == ".gif" else {}))
            if path.stat().st_size <= largest(path):
                return
        count *= FEWER


def largest(path: Path) -> int:
    """Size limit of a picture [bytes]."""
    return LARGEST_TILE if path.name in TILES else LARGEST


def _sheet(frames: list[Image.Image]) -> Image.Image:
    """Sheet of an early, a middle and a late frame, for one palette of the whole film."""
    width, height = frames[0].size
    sheet = Image.new("RGB", (width, 3 * height))
    for n in range(3):
        sheet.paste(frames[(2 * n + 1) * len(frames) // 6], (0, n * height))
    return sheet


def _python(module: str, *args: str) -> None:
    """Run a module of this checkout."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", module, *args]
    subprocess.run(command, check=True, capture_output=True, text=True, env=environment, cwd=ROOT)


if __name__ == "__main__":
    sys.exit(main())
