"""Classifiers of the gas by the responses of an array of metal oxides, so that a search follows one gas of several."""

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from taichi_plume.scenario import si
from taichi_plume.scenario.metal_oxides import MoxSensor
from taichi_plume.scenario.vocabulary import AT_START, INPUT_FILE, FileName, Model

if TYPE_CHECKING:
    from taichi_plume.scenario.sensors import Sensors

MOST_CLASSES = 100
GasName = Annotated[str, Field(min_length=1, max_length=100)]


class AnyClassifier(Model):
    """Base class of the classifiers of gases. See agents/gas_classes.py."""

    follows: GasName
    """Class of gas that the robot follows. In any other gas its first gas sensor reads clean air."""
    by: Literal["class", "probability"] = "class"
    """Share of the reading that algorithms get: all or nothing, by the most probable class, or the probability."""
    faint: si.SomeCoefficient = 0.1
    """Norm of the responses ln(R0/R) below which the air is taken for clean; R0 is the largest resistance so far."""

    def sensor_error(self, sensors: "Sensors") -> str | None:
        """Return an error if the robot's gas sensors are no array of metal oxides; else None."""
        others = [sensor.kind for sensor in sensors.noses if not isinstance(sensor, MoxSensor)]
        if others or len(sensors.noses) < 2:
            found = f"'{others[0]}'" if others else "a single one"
            return f"needs two or more gas sensors in sensors.gas, all of kind mox; got {found}"
        return None


class NearestClassifier(AnyClassifier):
    """The k nearest neighbours of the responses, scaled to the length 1, in a table of responses to known gases."""

    kind: Literal["nearest"]
    file: Annotated[str, Field(min_length=1), INPUT_FILE] | None = None
    """Table of responses. A CSV file has the columns `gas` and one per gas sensor, in their order; a .npz file the
    arrays `gas` (rows) and `responses` (rows, sensors). Values are resistances or ratios R/R0, and the largest of a
    sensor counts as clean air. Unless given, it is made of the data sheets' curves for the gases in the scenario."""
    neighbours: Annotated[int, Field(ge=1, le=1000), AT_START] = 5
    """Number of nearest rows of the table; the probability of a class is its share of these rows."""


class OnnxClassifier(AnyClassifier):
    """A neural network or another trained classifier in an ONNX file."""

    kind: Literal["onnx"]
    file: FileName
    """ONNX file. Its input are the responses ln(R0/R) of the gas sensors (rows, sensors), its first output the
    probabilities of the classes (rows, classes), all 32-bit floats."""
    classes: Annotated[tuple[GasName, ...], Field(min_length=2, max_length=MOST_CLASSES), AT_START]
    """Names of the classes, in the order of the network's outputs."""


Classifier = Annotated[NearestClassifier | OnnxClassifier, Field(discriminator="kind")]
