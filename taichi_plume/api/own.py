"""Search algorithms of one's own, given as a Python class."""

from typing import Any

from taichi_plume.files.own_class import register
from taichi_plume.scenario.changes import shown
from taichi_plume.scenario.loading import ScenarioError


def Own(algorithm: type, **parameters: Any) -> dict[str, object]:
    """Return the section `algorithm` of a group of robots that a class of yours drives.

    algorithm: class with the method ``act(robots)``, see `Robots`; parameters: keyword arguments of its constructor, as
    YAML can hold them. Another class of the same name gets a number after its name. In a file the section needs the key
    `file`, so that a run can be repeated from its scenario.yaml. Studies and contests send the class to their workers.
    Raises ScenarioError if there is no method `act`.

    >>> import taichi_plume as tp
    >>> class Wait:
    ...     def act(self, robots):
    ...         robots.speed[:] = 0.0
    >>> sim = tp.Simulation("plumesim_casting", overrides={"robots.0.algorithm": tp.Own(Wait)})
    >>> start = sim.robots.x
    >>> sim.run(until=1)
    >>> bool((sim.robots.x == start).all())
    True
    """
    if not isinstance(algorithm, type) or not callable(getattr(algorithm, "act", None)):
        raise ScenarioError([f"algorithm: got {shown(algorithm)}; give a class with the method act"])
    return {"kind": "own", "name": register(algorithm), "parameters": parameters}
