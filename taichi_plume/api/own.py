"""Search algorithms and laws of gas and wind of one's own, given as a Python class or function."""

from inspect import isfunction
from typing import Any

from taichi_plume.files.own_class import Code, register
from taichi_plume.scenario.changes import shown
from taichi_plume.scenario.loading import ScenarioError


def Own(algorithm: Code, **parameters: Any) -> dict[str, object]:
    """Return the section `algorithm` of a group of robots that a class of yours drives, or the section `gas` or `wind`
    of a law of yours, a function.

    algorithm: class with the method ``act(robots)``, see `Robots`, or function ``law(points, t)`` of points (n, 2 or
    3) [m] and time [s] that returns concentrations (n,) [ppm] or velocities (n, 2 or 3) [m/s]; parameters: keyword
    arguments of the constructor or the function, as YAML can hold them. Another class of the same name gets a number
    after its name. In a file the section needs the key `file`, so that a run can be repeated from its scenario.yaml.
    Studies and contests send the class to their workers. Raises ScenarioError if there is no method `act`.

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
    is_law = isfunction(algorithm)
    if not is_law and not (isinstance(algorithm, type) and callable(getattr(algorithm, "act", None))):
        what = "give a class with the method act, or a function that is a law of gas or wind"
        raise ScenarioError([f"algorithm: got {shown(algorithm)}; {what}"])
    return {"kind": "own", "name": register(algorithm), "parameters": parameters}
