"""A class from a Python file of the user's."""

import importlib.util
import sys
import traceback
from pathlib import Path
from typing import Any, Protocol, runtime_checkable


@runtime_checkable
class Acts(Protocol):
    """What a class of the user's has to have."""

    def act(self, robots: Any) -> None:
        """Turn readings into commands."""
        ...


class OwnAlgorithmError(RuntimeError):
    """The user's algorithm failed; says in which file and line."""


def own_class(path: Path, name: str | None) -> type:
    """The class `name` of a Python file; unless given, the only one there with an `act`. Raises OwnAlgorithmError."""
    if not path.is_file():
        raise OwnAlgorithmError(f"{path}: does not exist")
    spec = importlib.util.spec_from_file_location(f"own_algorithm_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise OwnAlgorithmError(f"{path}: is no Python file; its name must end in .py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # where `inspect` and `dataclass` look for it
    try:
        spec.loader.exec_module(module)
    except SyntaxError as error:
        raise OwnAlgorithmError(f"{path}, line {error.lineno}: {error.msg}") from error
    except Exception as error:
        raise OwnAlgorithmError(told(error, path)) from error
    own = {
        key: value
        for key, value in vars(module).items()
        if isinstance(value, type) and value.__module__ == module.__name__ and issubclass(value, Acts)
    }
    if name is not None and name in own:
        return own[name]
    if name is None and len(own) == 1:
        return next(iter(own.values()))
    there = ", ".join(own) or "none"
    wanted = f"no class '{name}'" if name else "not exactly one class"
    raise OwnAlgorithmError(f"{path}: holds {wanted} with a method act; there are: {there}")


def told(error: Exception, path: Path) -> str:
    """The error in one line, with the place in the user's file where it came up."""
    lines = [
        f.lineno for f in traceback.extract_tb(error.__traceback__) if Path(f.filename).name == path.name
    ]
    where = f"{path}, line {lines[-1]}" if lines else f"{path}"
    return f"{where}: {type(error).__name__}: {' '.join(str(error).split())}"
