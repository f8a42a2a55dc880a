"""`pieper ros tracker`: a folder of rendered images, tracked and published on a network inside this process."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("cv2", reason="the tracker in a video needs OpenCV")
import cv2

import pieper.ros
from pieper.cli import main as command
from pieper.perception.color import ColorModel
from pieper.perception.color_space import SPACES
from pieper.perception.scene import COLORS
from pieper.perception.scene_presets import preset
from pieper.perception.synthetic import Renderer
from pieper.ros.fake import FakeNetwork

POSE = "geometry_msgs/msg/PoseStamped"


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    """Twelve images of the report's robot, and the colours of its paint."""
    folder = tmp_path_factory.mktemp("film")
    scene = preset("report").but(frames=12)
    images = folder / "images"
    images.mkdir()
    for frame, _ in Renderer(scene):
        cv2.imwrite(str(images / f"{frame.index:03d}.png"), frame.image)
    names = ("red", "green", "blue")
    means = SPACES["log-chroma"].of(np.array([COLORS[name] for name in names], dtype=np.float64))
    ColorModel(names, means, [0.01 * np.eye(3)] * 3).save(folder / "colors.yaml")
    return images, folder / "colors.yaml", scene


@pytest.fixture
def network(monkeypatch):
    network = FakeNetwork()
    monkeypatch.setattr(pieper.ros, "open_bus", lambda node, *, arguments=(), **_: network.bus(node, arguments))
    return network


def test_what_the_images_show_is_published(pieper_command, network, film):
    images, colors, scene = film
    heard = []
    network.bus("user").subscribe("robot_robot/pose", POSE, heard.append)
    result = pieper_command("ros", "tracker", images, "--colors", colors, "--patterns", "report", "--speed", "0")
    assert result.code == command.DONE, result.err
    network.advance(0.1)
    assert len(heard) >= 8  # confirmed in the third frame, and the node looks now and then
    p = heard[-1].pose.position
    truth = Renderer(scene).truth(11).objects[0]
    place = scene.view.to_image(truth.position, height=0.12)
    assert np.hypot(p.x - place[0], p.y - place[1]) < 1.0  # px: without a field, positions are pixels


def test_what_is_wrong_is_said(pieper_command, network, film, tmp_path):
    images, colors, _ = film
    for arguments, message in (
        (["nothing.mp4", "--colors", colors], "nothing.mp4"),
        ([images, "--colors", tmp_path / "no.yaml"], "no.yaml"),
        ([images, "--colors", colors, "--patterns", "ssl"], "the patterns have the colours"),
        ([images, "--colors", colors, "--speed", "-1"], "--speed must be a number of at least 0"),
        ([images], "--colors"),
    ):
        result = pieper_command("ros", "tracker", *arguments)
        assert result.code == command.BAD_INPUT
        assert message in result.err
