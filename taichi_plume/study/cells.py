"""The cells of the tables of a study's page."""

from typing import Any

import numpy as np

from taichi_plume.study import intervals
from taichi_plume.study.points import Quantity

NO_BREAK = "\u2011"  # a hyphen at which no line ends


def said(one: Quantity, each: intervals.Estimate) -> str:
    """The sentence of an estimate."""
    return intervals.words(each, one.unit, one.share, one.what)


def cell(one: Quantity, each: intervals.Estimate | None) -> str:
    """An estimate in a cell: mean, and its interval in brackets."""
    if each is None or not each.n:
        return "-"
    text = intervals.number(each.mean, "", one.share)
    if not np.isfinite(each.low):
        return text
    ends = intervals.ends(each, "", one.share).removesuffix(" %")
    return f"{text} ({ends if ' to ' in ends else ends.replace('-', NO_BREAK)})"


def head(one: Quantity) -> str:
    """What a column tells, with its unit."""
    return one.title + (f" [{one.unit}]" if one.unit not in ("", "1") else "")


def apart_words(apart: intervals.Estimate) -> tuple[str, str]:
    """A difference of shares and its interval, each in a cell."""
    points = f"{100 * apart.mean:+.0f}"
    if apart.over in intervals.WITHOUT:
        return points, intervals.WITHOUT[apart.over].format(airs=apart.airs)
    over = intervals.OVER[apart.over].format(airs=apart.airs)
    return points, f"{100 * apart.low:+.0f} to {100 * apart.high:+.0f} {over}"


def ends(low: float, high: float) -> str:
    """The ends of an interval of plain numbers."""
    return f"{low:.2f} to {high:.2f}" if np.isfinite(low) and np.isfinite(high) else "none"


def plain(value: Any) -> str:
    """A value of an axis."""
    if isinstance(value, bool | np.bool_ | str) or value is None:
        return str(value)
    return f"{value:.4g}" if isinstance(value, int | float | np.number) else str(value)


def keys(axis: Any) -> str:
    """The keys that an axis of the file sets."""
    if not isinstance(axis, dict):
        return "-"
    if axis.get("key"):
        return str(axis["key"])
    variants = axis.get("variants") or {}
    return (
        ", ".join(dict.fromkeys(key for one in variants.values() if isinstance(one, dict) for key in one))
        or "-"
    )
