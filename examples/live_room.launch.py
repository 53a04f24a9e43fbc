"""ROS 2 launch file of a simulated room: the live service, its zenoh bridge, and a command that drives a robot.

    ros2 launch live_room.launch.py

It takes ROS 2, `zenoh-bridge-ros2dds` and taichi_plume with the extra `ros`; a run takes 10 min in real time. Foxglove
shows the room at ws://127.0.0.1:8765 with the layout live_room.foxglove.json. Replace the last process by your nodes.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration

DRIVEN = "/remote_0/cmd_vel"
CIRCLE = "{linear: {x: 0.1}, angular: {z: 0.3}}"  # m/s, rad/s


def generate_launch_description() -> LaunchDescription:
    """Return the processes: simulation, bridge between its topics and those of ROS, and commands to a robot."""
    scenario, speed = LaunchConfiguration("scenario"), LaunchConfiguration("speed")
    serve = ["python3", "-m", "taichi_plume.serve", scenario, "--at-once", "--speed", speed]
    bridge = ["zenoh-bridge-ros2dds", "-e", "tcp/127.0.0.1:7447"]
    drive = ["ros2", "topic", "pub", "--rate", "5", DRIVEN, "geometry_msgs/msg/Twist", CIRCLE]
    return LaunchDescription(
        [
            DeclareLaunchArgument("scenario", default_value="live/room", description="file or example"),
            DeclareLaunchArgument("speed", default_value="1", description="simulated over real time"),
            *(ExecuteProcess(cmd=command, output="screen") for command in (serve, bridge, drive)),
        ]
    )
