"""Occupancy grid maps of ROS's map_server: a YAML file, and beside it a picture of the floor.

The picture's first row is the map's upper edge. A pixel of mean shade s, 0 black to 1 white, is occupied with the
probability p = 1 - s, or s if the map is negated. The mode classifies pixels:

trinary  occupied above `occupied_thresh`, free below `free_thresh`, unknown in between
scale    as trinary, but in between occupied from the middle of both thresholds on; unknown if transparent
raw      255 s are percents, occupied from 50 on; unknown above 100

map_saver writes unknown pixels in grey 205, p = 0.196, and nav2's version of it free_thresh: 0.25: by these rules such
pixels are free. `RosMap.marked` has them.
"""

import os
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from math import pi, radians
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from taichi_plume.grid.shapes import ShapeError
from taichi_plume.guard.safe_open import content_of, inside, moved
from taichi_plume.guard.terminal import LONGEST_VALUE, visible
from taichi_plume.guard.yaml_text import LineError, decode, parse

if TYPE_CHECKING:
    from PIL.Image import Image

LONGEST_YAML = 1 << 16  # bytes
LARGEST_IMAGE = 1 << 28  # bytes
PLAIN = (b"P1", b"P2", b"P3")  # PBM, PGM and PPM as text
MOST_COMMENTS = 1000  # largest number of comments in such a picture
LONGEST_HEADER = 1 << 20  # bytes, comments included
MOST_PIXELS = 50_000_000  # 7000 x 7000
STRIP = 256  # rows
FORMATS = ("PPM", "PNG", "BMP")  # of pictures; PPM includes PGM
FREE, OCCUPIED, UNKNOWN = 0, 1, 2
SUFFIXES = (".yaml", ".yml")
PICTURES = (".pgm", ".png", ".bmp", ".ppm", ".pbm", ".pnm")  # of maps without a YAML file
DEFAULTS = {"negate": 0, "occupied_thresh": 0.65, "free_thresh": 0.25}  # map_saver's
MODES = ("trinary", "scale", "raw")
FARTHEST = 1e8  # m: room for coordinates of the Earth
RESOLUTIONS = (1e-4, 1e3)  # m
HALF = 50  # percent: from here on a pixel counts as occupied
LONGEST_TEXT = 200  # characters that describe a map
MARK = 205  # grey of unknown pixels, as map_saver writes it
KEYS = (*DEFAULTS, "image", "resolution", "origin", "mode")


class MapError(ShapeError):
    """Error of a map that is missing or cannot be read; the message begins with the map's name."""


@dataclass(frozen=True)
class RosMap:
    """Occupancy map. pixels: FREE, OCCUPIED or UNKNOWN, axes (x, y); resolution: edge of a pixel [m]; origin: lower
    left corner of the picture [m]; yaw: angle by which the picture is turned left about the origin [rad].

    marked: mask of pixels in map_saver's grey for unknown, `mark`, that the thresholds, free_thresh and
    occupied_thresh, make free or occupied. text: file, mode and thresholds in words; remarks: assumptions.
    """

    pixels: np.ndarray
    resolution: float
    origin: tuple[float, float]
    yaw: float
    marked: np.ndarray
    thresholds: tuple[float, float]
    text: str
    remarks: tuple[str, ...]
    mark: int = MARK

    def walls(self, unknown: str | None) -> np.ndarray:
        """Return the mask of wall pixels; unknown: "wall", "free", or None if the user has not decided."""
        solid = self.pixels == OCCUPIED if unknown == "free" else self.pixels != FREE
        return solid if unknown is None else np.where(self.marked, unknown == "wall", solid)

    def remarks_on(self, unknown: str | None) -> tuple[str, ...]:
        """Return a remark if the thresholds contradict map_saver's grey for unknown, or the user's `unknown`."""
        if not self.marked.any():
            has_effect = unknown is None or (self.pixels == UNKNOWN).any()
            low, high = self.thresholds
            rule = f"no pixel is unknown by the mode and the thresholds, {low:g} and {high:g}"
            return () if has_effect else (f"unknown: {unknown} has no effect: {rule}",)
        is_free = (self.pixels[self.marked] == FREE).all()
        meant, other, by = ("free", "wall", "free_thresh") if is_free else ("wall", "free", "occupied_thresh")
        start = f"{self.marked.sum():,} pixels of grey {self.mark}, map_saver's mark for unknown, "
        rule = f"{by} {self.thresholds[not is_free]:g}"
        if unknown is None:
            cure = (
                "unknown: wall, or free_thresh 0.196, makes them walls"
                if is_free
                else "unknown: free frees them"
            )
            return (f"{start}count as {meant} by {rule}; {cure}",)
        return (f"{start}are {other} by unknown: {other}, not {meant} by {rule}",) if unknown == other else ()


def read_map(path: Path, resolution: float | None = None) -> RosMap:
    """Read a map from a YAML file, whose picture lies in its folder or below, or a picture alone. Raises MapError.

    resolution: edge of a pixel [m] of a picture alone, whose lower left corner is the origin of the frame.
    """
    data, image, remarks = _described(path, resolution)
    levels, most, opaque = read_picture(path, image)
    if unread := [visible(key, LONGEST_VALUE) for key in data if key not in KEYS]:
        remarks.append(f"not read: {', '.join(unread)}")
    known = {key: _number(path, data, key, 0.0, 1.0) for key in DEFAULTS}
    mode = data.get("mode", MODES[0])
    if mode not in MODES:
        raise _wrong(path, f"mode: got {_shown(mode)}; allowed: {', '.join(MODES)}")
    if not known["free_thresh"] < known["occupied_thresh"]:
        raise _wrong(path, "free_thresh: must be less than occupied_thresh")
    of_level = _meanings(np.arange(most + 1) / most, known, mode)
    pixels = of_level[levels]
    grey = np.zeros(most + 1, bool)
    mark = 255 - MARK if known["negate"] else MARK
    if mode == MODES[0] and of_level[level := mark * most // 255] != UNKNOWN:
        grey[level] = True
    if mode == "scale" and opaque is not None:
        pixels[~opaque] = UNKNOWN
    origin = data.get("origin")
    if not isinstance(origin, list) or len(origin) not in (2, 3):
        raise _wrong(path, f"origin: must be [x, y, yaw], got {_shown(origin)}")
    place = {f"origin[{n}]": value for n, value in enumerate([*origin, 0.0][:3])}
    x, y, yaw = (_number(path, place, key, -FARTHEST, FARTHEST) for key in place)
    if abs(yaw) > 2.0 * pi:
        raise _wrong(
            path, f"origin[2]: is the yaw in radians, got {yaw:g}; {yaw:g} degrees are {radians(yaw):.6g}"
        )
    size = _number(path, data, "resolution", *RESOLUTIONS)
    rows, columns = pixels.shape
    rule = "mode raw" if mode == "raw" else f"mode {mode}, thresholds {known['free_thresh']:g} and "
    rule += "" if mode == "raw" else f"{known['occupied_thresh']:g}"
    text = f"map {image.name}, {columns} x {rows} pixels of {size:g} m, {rule}"
    text += ", negated" if known["negate"] else ""
    marked, thresholds = grey[levels][::-1].T, (known["free_thresh"], known["occupied_thresh"])
    text = visible(text, LONGEST_TEXT)
    return RosMap(pixels[::-1].T, size, (x, y), yaw, marked, thresholds, text, tuple(remarks), mark)


def _described(path: Path, resolution: float | None) -> tuple[dict[str, object], Path, list[str]]:
    """Return the keys of a map's YAML file, the path of its picture, and remarks. Raises MapError."""
    if path.suffix.lower() not in PICTURES:
        data = _yaml(path)
        if resolution is not None:
            raise _wrong(path, "is a YAML file, which has its own resolution; remove the key resolution")
        image, remarks = _image(path, data)
        lacking = [
            f"{key} is missing, {value:g} is assumed" for key, value in DEFAULTS.items() if key not in data
        ]
        return data, image, [*remarks, *lacking]
    if resolution is None:
        raise _wrong(path, "is a picture; give resolution, the edge of a pixel, or the YAML file of a map")
    low, high = DEFAULTS["free_thresh"], DEFAULTS["occupied_thresh"]
    rule = (
        f"is a picture alone: its lower left corner is (0, 0) of the frame map, pixels darker than {100 * high:g} % "
        f"are walls, and those from {100 * low:g} % on unknown"
    )
    return {"image": path.name, "resolution": resolution, "origin": [0.0, 0.0, 0.0]}, path, [rule]


def image_of(path: Path) -> Path | None:
    """Return the path of the picture that a map's YAML file names; None if the file cannot be read or names none."""
    try:
        return _image(path, _yaml(path))[0]
    except MapError:
        return None


def _meanings(shade: np.ndarray, known: Mapping[str, float], mode: str) -> np.ndarray:
    """Return FREE, OCCUPIED or UNKNOWN for shades from 0 to 1, by the thresholds `known` and the map's mode."""
    if mode == "raw":
        percent = np.rint(255.0 * shade)
        return np.select([percent > 100, percent >= HALF], [UNKNOWN, OCCUPIED], FREE).astype(np.uint8)
    occupied = shade if known["negate"] else 1.0 - shade
    low, high = known["free_thresh"], known["occupied_thresh"]
    between = np.where(occupied < 0.5 * (low + high), FREE, OCCUPIED) if mode == "scale" else UNKNOWN
    return np.select([occupied > high, occupied < low], [OCCUPIED, FREE], between).astype(np.uint8)


def _yaml(path: Path) -> dict[str, object]:
    content = content_of(path, LONGEST_YAML, MapError, path.name)
    try:
        data = parse(decode(content), "a map of ROS's map_server", dates=True)
    except LineError as fault:
        hint = "" if path.suffix.lower() in SUFFIXES else "; of pictures, PGM, PPM, PNG and BMP are read"
        raise _wrong(path, f"{fault}{hint}") from None
    if not isinstance(data, dict) or "image" not in data:
        raise _wrong(path, "is no map of ROS's map_server: it has no key image")
    return data


def _image(path: Path, data: Mapping[str, object]) -> tuple[Path, list[str]]:
    """Return the path of the map's picture, and a remark if it is another than the YAML file states.

    A path that leads out of the YAML file's folder, links followed, or to no file, is that of another computer: see
    `moved`. Raises MapError if there is no such picture in the folder.
    """
    name = data["image"]
    if not isinstance(name, str) or not name:
        raise _wrong(path, f"image: must be the name of a picture, got {_shown(name)}")
    stated = path.parent / name
    is_inside = inside(stated, path.parent)
    found = None if is_inside and os.path.isfile(stated) else moved(name, [path.parent])
    if found is not None and inside(found, path.parent):
        return found, [
            f"image: {_shown(name)} is not there; {found.relative_to(path.parent)} beside the YAML file is read"
        ]
    if not is_inside:
        raise _wrong(path, f"image: {_shown(name)} lies outside its folder; put the picture beside it")
    return stated, []


def read_picture(path: Path, image: Path) -> tuple[np.ndarray, int, np.ndarray | None]:
    """Return the levels of the pixels, (rows, columns), the level of white, and a mask of opaque pixels or None."""
    from PIL import Image, UnidentifiedImageError

    content = content_of(image, LARGEST_IMAGE, MapError, f"{path.name}: {image.name}")
    if content[:2] in PLAIN:  # Pillow takes quadratic time for comments and blanks
        if content.count(b"#") > MOST_COMMENTS:
            raise _wrong(path, f"{image.name}: has more than {MOST_COMMENTS} comments; remove them")
        content = re.sub(rb"\s+", b" ", re.sub(rb"#[^\r\n]*", b"", content))
    try:
        with warnings.catch_warnings():  # Pillow has a limit of its own: a warning, then an error
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            header = content[:LONGEST_HEADER]  # Pillow reads a PGM's header byte by byte
            Image.open(BytesIO(header), formats=FORMATS).close()
            picture = Image.open(BytesIO(content), formats=FORMATS)
        with picture:
            width, height = picture.size
            if width * height > MOST_PIXELS:
                raise _wrong(
                    path, f"{image.name}: has {width} x {height} pixels; the limit is {MOST_PIXELS:,}"
                )
            if picture.mode in ("1", "L"):
                return np.asarray(picture.convert("L")), 255, None
            if picture.mode.startswith("I"):
                return np.clip(np.asarray(picture), 0, 65535).astype(np.uint16), 65535, None
            return _brightness(picture)
    except MapError:
        raise
    except Image.DecompressionBombError as error:
        raise _wrong(path, f"{image.name}: {error}; the limit is {MOST_PIXELS:,}") from None
    except Exception as error:  # Pillow raises almost anything for a damaged file
        is_known = isinstance(error, OSError) and not isinstance(error, UnidentifiedImageError)
        reason = " ".join(str(error).split())[:LONGEST_VALUE] if is_known else "another format, or damaged"
        raise _wrong(path, f"{image.name}: is no readable PGM, PNG or BMP picture ({reason})") from None


def _brightness(picture: "Image") -> tuple[np.ndarray, int, np.ndarray]:
    """Return the sum of the colour channels per pixel, its value for white, and a mask of opaque pixels; by strips."""
    width, height = picture.size
    levels, opaque = np.empty((height, width), np.uint16), np.empty((height, width), bool)
    picture.load()
    for top in range(0, height, STRIP):
        rows = slice(top, min(top + STRIP, height))
        colours = np.asarray(picture.crop((0, top, width, rows.stop)).convert("RGBA"))
        levels[rows] = colours[..., :3].sum(axis=-1, dtype=np.uint16)
        opaque[rows] = colours[..., 3] == 255
    return levels, 3 * 255, opaque


def _number(path: Path, data: Mapping[str, object], key: str, least: float, most: float) -> float:
    value = data.get(key, DEFAULTS.get(key))
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        number = float("nan")
    if not least <= number <= most:
        got = "is missing" if value is None else f"got {_shown(value)}"
        raise _wrong(path, f"{key}: {got}; a number from {least:g} to {most:g}")
    return number


def _shown(value: object) -> str:
    return visible(repr(value), LONGEST_VALUE)


def _wrong(path: Path, what: str) -> MapError:
    return MapError(f"{path.name}: {what}")
