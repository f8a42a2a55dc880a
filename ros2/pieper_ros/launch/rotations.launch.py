"""Conversions of rotations as services: quat2rodrigues and quat2zyx.

ros2 launch pieper_ros rotations.launch.py
"""

from launch import LaunchDescription
from launch_ros.actions import Node


def generate_launch_description():
    return LaunchDescription([Node(package="pieper_ros", executable="rotations", output="screen")])
