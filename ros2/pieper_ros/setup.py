"""What colcon installs: entry points of the nodes, launch files, parameters, a view. The version is that of package.xml."""

from pathlib import Path
from xml.etree import ElementTree as ET

from setuptools import setup

NAME = "pieper_ros"
NODES = ("forward", "inverse", "description", "topic_latcher", "controller", "ik_server", "rotations", "tracker")


def files_in(folder):
    """What is installed of a folder."""
    return sorted(path.as_posix() for path in Path(folder).iterdir() if path.is_file())


setup(
    name=NAME,
    version=ET.parse("package.xml").findtext("version"),
    description="Nodes for the kinematics of robot arms.",
    license="Apache-2.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        *((f"share/{NAME}/{folder}", files_in(folder)) for folder in ("launch", "config", "rviz")),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    entry_points={"console_scripts": [f"{node} = {NAME}.nodes:{node}" for node in NODES]},
)
