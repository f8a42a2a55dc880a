"""Forward kinematics with sliders, or inverse kinematics of targets; RViz shows the arm.

ros2 launch pieper_ros forward_or_inverse.launch.py mode:=forward arm:=mh12
ros2 launch pieper_ros forward_or_inverse.launch.py mode:=inverse arm:=mh12 method:=report
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, PythonExpression
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

PACKAGE = "pieper_ros"


def share(*path):
    return PathJoinSubstitution([FindPackageShare(PACKAGE), *path])


def when(*words):
    """A condition: a Python expression, whose words may be launch arguments in quotes."""
    return IfCondition(PythonExpression(list(words)))


def generate_launch_description():
    arm, mode, gui, rviz = (LaunchConfiguration(name) for name in ("arm", "mode", "gui", "rviz"))
    forward = ("'", mode, "' == 'forward'")
    inverse = ("'", mode, "' == 'inverse'")
    sliders = (*forward, " and '", gui, "'.lower() == 'true'")

    return LaunchDescription(
        [
            DeclareLaunchArgument("mode", choices=["forward", "inverse"], description="sliders and a pose, or targets"),
            DeclareLaunchArgument("arm", default_value="mh12", description="a built-in robot, or a URDF or xacro file"),
            DeclareLaunchArgument("frame", default_value="base_link", description="fixed frame of the view"),
            DeclareLaunchArgument("gui", default_value="true", description="forward: sliders; else a simulated arm"),
            DeclareLaunchArgument("rviz", default_value="true", description="open RViz"),
            DeclareLaunchArgument(
                "method",
                default_value="solve",
                choices=["solve", "report"],
                description="inverse: how targets are reached",
            ),
            Node(
                package=PACKAGE,
                executable="description",
                arguments=[arm],
                parameters=[share("config", "description.yaml")],
            ),
            Node(
                package=PACKAGE,
                executable="forward",
                arguments=[arm],
                parameters=[share("config", "forward.yaml")],
                output="screen",
                condition=when(*forward),
            ),
            Node(
                package="joint_state_publisher_gui",
                executable="joint_state_publisher_gui",
                condition=when(*sliders),
            ),
            Node(
                package=PACKAGE,
                executable="controller",
                arguments=[arm],
                parameters=[share("config", "controller.yaml")],
                output="screen",
                condition=when("not (", *sliders, ")"),
            ),
            Node(
                package=PACKAGE,
                executable="inverse",
                arguments=[arm],
                parameters=[share("config", "inverse.yaml"), {"method": LaunchConfiguration("method")}],
                output="screen",
                condition=when(*inverse),
            ),
            # the frames that RViz shows; what it prints goes to the log file
            Node(
                package=PACKAGE,
                executable="forward",
                name="frames",
                arguments=[arm],
                parameters=[share("config", "forward.yaml")],
                remappings=[("pose", "frames/pose")],
                output="log",
                condition=when(*inverse),
            ),
            Node(
                package="rviz2",
                executable="rviz2",
                arguments=["-d", share("rviz", "arm.rviz"), "-f", LaunchConfiguration("frame")],
                condition=IfCondition(rviz),
            ),
        ]
    )
