"""Conversion of nested data to JSON types."""

from math import isfinite

import numpy as np


def json_value(value: object) -> object:
    """Return a value converted to JSON types (dict, list, number, text); NaN and infinities become None."""
    if isinstance(value, dict):
        return {str(key): json_value(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [json_value(part) for part in value]
    if isinstance(value, np.ndarray | np.generic):
        return json_value(value.tolist())
    if isinstance(value, float) and not isfinite(value):
        return None
    return value
