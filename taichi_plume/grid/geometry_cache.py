"""Cache of results that follow from a geometry alone, so that further simulations in the same room start quickly."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import wraps
from hashlib import blake2b
from typing import Any, TypeVar

import numpy as np

MOST = 2  # results per function

Function = TypeVar("Function", bound=Callable[..., Any])


def geometry_cached(function: Function) -> Function:
    """Decorator: return the last results for equal arguments. Callers must not change these.

    Arrays are equal by their content, shapes of obstacles if they are the same objects, all else by ==.
    """
    known: OrderedDict[Hashable, Any] = OrderedDict()

    @wraps(function)
    def cached(*arguments: Any, **named: Any) -> Any:
        key = _key(arguments), *((name, _key(value)) for name, value in sorted(named.items()))
        if key not in known:
            known[key] = function(*arguments, **named)
            if len(known) > MOST:
                known.popitem(last=False)
        known.move_to_end(key)
        return known[key]

    return cached  # type: ignore[return-value]


def _key(value: Any) -> Hashable:
    if isinstance(value, np.ndarray):
        content = np.ascontiguousarray(value)
        return content.shape, str(content.dtype), blake2b(content.data, digest_size=16).digest()
    if isinstance(value, list | tuple):
        return tuple(map(_key, value))
    return value
