"""Algorithm classes that Python code gives to a study (`taichi_plume.Own`), pickled for its worker processes.

Worker processes receive a class as bytes of cloudpickle: with the functions, classes and values that the class uses of
its own module, of `__main__` or of a notebook. Other modules are imported in the workers. A digest of the same contents
takes the place of the class's name in the ids of runs.
"""

import hashlib
import json
import pickle
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from io import BytesIO
from linecache import getlines
from types import CodeType, FunctionType
from typing import Any, NamedTuple, TypeVar

from taichi_plume.assembly.preparation import Prepared
from taichi_plume.files.own_class import CLASSES, NO_CLASS, Code, OwnAlgorithmError, file_of
from taichi_plume.scenario.checks import every
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scenario.own_code import OwnCode
from taichi_plume.scenario.scenario import Scenario

CLASS_ID = re.compile(r"[0-9a-f]{32}")  # random number that cloudpickle gives to a class
CODE = (
    "co_argcount", "co_posonlyargcount", "co_kwonlyargcount", "co_flags", "co_code", "co_exceptiontable", "co_names",
    "co_varnames", "co_freevars", "co_cellvars", "co_consts",
)  # fmt: skip
"""Attributes of compiled code that decide what the code does; others hold lines and the file's name."""
NOT_BEHAVIOUR = ("__firstlineno__", "__static_attributes__", "_cloudpickle_submodules")
"""Keys of pickled classes and functions that depend on lines, on random hashes or on imports elsewhere."""
PYTHON = sys.implementation.cache_tag  # compiled code is for one version of Python


class PickledClass(NamedTuple):
    """Class of a user's algorithm as bytes of cloudpickle. python: version of Python that the bytes are for."""

    name: str
    content: bytes
    python: str | None

    def load(self) -> Code:
        """Return the class, in a worker process. Raises OwnAlgorithmError."""
        if self.python != PYTHON:
            what = f"the worker runs {PYTHON}, the study was started by {self.python}; use the same Python for both"
            raise OwnAlgorithmError(f"{self.name}: {what}")
        try:
            return pickle.loads(self.content)
        except Exception as error:
            what = f"{type(error).__name__}: {error}"
            hint = "modules besides that of the class have to be installed, or on the PYTHONPATH"
            raise OwnAlgorithmError(f"{self.name}: cannot be loaded in a worker: {what}; {hint}") from None


class GivenClass(NamedTuple):
    """Class of a user's algorithm for a study. digest: SHA-256 of what the class does; used: names of all attributes
    and globals that its code uses; text: of the file or the notebook's cell that defines the class, "" if unknown.
    """

    pickled: PickledClass
    digest: str
    used: frozenset[str]
    text: str

    @classmethod
    def of(cls, algorithm: Code) -> "GivenClass":
        """Pickle a class. Raises OwnAlgorithmError if this is impossible."""
        name, walk = algorithm.__name__, _Walk()
        try:
            with _by_value(algorithm.__module__):
                pickled = PickledClass(name, _pickled(algorithm), PYTHON)
                digest = walk.digest(algorithm)
        except Exception as error:  # objects that the class uses may raise anything
            what = " ".join(f"{type(error).__name__}: {error}".split())
            raise OwnAlgorithmError(f"the class {name} cannot be sent to other processes: {what}") from None
        return cls(pickled, digest, frozenset(walk.used), "".join(getlines(str(file_of(algorithm)))))


class GivenClasses:
    """Classes that the scenarios of a study name without a file, by the names of `CLASSES`. Each is pickled once."""

    def __init__(self) -> None:
        self.found: dict[str, GivenClass] = {}
        self._faults: dict[str, str] = {}

    def errors(self, scenario: Scenario) -> list[str]:
        """Pickle the classes that drive robots of a scenario; return a line for each that is missing or fails."""
        return [f"{path}: {fault}" for path, name in given(scenario) if (fault := self._fault(name))]

    def _fault(self, name: str) -> str:
        if name not in self.found and name not in self._faults:
            try:
                self.found[name] = GivenClass.of(CLASSES[name])
            except KeyError:
                self._faults[name] = NO_CLASS
            except OwnAlgorithmError as error:
                self._faults[name] = str(error)
        return self._faults.get(name, "")

    def digests(self, scenario: Scenario) -> dict[str, str]:
        """Return the digests of the classes of a scenario without errors, by the paths of the keys that name them."""
        return {f"{path}.name": self.found[name].digest for path, name in given(scenario)}

    def pickled(self) -> dict[str, PickledClass]:
        """Return the classes for the workers, by the names in the scenarios."""
        return {name: found.pickled for name, found in self.found.items()}

    def text(self) -> str:
        """Return the source text of all pickled classes as far as it is known, with their names and digests."""
        parts = []
        for name, found in self.found.items():
            parts.append(f"# {name}: class {found.pickled.name}, SHA-256 of what it does: {found.digest}\n")
            parts.append(found.text or "# its source text is not known\n")
        return "\n".join(parts)


def given(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield path and name of each algorithm or law of a scenario that Python code gave, without a file."""
    for path, section in every(scenario):
        if isinstance(section, OwnCode) and not section.file:
            yield path, section.name or ""


def load_given(prepared: Prepared, classes: Mapping[str, PickledClass]) -> None:
    """Load the classes that Python code gave to a study into the resources of a scenario. Raises ScenarioError."""
    for path, name in given(prepared.scenario):
        try:
            prepared.resources.own[path] = classes[name].load()
        except OwnAlgorithmError as error:
            raise ScenarioError([f"{path}: {error}"]) from None


def labels(sections: Sequence[object]) -> list[str]:
    """Return a label for each section `algorithm`: class and parameters if Python code gave it, else JSON.

    Of two classes of one name, the second is NAME_2, in the order of `sections`.
    """
    seen: dict[str, list[Code]] = {}
    made = []
    for section in sections:
        algorithm = CLASSES.get(str(section.get("name"))) if is_given(section) else None
        if algorithm is None:
            made.append(json.dumps(section))
            continue
        same = seen.setdefault(algorithm.__name__, [])
        if algorithm not in same:
            same.append(algorithm)
        number = f"_{same.index(algorithm) + 1}" if same.index(algorithm) else ""
        keys = ", ".join(f"{key}={value!r}" for key, value in (section.get("parameters") or {}).items())
        made.append(f"{algorithm.__name__}{number}" + f"({keys})" * bool(keys))
    return made


def is_given(section: Any) -> bool:
    """Return whether a section `algorithm` is that of a class that Python code gave, without a file."""
    return isinstance(section, dict) and section.get("kind") == "own" and not section.get("file")


@contextmanager
def _by_value(module: str) -> Iterator[None]:
    """Context in which functions and classes of a module are pickled with their code, not by their names."""
    import cloudpickle

    registered = cloudpickle.list_registry_pickle_by_value()
    ours = module in sys.modules and module != "__main__" and module not in registered
    by_name = ours and module.partition(".")[0] not in sys.stdlib_module_names  # `exec` names builtins
    if by_name:
        cloudpickle.register_pickle_by_value(sys.modules[module])
    try:
        yield
    finally:
        if by_name:
            cloudpickle.unregister_pickle_by_value(sys.modules[module])


def _pickled(algorithm: Code) -> bytes:
    """Return a class as bytes of cloudpickle, whose code keeps the names of files for messages about errors."""
    import cloudpickle

    class Pickler(cloudpickle.Pickler):
        def reducer_override(self, obj: Any) -> Any:
            if isinstance(obj, CodeType):
                arguments: Any = self.dispatch_table[CodeType](obj)[1]
                return _code, (obj.co_filename, *arguments)
            return super().reducer_override(obj)

    content = BytesIO()
    Pickler(content).dump(algorithm)
    return content.getvalue()


def _code(file: str, *arguments: Any) -> CodeType:
    return CodeType(*arguments).replace(co_filename=file)


class _Walk:
    """Hash of all that cloudpickle would write of a class, equal in each session of one version of Python.

    Bytes of cloudpickle differ between sessions by line numbers, random ids of classes and the order of sets. used:
    names that the visited code uses.
    """

    def __init__(self) -> None:
        import cloudpickle

        self.used: set[str] = set()
        self._pickler = cloudpickle.Pickler(BytesIO())
        self._visited: dict[int, tuple[int, object]] = {}  # number, and the object, whose id stays taken

    def digest(self, value: object) -> str:
        """Return the SHA-256 of a value, or a short text that is unique for the value."""
        if value is None or value is ... or type(value) in (bool, int, float, complex):
            return repr(value)
        kind = type(value).__name__
        if isinstance(value, str | bytes) and type(value) in (str, bytes):
            return _hash(kind, value.hex() if isinstance(value, bytes) else value)
        if type(value) in (set, frozenset):
            return _hash(kind, *sorted(map(self.digest, value)))  # pyright: ignore[reportArgumentType]
        if type(value) is tuple:
            return _hash(kind, *map(self.digest, value))
        if isinstance(value, CodeType):
            self.used.update(value.co_names)
            return _hash(kind, *(self.digest(getattr(value, name)) for name in CODE))
        if id(value) in self._visited:
            return f"object {self._visited[id(value)][0]}"
        self._visited[id(value)] = len(self._visited), value
        if type(value) is list:
            return _hash(kind, *map(self.digest, value))
        if type(value) is dict:
            items = [(key, part) for key, part in value.items() if key not in NOT_BEHAVIOUR]
            return _hash(kind, *(self.digest(part) for item in items for part in item))
        return _hash(kind, *map(self.digest, self._parts(value)))

    def _parts(self, value: Any) -> Iterable[object]:
        """Return the parts to which pickle would reduce an object, without what differs between sessions."""
        reduced = self._reduced(value)
        if isinstance(reduced, str):  # the name of a global
            return str(getattr(value, "__module__", "")), reduced
        function, arguments, *others = reduced  # state, items of lists and of dicts
        if isinstance(value, FunctionType):
            return value.__code__, others[0]
        if isinstance(value, type | TypeVar):
            arguments = tuple(part for part in arguments if not _is_class_id(part))
        return function, arguments, *(tuple(part) if isinstance(part, Iterator) else part for part in others)

    def _reduced(self, value: Any) -> Any:
        """Return what cloudpickle writes in place of an object: a name, or a tuple as `__reduce__` returns it."""
        reduced = self._pickler.reducer_override(value)
        if reduced is not NotImplemented:
            return reduced
        if isinstance(value, type | FunctionType):
            return value.__qualname__
        reduce = self._pickler.dispatch_table.get(type(value))
        return reduce(value) if reduce else value.__reduce_ex__(4)


def _is_class_id(part: object) -> bool:
    return isinstance(part, str) and CLASS_ID.fullmatch(part) is not None


def _hash(*parts: str) -> str:
    return hashlib.sha256(json.dumps(parts).encode("utf-8", "surrogatepass")).hexdigest()
