"""Topics of the live service, and construction of the outgoing ROS messages.

    - clock              rosgraph_msgs/Clock           simulated time
    - tf                 tf2_msgs/TFMessage            true poses of the robots of the first trial, by way of the
                                                       believed ones; frames: ros_robots.py
    - tf_static          tf2_msgs/TFMessage            positions of the sensors on the robots of the first trial
    - map                nav_msgs/OccupancyGrid        obstacles and walls
    - plume/QUANTITY     sensor_msgs/PointCloud2       a quantity at the height of the gas sensors, see `Scene`
    - GROUP/readings     taichi_plume_msgs/Readings    all readings of the robots of an external group
    - GROUP/commands     taichi_plume_msgs/Commands    incoming: commands to these robots
    - ROBOT/cmd_vel      geometry_msgs/Twist           incoming: velocity of one robot, if the group takes velocities
    - ROBOT/pose         geometry_msgs/PoseStamped     incoming: pose of one robot, if the group takes poses
    - ROBOT/odom         nav_msgs/Odometry             believed pose of one robot, velocity, covariances
    - ROBOT/gas          olfaction_msgs/GasSensor      ppm, or ppm m of lasers
    - ROBOT/gas_raw      olfaction_msgs/GasSensor      ohm, of metal oxides
    - ROBOT/wind         olfaction_msgs/Anemometer     in the frame of the robot

ROBOT is GROUP_n, with n from 0 on over all trials. Groups of more than MOST_ROBOTS have no topics of single robots. For
robots with several gas sensors, gas and gas_raw are of the first sensor, gas_1 and gas_raw_1 of the next.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from math import cos, sin
from typing import NamedTuple

import numpy as np

from taichi_plume.files import point_clouds
from taichi_plume.files import ros_messages as ros
from taichi_plume.files.ros_odometry import ODOMETRY, DeadReckoning
from taichi_plume.files.ros_robots import (
    BASE,
    GAS,
    ODOM,
    TRANSFORMS,
    MapFrame,
    carried,
    numbered,
    transform,
    wind_fields,
)
from taichi_plume.observed.observer import Observer
from taichi_plume.observed.planes import Plane
from taichi_plume.observed.quantities import quantities
from taichi_plume.observed.views import Variable, View, layout
from taichi_plume.time_loop import TimeLoop

MOST_ROBOTS = 64


class Message(NamedTuple):
    """Outgoing message of a topic. name: ROS type; make: returns the content, called only if there are subscribers."""

    topic: str
    name: str
    make: Callable[[], object]

    def data(self) -> bytes:
        """Return the message encoded as bytes (CDR)."""
        return ros.encode(self.make())


def clock(t: float) -> Message:
    """Return the message of simulated time t [s]; the warm-up, with t < 0, is sent as 0."""
    return _message("clock", "rosgraph_msgs/msg/Clock", dict, clock=ros.time(max(0.0, t)))


def readings(group: str, t: float, tick: int, values: dict[str, np.ndarray], **more: np.ndarray) -> Message:
    """Return the message with all readings of a group's robots at t [s]; values: of `ExternalAlgorithm.sample`."""
    place, wind = values["believed_position"], values["wind"]
    count = len(place)
    return _message(
        f"{group}/readings",
        ros.READINGS,
        dict,
        t=t,
        tick=tick,
        robot=np.arange(count),
        x=place[:, 0],
        y=place[:, 1],
        z=values["altitude"],
        heading=values["believed_heading"],
        noses=values["reading"].shape[1],
        gas=values["reading"],
        resistance=values["resistance"],
        wind_x=wind[:, 0],
        wind_y=wind[:, 1],
        wind_known=values["wind_known"],
        blocked=values["blocked"],
        over=values["over"],
        **more,
    )


def ended(group: str, t: float, tick: int) -> Message:
    """Return the message, at time t [s], that the run of a group has ended."""
    return _message(f"{group}/readings", ros.READINGS, dict, t=t, tick=tick, ended=1)


def of_each(
    group: str,
    t: float,
    values: dict[str, np.ndarray],
    sensors: Sequence[Mapping[str, object]],
    reckoning: DeadReckoning,
    frame: MapFrame,
) -> Iterator[Message]:
    """Yield ROS messages with the readings of each single robot; sensors: fields of each gas sensor's messages.

    reckoning: odometry of the group's robots at t [s]; frame: of positions.
    """
    has_resistance = np.isfinite(values["resistance"])
    ohm = {"raw_units": ros.UNITS["ohm"]}
    for n in range(len(has_resistance)):
        robot = f"{group}_{n}"
        yield _message(f"{robot}/{ODOM}", ODOMETRY, reckoning.fields, n, robot, frame)
        for k, sensor in enumerate(sensors):
            gas = {"header": ros.header(t, f"{robot}/{numbered(GAS, k)}"), **sensor}
            topic = f"{robot}/{numbered('gas', k)}"
            yield _message(topic, ros.GAS_SENSOR, _gas, gas, values["reading"], n, k)
            if has_resistance[n, k]:
                topic = f"{robot}/{numbered('gas_raw', k)}"
                yield _message(topic, ros.GAS_SENSOR, _gas, gas | ohm, values["resistance"], n, k)
        yield _message(f"{robot}/wind", ros.ANEMOMETER, _wind, robot, t, values, n)


def _gas(about: dict[str, object], values: np.ndarray, n: int, k: int) -> dict[str, object]:
    return about | {"raw": float(values[n, k])}


def _wind(robot: str, t: float, values: dict[str, np.ndarray], n: int) -> dict[str, object]:
    u, v = values["wind"][n].tolist()
    return wind_fields(robot, u, v, float(values["believed_heading"][n]), t)


def poses(t: float, names: list[str], now: Mapping[str, np.ndarray], frame: MapFrame) -> Message:
    """Return the message with the robots' transforms; now: columns of `Swarm.snapshot`, (n,) or (n, 2)."""
    return _message("tf", TRANSFORMS, _transforms, t, names, now, frame)


def _transforms(
    t: float, names: list[str], now: Mapping[str, np.ndarray], frame: MapFrame
) -> dict[str, object]:
    """Return the transforms from the map to ROBOT/odom, the error of the odometry, and on to the believed pose."""
    transforms = []
    for n, name in enumerate(names):
        x, y = now["position"][n].tolist()
        true = frame.point(x, y)
        z = float(now["altitude"][n]) if "altitude" in now else 0.0
        x, y = now["believed_position"][n].tolist()
        believed = frame.point(x, y, z)
        heading = float(now["believed_heading"][n])
        off = float(now["heading"][n]) - heading
        shift = {
            "x": true["x"] - cos(off) * believed["x"] + sin(off) * believed["y"],
            "y": true["y"] - sin(off) * believed["x"] - cos(off) * believed["y"],
            "z": 0.0,
        }
        odom = f"{name}/{ODOM}"
        transforms += [
            transform(frame.name, odom, shift, ros.yawed(off), t),
            transform(odom, f"{name}/{BASE}", believed, ros.yawed(heading), t),
        ]
    return {"transforms": transforms}


def _message(
    topic: str, name: str, make: Callable[..., dict[str, object]], /, *args: object, **fields: object
) -> Message:
    """Return a message of ROS type `name` whose fields `make` computes only when the message is sent."""
    return Message(topic, name, lambda: ros.message(name, **make(*args, **fields)))


class Scene:
    """Scene of a simulation as messages: floor, sensors, and a point cloud of each quantity in the sensors' plane.

    Topics of clouds are named by species, such as plume/ethanol, or by quantity: plume/temperature, and plume/gas for
    the sum of several species. Points have x, y, z and a value, named by its unit: ppm or K.
    """

    def __init__(self, sim: TimeLoop):
        self.sim, self.frame = sim, MapFrame.of(sim.scenario, sim.obstacles)
        heights = [group.model.sensors.nose.height for group in sim.swarm.groups]
        self.height = min(heights, default=0.0) if sim.grid.dim == 3 else 0.0
        normal = (2, self.height) if sim.grid.dim == 3 else (None, None)
        plane = Plane("sensors", (0, 1), *normal, "at the height of the gas sensors")
        self.observer = Observer(sim, [View(each, plane, 1.0) for each in quantities(sim)])
        self.variables, self.places = layout(self.observer.views, self.observer.samples)
        self.floor = self._floor()

    def _floor(self) -> np.ndarray:
        """Return the occupancy [%] of the floor's cells with a border of one cell, (ny, nx)."""
        grid = self.sim.grid
        nx, ny = (n + 2 for n in grid.shape[:2])
        x, y = ((np.arange(n) - 0.5) * grid.dx for n in (nx, ny))
        places = np.stack(np.meshgrid(x, y, indexing="xy"), axis=-1)
        away = self.sim.swarm.clearance.distance_at(places.reshape(-1, 2)).reshape(ny, nx)
        return np.where(away > 0, 0, 100)

    def messages(self) -> list[Message]:
        """Return the messages with sensors, floor and quantities at the present time."""
        t, dx = self.sim.t, self.sim.grid.dx
        floor = partial(self.frame.grid, self.floor, dx, -dx, t)
        return [
            Message("tf_static", TRANSFORMS, self._sensors),
            Message("map", ros.GRID, floor),
            *(
                Message(point_clouds.topic(each.view.quantity.label), ros.POINTS, partial(self._cloud, each))
                for each in self.variables
            ),
        ]

    def _sensors(self) -> object:
        """Return the ROS message with the transforms of the sensors on the robots of the first trial."""
        flat, groups = self.sim.grid.dim == 2, self.sim.swarm.groups
        robots = [(f"{ros.word(g.name)}_{n}", g.model) for g in groups for n in range(g.count)]
        places = [each for name, model in robots for each in carried(name, model.sensors, flat)]
        return ros.message(TRANSFORMS, transforms=places)

    def _cloud(self, of: Variable) -> object:
        """Return the ROS message with the present values of a quantity as points."""
        values = of.values(self.observer.observe(self.sim, [of.view]))
        places = [self.places[dim][0] for dim in of.dims]
        columns = point_clouds.columns(values, places, of.view.quantity.unit, self.height)
        return self.frame.cloud(columns, self.sim.t)
