"""Colour scales: linear or logarithmic encoding of values as bytes, and the ticks of their legends."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil, floor, log, log10
from typing import Any, Literal

import numpy as np

SLICES = 4  # layers of a map that pictures show


def logarithmic(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """Return the position of `values` on a logarithmic scale from `low` (0) to `high` (1); NaN stays NaN."""
    place = (np.log10(np.maximum(values, low * 1e-6)) - log10(low)) / (log10(high) - log10(low))
    return np.clip(place, 0.0, 1.0)


def decades(low: float, high: float) -> list[tuple[float, str]]:
    """Return position (0 to 1) and label of each power of ten on a log scale; on short scales also 3 times each."""
    powers = range(floor(log10(low)), floor(log10(high) + 1e-9) + 1)
    factors = (1, 3) if log10(high / low) < 4 - 1e-9 else (1,)
    marks = [
        (factor * 10.0**n, f"{factor * 10.0**n:g}" if -4 < n < 4 else f"{factor}e{n}")
        for n in powers
        for factor in factors
    ]
    return [
        (float(logarithmic(np.array(value), low, high)), text)
        for value, text in marks
        if low * (1 - 1e-9) <= value <= high * (1 + 1e-9)
    ]


def rounded_up(value: float, steps: Sequence[float] = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)) -> float:
    """Return the smallest of these numbers, times a power of ten, that is at least a positive value."""
    power = 10.0 ** ceil(log10(value) - 1 - 1e-9)
    return next(n * power for n in (*steps, 10.0) if n * power >= value * (1 - 1e-9))


@dataclass(frozen=True)
class Scale:
    """Scale of values as bytes v: low (high/low)^(v/255), v = 0 for at most low; or low + (high - low) v/255."""

    low: float
    high: float
    kind: Literal["log", "linear"]

    @classmethod
    def of(cls, attributes: Mapping[str, Any]) -> "Scale":
        """Return the colour scale that the attributes of a picture state."""
        return cls(attributes["colors_from"], attributes["colors_to"], attributes["colors"])

    def bytes(self, values: np.ndarray) -> np.ndarray:
        """Encode values as bytes (u8) on a linear or logarithmic scale; NaN becomes 0."""
        known = np.fmax(values, np.float32(self.low))
        if self.kind == "log":
            places = np.log(known) - np.float32(log(self.low))
            places *= np.float32(255 / log(self.high / self.low))
        else:
            places = (known - np.float32(self.low)) * np.float32(255 / (self.high - self.low))
        return np.minimum(places + np.float32(0.5), 255).astype(np.uint8)

    def marks(self) -> list[tuple[float, str]]:
        """Return position (0 to 1) and label of each tick of a colour legend."""
        if self.kind == "log":
            return decades(self.low, self.high)
        step = rounded_up((self.high - self.low) / 7, (1.0, 2.0, 5.0))
        values = np.arange(ceil(self.low / step - 1e-9), floor(self.high / step + 1e-9) + 1) * step
        return [((value - self.low) / (self.high - self.low), f"{value:.6g}") for value in values.tolist()]


def slices(count: int, most: int = SLICES) -> list[int]:
    """Return the indices of at most `most` of `count` layers, the lowest and the highest among them, for pictures."""
    return sorted({round(k) for k in np.linspace(0, count - 1, min(count, most))})
