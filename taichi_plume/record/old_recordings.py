"""Conversion of old recordings: colours in the `recording.rrd` of earlier versions become numbers of pictures.zarr.

Bytes of a picture are decoded by the colour scale that the recording states. Wind arrows are not converted.
"""

import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import rerun as rr

from taichi_plume.files.film import BACKGROUND
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.files.tables import plain
from taichi_plume.guard.safe_open import unopenable
from taichi_plume.observed.planes import Plane, planes
from taichi_plume.observed.quantities import ABOVE, Quantity
from taichi_plume.observed.scales import Scale
from taichi_plume.observed.store import PictureStore
from taichi_plume.observed.views import View
from taichi_plume.record.drawing import TIME
from taichi_plume.scenario.scenario import Scenario

SCALE = ("quantity", "unit", "low", "high", "scale", "plane", "axes", "cell", "origin")
FORMAT, DATA = "GridMap:format", "GridMap:data"
FAULTS = (RuntimeError, ValueError, LookupError, TypeError, ArithmeticError, OSError, pa.ArrowException)
"""Errors of rerun and Arrow."""
ABOUT = "decoded from 256 colours; values outside colors_from and colors_to are cut off, obstacles hold the lowest"


class Decoded(NamedTuple):
    """Storage of decoded colours as float32. levels: values of the bytes 0 to 255; attributes: their precision."""

    levels: np.ndarray
    attributes: dict[str, float | str]

    def packed(self, values: np.ndarray) -> np.ndarray:
        """Return values as stored."""
        return values


def convert(path: Path, out: Path, scenario: Scenario, attributes: Mapping[str, object]) -> None:
    """Write the pictures in an old recording of a scenario's run as a pictures.zarr with these attributes.

    Raises RunFolderError if the recording cannot be read, and OSError.
    """
    views, samples = _views(path, scenario)
    observer: Any = SimpleNamespace(views=list(views.values()), samples=samples, shown_by=[])
    store, latest = PictureStore(observer, out, attributes), -np.inf
    store.start()
    waiting: dict[int, dict[str, np.ndarray]] = {}
    for entity, batch in _chunks(path, components=[DATA], is_static=False):
        if entity not in views or TIME not in batch.schema.names:
            continue
        view: Any = views[entity]
        shape = samples[view.name].shape
        times = batch.column(TIME).cast(pa.int64()).to_pylist()
        pixels = batch.column(DATA).flatten().flatten().to_numpy(zero_copy_only=False)
        if pixels.size != len(times) * shape[0] * shape[1]:
            raise RunFolderError(f"{path}: is damaged: pictures of {entity} have another size")
        for t, rows in zip(times, pixels.reshape(len(times), *shape[::-1]), strict=True):
            waiting.setdefault(t, {})[entity] = rows[::-1].T  # rows begin with the largest coordinate
        for t in sorted(t for t, pictures in waiting.items() if len(pictures) == len(views)):
            pictures = waiting.pop(t)
            if t > latest:
                instant: Any = SimpleNamespace(t=round(t * 1e-9, 9))
                store.show(
                    instant,
                    {
                        known.name: known.quantity.precision.levels[pictures[each]]
                        for each, known in views.items()
                    },
                )
                latest = t
    store.close()


def _views(path: Path, scenario: Scenario) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the view of each recorded entity, and the pixels of each view by the view's name."""
    static: dict[str, dict[str, Any]] = {}
    for entity, batch in _chunks(path, components=[*SCALE, FORMAT], is_static=True):
        here = [key for key in (*SCALE, FORMAT) if key in batch.schema.names]
        static.setdefault(entity, {}).update({key: batch.column(key)[0].as_py() for key in here})
    recorded = {entity: about for entity, about in sorted(static.items()) if FORMAT in about}
    if not recorded:
        raise RunFolderError(f"{path}: is no recording of a run of ours, or has been cut off at its begin")
    recorded = {entity: about for entity, about in recorded.items() if {"low", "high"} <= about.keys()}
    if not recorded:
        raise RunFolderError(
            f"{path}: was made by another version, which did not say what its pictures stand for; run it again"
        )
    known = {plane.name: plane for plane in planes(scenario, scenario.domain.extent)}
    views, samples = {}, {}
    try:
        for entity, about in recorded.items():
            view, pixels = _view(entity, about, known, scenario)
            views[entity], samples[view.name] = view, pixels
    except FAULTS as error:
        raise RunFolderError(f"{path}: is damaged: {plain(str(error))}") from None
    return views, samples


def _view(
    entity: str, about: dict[str, Any], known: Mapping[str, Plane], scenario: Scenario
) -> tuple[View, SimpleNamespace]:
    """Return the view of an entity from its values as stored by rerun, and the pixels of its pictures."""
    (low,), (high,), (kind,), (form,) = (about[key][:1] for key in ("low", "high", "scale", FORMAT))
    text = (about.get("plane") or [""])[0]  # rerun stores no empty text
    above, _, where = entity.strip("/").rpartition("/")
    plane = known.get(where)
    if plane is None or plane.text != text:
        plane = Plane(where, tuple(map("xyz".index, about["axes"][0])), None, None, text)
    name, unit, cell = about["quantity"][0], about["unit"][0], [float(x) for x in about["cell"]]
    attributes: dict[str, object] = {}
    if cell[0] > scenario.domain.spacing * (1 + 1e-6):
        attributes["cell_methods"] = "area: maximum"
    species = name.removesuffix(ABOVE)
    if unit == "ppm" and " + " not in species:
        attributes["species"] = species
        if name != species:
            attributes[BACKGROUND] = scenario.backgrounds[species]
    quantity: Any = Quantity(
        above.replace("/", "_"), name, unit, Scale(float(low), float(high), kind), "", lambda _: None, None,
        _decoded(float(low), float(high), kind == "log"), attributes=attributes,  # type: ignore[arg-type]
    )  # fmt: skip
    origin = tuple(float(x) for x in about.get("origin", (0.0, 0.0)))
    shape = (form["width"], form["height"])
    return View(quantity, plane, 1.0), SimpleNamespace(shape=shape, cell=(cell[0], cell[-1]), origin=origin)


def _decoded(low: float, high: float, log: bool) -> Decoded:
    """Return the values of the colours of a scale. Byte 0 of a logarithmic scale is at most `low`, and reads 0."""
    if not np.isfinite([low, high]).all() or high <= low or (log and low <= 0):
        raise ValueError(f"a scale from {low:g} to {high:g}")
    share = np.arange(256) / 255
    levels = low * (high / low) ** share if log else low + (high - low) * share
    levels[0] = 0.0 if log else low
    half = (high / low) ** (0.5 / 255) if log else 1.0  # ratio from a colour to where the next one begins
    precision = {
        "relative_precision": half - 1.0, "absolute_precision": low * half if log else (high - low) / 510,
        "largest_value": high, "comment": ABOUT,
    }  # fmt: skip
    return Decoded(levels.astype(np.float32), precision)


def _chunks(path: Path, **chosen: Any) -> Iterator[tuple[str, pa.RecordBatch]]:
    """Yield the entity path and Arrow table of each chunk of a recording that passes a filter, in the file's order."""
    reason = unopenable(path)
    if reason:
        raise RunFolderError(f"{path}: {reason}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # recordings of killed runs lack an index
            stream = rr.chunk.RrdReader(str(path)).stream()
        for chunk in stream.filter(**chosen):
            yield chunk.entity_path, chunk.to_record_batch()
    except RunFolderError:
        raise
    except FAULTS as error:
        reason = plain(" ".join(str(error).split())).replace(f"Failed to read RRD file at {path}: ", "")
        raise RunFolderError(f"{path}: is cut off or no recording: {reason}") from None
