"""One function for each node; each is ``pieper ros NODE`` with the words of the command line.

``ros2 run pieper_ros inverse mh12 --ros-args -p method:=report`` is ``pieper ros inverse mh12 --ros-args -p method:=report``.
The backend is chosen there, and is rclpy wherever that can be imported.
"""

from __future__ import annotations

import sys


def forward() -> None:
    """Joint states in, pose and frames out."""
    _run("forward")


def inverse() -> None:
    """Targets in, joint states out."""
    _run("inverse")


def description() -> None:
    """The robot description, latched."""
    _run("description")


def topic_latcher() -> None:
    """Pass on what is said on robot_description, latched, to those who come later."""
    _run("description")


def controller() -> None:
    """Move a simulated arm."""
    _run("controller")


def ik_server() -> None:
    """Inverse kinematics as services."""
    _run("ik_server")


def rotations() -> None:
    """Quaternion conversions as services."""
    _run("rotations")


def tracker() -> None:
    """Robots and balls that a camera sees."""
    _run("tracker")


def _run(node: str) -> None:
    try:
        from pieper.cli.main import main
    except ImportError as error:
        sys.exit(f"pieper_ros: the Python package pieper is missing ({error}); pip install 'pieper[ros]'")
    sys.exit(main(["ros", node, *sys.argv[1:]]))
