"""A Universal Robots arm with sliders, its description (latched), its frames, and RViz.

ros2 launch pieper_ros view_ur.launch.py ur_type:=ur5e
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare

UR_TYPES = ["ur3", "ur3e", "ur5", "ur5e", "ur10", "ur10e", "ur16e", "ur20", "ur30"]


def generate_launch_description():
    forward_or_inverse = PathJoinSubstitution(
        [FindPackageShare("pieper_ros"), "launch", "forward_or_inverse.launch.py"]
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument("ur_type", choices=UR_TYPES, description="the arm"),
            DeclareLaunchArgument("gui", default_value="true", description="sliders; else a simulated arm"),
            DeclareLaunchArgument("rviz", default_value="true", description="open RViz"),
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(forward_or_inverse),
                launch_arguments={
                    "mode": "forward",
                    "arm": LaunchConfiguration("ur_type"),
                    "gui": LaunchConfiguration("gui"),
                    "rviz": LaunchConfiguration("rviz"),
                }.items(),
            ),
        ]
    )
