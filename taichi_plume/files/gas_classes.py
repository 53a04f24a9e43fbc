"""Trained classifiers of gases: tables of responses for nearest neighbours, and ONNX files."""

from pathlib import Path
from typing import Protocol

import numpy as np

from taichi_plume.files.network import Network
from taichi_plume.files.numpy_files import read_arrays
from taichi_plume.files.own_class import OwnAlgorithmError
from taichi_plume.files.tables import Table, TextFile, cells_of, delimiter_of, listed
from taichi_plume.guard.input_error import InputError
from taichi_plume.scenario.gas_classes import AnyClassifier, NearestClassifier, OnnxClassifier
from taichi_plume.scenario.metal_oxides import MoxSensor
from taichi_plume.scenario.sensors import Sensors

LABEL, RESPONSES = "gas", "responses"  # names in tables
SWEPT = np.geomspace(1.0, 1000.0, 61)  # ppm, of the curves of data sheets


class ClassifierError(InputError):
    """Error of a classifier. key: key of the section that is wrong."""

    def __init__(self, key: str, what: str):
        super().__init__(what)
        self.key = key


class TableError(ClassifierError):
    """Error of a table of responses."""

    def __init__(self, what: str):
        super().__init__("file", what)


class TrainedClassifier(Protocol):
    """Classifier of gases, ready to use. classes: names of the gases."""

    classes: tuple[str, ...]

    def probabilities(self, responses: np.ndarray) -> np.ndarray:
        """Return the probability of each class, (rows, classes), for responses ln(R0/R) (rows, sensors)."""
        ...


class NearestGases:
    """k nearest neighbours (Cover & Hart 1967, doi:10.1109/TIT.1967.1053964) among unit vectors of responses.

    Vectors of length 1 hardly depend on the concentration (Gutierrez-Osuna & Nagle 1999, doi:10.1109/3477.790446).
    labels: gas of each row; responses: ln(R0/R), (rows, sensors), none zero; neighbours: their number k.
    """

    def __init__(self, labels: np.ndarray, responses: np.ndarray, neighbours: int):
        from scipy.spatial import cKDTree

        names, self.label = np.unique(labels, return_inverse=True)
        self.classes = tuple(map(str, names))
        self.neighbours = min(neighbours, len(labels))
        self.tree = cKDTree(directions(responses))

    def probabilities(self, responses: np.ndarray) -> np.ndarray:
        _, nearest = self.tree.query(directions(responses), self.neighbours)
        votes = self.label[np.reshape(nearest, (len(responses), self.neighbours))]
        return np.stack([(votes == k).mean(axis=1) for k in range(len(self.classes))], axis=1)


class NetworkGases:
    """Classifier in an ONNX file."""

    def __init__(self, network: Network, classes: tuple[str, ...]):
        self.network, self.classes = network, classes

    def probabilities(self, responses: np.ndarray) -> np.ndarray:
        return self.network.act(responses.astype(np.float32), len(self.classes))


def directions(responses: np.ndarray) -> np.ndarray:
    """Return vectors (rows, sensors) scaled to the length 1; zero vectors stay."""
    return responses / np.maximum(np.linalg.norm(responses, axis=1, keepdims=True), 1e-12)


def trained(model: AnyClassifier, sensors: Sensors, gases: list[str], folder: Path) -> TrainedClassifier:
    """Return the classifier of a section; gases: names of those in the scenario. Raises ClassifierError."""
    if fault := model.sensor_error(sensors):
        raise ClassifierError("kind", fault)
    count = len(sensors.noses)
    if isinstance(model, OnnxClassifier):
        found: TrainedClassifier = _network(model, folder / model.file, count)
    else:
        assert isinstance(model, NearestClassifier)
        labels, responses = (
            _curves(sensors, gases) if model.file is None else _table(folder / model.file, count)
        )
        strong = np.linalg.norm(responses, axis=1) >= model.faint
        if len(kinds := np.unique(labels[strong])) < 2:
            names = listed([*map(str, kinds)]) or "none"
            what = f"needs responses of at least {model.faint:g} to two gases or more, got only {names}"
            raise ClassifierError("file", what if model.file else f"{what}; give a table, or add a gas")
        found = NearestGases(labels[strong], responses[strong], model.neighbours)
    if model.follows not in found.classes:
        raise ClassifierError("follows", f"'{model.follows}' is none of the classes {listed(found.classes)}")
    return found


def _network(model: OnnxClassifier, path: Path, count: int) -> NetworkGases:
    """Read a classifier in an ONNX file for `count` gas sensors. Raises ClassifierError if its shape does not fit."""
    try:
        network = Network.read(path)
    except OwnAlgorithmError as error:
        raise ClassifierError("file", str(error)) from None
    for what, found, required, of in (
        ("inputs", network.entries, count, "the robot has that many gas sensors"),
        ("outputs", network.numbers, len(model.classes), "that many classes are listed"),
    ):
        if found not in (None, required):
            raise ClassifierError("file", f"{path}: has {found} {what}; wanted {required}, as {of}")
    return NetworkGases(network, model.classes)


def _curves(sensors: Sensors, gases: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Return labels (rows,) and responses (rows, sensors) by the curves of data sheets for each of the gases."""
    parts = []
    for gas in gases:
        curves = [sensor.curve(gas) for sensor in sensors.noses if isinstance(sensor, MoxSensor)]
        parts.append([np.zeros_like(SWEPT) if not at else at[1] * np.log1p(SWEPT / at[0]) for at in curves])
    return np.repeat(gases, len(SWEPT)), np.concatenate([np.transpose(part) for part in parts])


def _table(path: Path, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return labels (rows,) and responses ln(R0/R) (rows, sensors) of a file. Raises ClassifierError."""
    fault = TableError
    if path.suffix.lower() == ".npz":
        arrays = read_arrays(path, fault)
        if missing := {LABEL, RESPONSES} - arrays.keys():
            raise fault(
                f"{path}: lacks the array '{min(missing)}'; it holds {listed(list(arrays)) or 'nothing'}"
            )
        labels, values = arrays[LABEL], arrays[RESPONSES]
    else:
        labels, values = _csv(path)
    if (
        values.ndim != 2
        or values.dtype.kind not in "iuf"
        or labels.shape != values.shape[:1]
        or not values.size
    ):
        shapes = f"{labels.shape} and {values.shape}"
        raise fault(
            f"{path}: has {LABEL} and {RESPONSES} of the shapes {shapes}; wanted (rows,), (rows, sensors)"
        )
    if values.shape[1] != count:
        raise fault(f"{path}: has responses of {values.shape[1]} sensors; wanted {count}, as the robot has")
    bad = np.argwhere(~(np.isfinite(values) & (values > 0.0)))
    if len(bad):
        row, column = bad[0].tolist()
        raise fault(
            f"{path}: response [{row}, {column}] is {values[row, column]:g}; allowed are finite ones above 0"
        )
    return labels.astype(str), np.log(values.max(axis=0)) - np.log(values)


def _csv(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return the column `gas` of a CSV file, and the others as numbers. Raises ClassifierError."""
    text = TextFile(path, TableError)
    first, *rows = text.rows(0)
    delimiter = delimiter_of(text.lines[first])
    names = cells_of(text.lines[first], delimiter)
    if LABEL not in names or len(names) < 2:
        raise TableError(f"{path}: has no column '{LABEL}' and one per gas sensor; it has {listed(names)}")
    table = Table(text, rows, len(names), delimiter)
    others = [n for n, name in enumerate(names) if name != LABEL]
    return table.texts(names.index(LABEL)).astype(str), table.numbers(*others)
