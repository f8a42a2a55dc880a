"""Inverse kinematics as services: calculate_ik, calculate_ik_branches, compute_ik, compute_fk.

ros2 launch pieper_ros ik_server.launch.py arm:=kr210
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description():
    arm = LaunchConfiguration("arm")
    parameters = PathJoinSubstitution([FindPackageShare("pieper_ros"), "config", "ik_server.yaml"])
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "arm", default_value="kr210", description="a built-in robot, or a URDF or xacro file"
            ),
            Node(package="pieper_ros", executable="description", arguments=[arm]),
            Node(
                package="pieper_ros", executable="ik_server", arguments=[arm], parameters=[parameters], output="screen"
            ),
        ]
    )
