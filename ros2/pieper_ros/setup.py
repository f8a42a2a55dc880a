"""What colcon installs: entry points of the nodes, launch files, parameters, a view. The version is that of package.xml."""

from glob import glob
from xml.etree import ElementTree

from setuptools import setup

NAME = "pieper_ros"
NODES = ("forward", "inverse", "description", "topic_latcher", "controller", "ik_server", "rotations")

setup(
    name=NAME,
    version=ElementTree.parse("package.xml").findtext("version"),
    description="Nodes for the kinematics of robot arms.",
    license="Apache-2.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        *((f"share/{NAME}/{folder}", sorted(glob(f"{folder}/*"))) for folder in ("launch", "config", "rviz")),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    entry_points={"console_scripts": [f"{node} = {NAME}.nodes:{node}" for node in NODES]},
)
