"""Gas classification on the robots: which gas is it, by an array of metal oxides, so that a search follows one gas.

The responses x_k = ln(R0_k/R_k) of the sensors k need no calibration: R0_k is the largest resistance that the robot has
met so far. A classifier gives the probability of each class for x, see `files/gas_classes.py`. The reading of the first
gas sensor, which algorithms get, is multiplied by

    1 if the most probable class is the one to follow, else 0     (by: class)
    the probability of this class                                 (by: probability)

and by 0 while |x| < faint, in clean air. A classification applies from the next reading on. Classes of gas guide a
mobile robot in Fan, Hernandez Bennetts, Schaffernicht & Lilienthal (2019), doi:10.3390/s19030685; the product is ours.
"""

from collections.abc import Mapping

import numpy as np

from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.swarm import Swarm
from taichi_plume.files.gas_classes import TrainedClassifier


class GasClassifier:
    """Classifier of the gas for the robots of a group. Writes the swarm's column `gas_share`."""

    STATE: tuple[str, ...] = ("cleanest",)

    def __init__(self, swarm: Swarm, group: GroupRange, classifier: TrainedClassifier):
        self.swarm, self.group, self.classifier = swarm, group, classifier
        sensors = group.model.sensors
        names = ["resistance", *(f"resistance_{k}" for k in range(1, len(sensors.noses)))]
        self.resistances = [getattr(swarm, name) for name in names]
        assert sensors.classifier is not None
        self.model = sensors.classifier
        self.followed = classifier.classes.index(self.model.follows)
        self.cleanest = np.zeros((group.size, len(names)))  # largest resistance so far [ohm]

    def classify(self) -> None:
        """Set the share of each robot's reading that algorithms get, from the present resistances."""
        part = self.group.slice
        resistance = np.stack([field.values[part] for field in self.resistances], axis=1).astype(float)
        self.cleanest = np.maximum(self.cleanest, resistance)
        responses = np.log(self.cleanest / resistance)
        probability = self.classifier.probabilities(responses)
        share = probability[:, self.followed]
        if self.model.by == "class":
            share = (probability.argmax(axis=1) == self.followed).astype(float)
        self.swarm.gas_share[part] = share * (np.linalg.norm(responses, axis=1) >= self.model.faint)


def classifiers(swarm: Swarm, trained: Mapping[int, TrainedClassifier]) -> tuple[GasClassifier, ...]:
    """Return the classifiers of the groups that have one; trained: by the groups' numbers."""
    return tuple(GasClassifier(swarm, swarm.groups[number], each) for number, each in trained.items())
