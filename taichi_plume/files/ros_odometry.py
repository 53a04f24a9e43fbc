"""Odometry messages of ROS: poses by dead reckoning with covariances, velocities with theirs.

The covariance follows the odometry model of the robots (`agents/odometry.py`), linearised along the believed path as in
the prediction step of an extended Kalman filter. In a time step a robot believes that it turns by w [rad] and moves
by (dx, dy) [m], a path s [m], on the course phi. The pose (x, y, heading) then has the Jacobians

    F = [1 0 -dy; 0 1 dx; 0 0 1]            by the pose before
    V = [-dy/2 cos phi; dx/2 sin phi; 1 0]  by the errors of w and s; V0 is the first column
    G = [(dx, dy, 0)  w V0  s V0]           by the constant errors a, b and c

so that the random errors have the covariance P <- F P F' + V diag(k1 |w| + k2 |s|, k3 |s| + k4 |w|) V', the constant
ones act by J <- F J + G, and the pose has the covariance P + J diag(var a, var b, var c) J'. On a straight path of
length L, the variance of the heading is k2 L + var c L², that across the path k2 L³/3 + var c L⁴/4. The linearisation
holds while the error of the heading is small against 1 rad. Poses of a camera have the variances of a frame, and their
differences over a step, the velocities, twice these over dt². Robots that know their poses, heights, roll and pitch
have the variance 0.
"""

import numpy as np

from taichi_plume.files import ros_messages as ros
from taichi_plume.files.ros_robots import BASE, ODOM, Fields, MapFrame
from taichi_plume.scenario.localization import Camera, Localization, Odometry

ODOMETRY = "nav_msgs/msg/Odometry"
PLANAR = np.ix_((0, 1, 5), (0, 1, 5))
"""Entries of ROS's 6x6 covariances that belong to x, y and the rotation about z."""


class DeadReckoning:
    """Motion of the robots of a group by their odometry: call `advance` at each time.

    model: localisation of the group, None if its robots know their poses. place (n, 3) [m], heading (n,) [rad]:
    believed poses. velocity (n, 3): forward, left, up [m/s] and turn_rate (n,) [rad/s] over the last time step.
    covariance (n, 3, 3): of x, y [m] and heading [rad]; of_velocity (n, 3, 3): of forward, left and turn rate.
    """

    def __init__(self, model: Localization | None, count: int):
        self.model, self.t = model, np.nan
        self.place, self.heading = np.zeros((count, 3)), np.zeros(count)
        self.velocity, self.turn_rate = np.zeros((count, 3)), np.zeros(count)
        self.covariance = self.of_velocity = np.zeros((count, 3, 3))
        if isinstance(model, Camera):
            deviations = model.position_noise, model.position_noise, model.heading_scatter
            self.covariance = np.tile(np.diag(np.square(deviations)), (count, 1, 1))
        self._random, self._by_constants = np.zeros((2, count, 3, 3))  # P and J

    def advance(self, t: float, place: np.ndarray, heading: np.ndarray) -> None:
        """Go on to the believed poses at time t [s]; the first call sets the start, a second at one time nothing."""
        place, heading, dt = place.astype(float), heading.astype(float), t - self.t
        if np.isnan(dt):
            self.t, self.place, self.heading = t, place, heading
        elif dt > 0:
            turn = (heading - self.heading + np.pi) % (2.0 * np.pi) - np.pi
            moved, course = place - self.place, self.heading + 0.5 * turn
            c, s = np.cos(course), np.sin(course)
            forward, left = moved[:, 0] * c + moved[:, 1] * s, moved[:, 1] * c - moved[:, 0] * s
            self.velocity = np.stack([forward, left, moved[:, 2]], axis=-1) / dt
            self.turn_rate = turn / dt
            if isinstance(self.model, Camera):
                self.of_velocity = 2.0 * self.covariance / dt**2
            elif self.model:
                self._grow(self.model, turn, moved, np.stack([c, s], axis=-1), forward, left, dt)
            self.t, self.place, self.heading = t, place, heading

    def _grow(
        self,
        model: Odometry,
        turn: np.ndarray,
        moved: np.ndarray,
        ahead: np.ndarray,
        forward: np.ndarray,
        left: np.ndarray,
        dt: float,
    ) -> None:
        """Add a time step to the covariances: turn [rad], displacements [m], and the unit vectors of the courses."""
        path = np.copysign(np.hypot(forward, left), forward)
        k1, k2, k3, k4 = model.variances
        random = np.stack([k1 * abs(turn) + k2 * abs(path), k3 * abs(path) + k4 * abs(turn)], axis=-1)
        constant = np.square(model.deviations)
        by_pose = np.tile(np.eye(3), (len(turn), 1, 1))
        by_pose[:, 0, 2], by_pose[:, 1, 2] = -moved[:, 1], moved[:, 0]
        by_turn, by_path, by_scale = np.zeros((3, len(turn), 3))
        by_turn[:, 0], by_turn[:, 1], by_turn[:, 2] = -0.5 * moved[:, 1], 0.5 * moved[:, 0], 1.0
        by_path[:, :2], by_scale[:, :2] = ahead, moved[:, :2]
        by_errors = np.stack([by_turn, by_path], axis=-1)
        by_constants = np.stack([by_scale, turn[:, None] * by_turn, path[:, None] * by_turn], axis=-1)
        self._random = _propagated(by_pose, self._random) + _propagated(by_errors, random)
        self._by_constants = by_pose @ self._by_constants + by_constants
        self.covariance = self._random + _propagated(self._by_constants, constant)

        of_speed, of_turn = np.zeros((2, len(turn), 3, 3))
        of_speed[:, 0, 0], of_speed[:, 1, 0] = forward, left
        of_speed[:, 2, 1], of_speed[:, 2, 2] = turn, path
        of_turn[:, 0, 0], of_turn[:, 2, 2] = random[:, 1], random[:, 0]
        self.of_velocity = (of_turn + _propagated(of_speed, constant)) / dt**2

    def fields(self, n: int, robot: str, frame: MapFrame) -> Fields:
        """Return the fields of robot n's ROS Odometry; robot: its name, frame: that of the positions."""
        velocity = dict(zip("xyz", self.velocity[n].tolist(), strict=True))
        pose = {
            "position": frame.point(*self.place[n].tolist()),
            "orientation": ros.yawed(float(self.heading[n])),
        }
        return {
            "header": ros.header(self.t, f"{robot}/{ODOM}"),
            "child_frame_id": f"{robot}/{BASE}",
            "pose": {"pose": pose, "covariance": _of_six(self.covariance[n])},
            "twist": {
                "twist": {"linear": velocity, "angular": {"z": float(self.turn_rate[n])}},
                "covariance": _of_six(self.of_velocity[n]),
            },
        }


def _propagated(jacobian: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Return A C A' of Jacobians A (n, 3, m); variance: covariances C (n, m, m), or their diagonals (n, m) or (m,)."""
    spread = jacobian @ variance if variance.ndim == 3 else jacobian * variance[..., None, :]
    return spread @ jacobian.transpose(0, 2, 1)


def _of_six(planar: np.ndarray) -> np.ndarray:
    """Return the 6x6 covariance of ROS (x, y, z, roll, pitch, yaw) of a planar one (x, y, yaw)."""
    whole = np.zeros((6, 6))
    whole[PLANAR] = planar
    return whole
