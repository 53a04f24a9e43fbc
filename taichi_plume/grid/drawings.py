"""Floor plans from CAD drawings (DXF), read by ezdxf: lines, curves and hatches of chosen layers as wall pixels.

A drawing states its unit ($INSUNITS). Lines of any width become walls of one pixel, hatches are filled. The drawing's
own coordinates are those of the frame map.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_plume.grid.map_files import FREE, MOST_PIXELS, OCCUPIED, MapError, RosMap
from taichi_plume.guard.safe_open import content_of
from taichi_plume.guard.terminal import visible

if TYPE_CHECKING:
    from ezdxf.entities.dxfentity import DXFEntity

LARGEST = 1 << 27  # bytes
MOST_PARTS = 1_000_000  # lines and polygons
FARTHEST = 1e7  # m
FILLED = ("HATCH", "SOLID", "TRACE", "MPOLYGON")
NO_WALLS = (
    "TEXT",
    "MTEXT",
    "ATTRIB",
    "ATTDEF",
    "DIMENSION",
    "POINT",
    "LEADER",
    "MULTILEADER",
    "IMAGE",
    "VIEWPORT",
)
FINE = 0.25  # pixels: largest distance of a curve from its line segments


def read_drawing(path: Path, resolution: float | None, layers: Sequence[str], scale: float | None) -> RosMap:
    """Read the walls of a DXF file. Raises MapError.

    resolution: edge of the pixels [m]; layers: names of those with walls, by default all that are visible; scale:
    metres per unit, by default as the drawing states.
    """
    if resolution is None:
        raise MapError(
            f"{path.name}: is a drawing; give resolution, the edge of a pixel of its walls, such as 2 cm"
        )
    document = _document(path)
    size, unit = _scale(path, document, scale)
    names = [layer.dxf.name for layer in document.layers]
    missing = [name for name in layers if name.lower() not in map(str.lower, names)]
    if missing:
        held = visible(", ".join(sorted(names)), 200)
        raise MapError(f"{path.name}: has no layer '{visible(missing[0], 60)}'; it has {held}")
    hidden = {layer.dxf.name.lower() for layer in document.layers if layer.is_off() or layer.is_frozen()}
    chosen = {name.lower() for name in layers} or {name.lower() for name in names} - hidden
    left_out: Counter[str] = Counter()
    parts = list(_parts(document, chosen, FINE * resolution / size, left_out))
    if not parts:
        raise MapError(f"{path.name}: has no lines in its layers ({visible(', '.join(sorted(chosen)), 200)})")
    low, high = (size * pick([pick(part, axis=0) for part, _ in parts], axis=0) for pick in (np.min, np.max))
    if not (np.isfinite([low, high]).all() and max(np.abs([low, high]).max(), 1.0) < FARTHEST):
        raise MapError(
            f"{path.name}: its lines reach to {np.abs([low, high]).max():.3g} m; is its unit {unit}?"
        )
    shape = np.floor((high - low) / resolution + 0.5).astype(int) + 1
    if shape.prod(dtype=float) > MOST_PIXELS:
        raise MapError(
            f"{path.name}: resolution {resolution:g} m makes {shape[0]} x {shape[1]} pixels; raise it"
        )
    corner = low - 0.5 * resolution  # so that lines at its edge lie on middles of pixels
    solid = _drawn([(size * part - corner, fill) for part, fill in parts], tuple(shape), resolution)
    remarks = [
        f"{sum(left_out.values())} entities are no walls and left out: {', '.join(sorted(left_out))}"
    ] * bool(left_out)
    if hidden and not layers:
        remarks.append(
            f"layers that are off or frozen are left out: {visible(', '.join(sorted(hidden)), 100)}"
        )
    text = f"drawing {visible(path.name, 60)} in {unit}, {len(parts)} lines and polygons, pixels of {resolution:g} m"
    pixels = np.where(solid, OCCUPIED, FREE).astype(np.uint8)
    origin = (float(corner[0]), float(corner[1]))
    return RosMap(
        pixels, resolution, origin, 0.0, np.zeros(pixels.shape, bool), (0.0, 1.0), text, tuple(remarks)
    )


def _document(path: Path) -> Any:
    try:
        from ezdxf import recover
    except ImportError:
        raise MapError(f'{path.name}: drawings are read by ezdxf: pip install "taichi_plume[dxf]"') from None
    content = content_of(path, LARGEST, MapError, path.name)
    try:
        return recover.read(BytesIO(content))[0]
    except Exception as error:  # ezdxf raises many kinds of errors for damaged files
        reason = visible(" ".join(str(error).split()), 100)
        raise MapError(f"{path.name}: is no DXF file that can be read ({reason})") from None


def _scale(path: Path, document: Any, given: float | None) -> tuple[float, str]:
    """Return metres per unit of a drawing, and the name of the unit. Raises MapError if neither states it."""
    from ezdxf import units

    code: Any = int(document.header.get("$INSUNITS", 0))  # of ezdxf's InsertUnits
    metre: Any = units.M
    if given is not None:
        return given, f"units of {given:g} m"
    if code == 0:
        raise MapError(f"{path.name}: states no unit ($INSUNITS); give scale, metres per unit: 0.001 for mm")
    return float(units.conversion_factor(code, metre)), units.decode(code) or f"unit {code}"


def _parts(
    document: Any, chosen: set[str], fine: float, left_out: Counter[str]
) -> Iterator[tuple[np.ndarray, bool]]:
    """Yield (points (n, 2), whether the polygon is filled) of all entities in these layers, in the drawing's unit.

    fine: largest distance of curves from their segments; left_out: counts entities that are no walls.
    """
    from ezdxf import disassemble, path

    for n, entity in enumerate(disassemble.recursive_decompose(document.modelspace())):
        if n > MOST_PARTS:
            raise MapError(f"a drawing of more than {MOST_PARTS:,} entities")
        if entity.dxf.layer.lower() not in chosen:
            continue
        kind = entity.dxftype()
        if kind in NO_WALLS:
            left_out[kind] += 1
            continue
        outlines = _outlines(entity, path, disassemble)
        if not outlines:
            left_out[kind] += 1
        for outline in outlines:
            points = np.array([(vertex.x, vertex.y) for vertex in outline.flattening(max(fine, 1e-9))])
            if len(points) > 1:
                yield points, kind in FILLED


def _outlines(entity: "DXFEntity", path: Any, disassemble: Any) -> list[Any]:
    """Return the paths of an entity; an empty list if it has none."""
    try:
        if entity.dxftype() in ("HATCH", "MPOLYGON"):
            return list(path.from_hatch(entity))
        made = disassemble.make_primitive(entity)
        return [made.path] if made.path is not None and not made.is_empty else []
    except (TypeError, ValueError, ArithmeticError, AttributeError):
        return []


def _drawn(parts: Sequence[tuple[np.ndarray, bool]], shape: tuple[int, int], resolution: float) -> np.ndarray:
    """Return the mask (x, y) of pixels that lines cross and filled polygons cover; points [m] from the lower corner."""
    from PIL import Image, ImageDraw

    picture = Image.new("1", shape)
    draw = ImageDraw.Draw(picture)
    for points, fill in parts:
        corners = [tuple(np.floor(point).tolist()) for point in points / resolution]
        if fill and len(corners) > 2:
            draw.polygon(corners, fill=1, outline=1)
        else:
            draw.line(corners, fill=1, width=1)
    return np.asarray(picture).T.copy()
