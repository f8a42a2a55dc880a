"""A scene on disk: what is written is what the other parts read."""

import cv2
import numpy as np
import pytest

from pieper.errors import VisionError
from pieper.perception import scene as scenes
from pieper.perception import scene_folder, scene_presets
from pieper.perception import truth as truths
from pieper.perception.calibration_file import load_camera, load_field_size, load_view
from pieper.perception.color_regions import read_regions
from pieper.perception.pattern import Patterns, load_patterns
from pieper.perception.synthetic import Renderer


@pytest.fixture(scope="module")
def scene():
    return scene_presets.preset("lens", (320, 240)).but(frames=6)


@pytest.fixture(scope="module")
def folder(scene, tmp_path_factory):
    to = tmp_path_factory.mktemp("scene")
    assert scene_folder.write(scene, to) == 6
    return to


def test_the_video_shows_the_frames(scene, folder):
    film = cv2.VideoCapture(str(folder / "video.mp4"))
    assert film.get(cv2.CAP_PROP_FPS) == scene.fps
    for frame, _ in Renderer(scene):
        read, image = film.read()
        assert read
        assert np.abs(image.astype(int) - frame.image).mean() < 6  # as the codec has it
    assert not film.read()[0]


def test_pictures_lose_nothing(scene, tmp_path):
    scene_folder.write(scene, tmp_path, lossless=True)
    files = sorted((tmp_path / "frames").glob("*.png"))
    assert [file.name for file in files] == [f"{k:06d}.png" for k in range(6)]
    for file, (frame, _) in zip(files, Renderer(scene), strict=True):
        assert np.array_equal(cv2.imread(str(file)), frame.image)


def test_the_truth_is_that_of_the_scene(scene, folder):
    read = truths.read(folder / "truth.jsonl")
    renderer = Renderer(scene)
    assert [truth.index for truth in read] == list(range(6))
    for truth in read:
        for a, b in zip(truth.objects, renderer.truth(truth.index).objects, strict=True):
            assert (a.name, a.kind) == (b.name, b.kind)
            assert np.array_equal(a.position, b.position)


def test_the_calibration_is_that_of_the_scene(scene, folder):
    view = load_view(folder / "field.yaml")
    assert np.allclose(view.T_camera_field, scene.view.T_camera_field, atol=1e-12)
    assert np.allclose(load_camera(folder / "camera.yaml").matrix, scene.view.camera.matrix)
    assert np.allclose(view.camera.distortion, scene.view.camera.distortion)
    assert load_field_size(folder / "field.yaml") == (scene.pitch.length, scene.pitch.width)


def test_the_patterns_are_those_of_the_robots(scene, folder):
    read, made = load_patterns(folder / "patterns.yaml"), Patterns.of_scene(scene)
    assert [robot.name for robot in read.robots] == [robot.name for robot in made.robots]
    assert read.ball.color == made.ball.color
    for a, b in zip(read.robots, made.robots, strict=True):
        for m, n in zip(a.markers, b.markers, strict=True):
            assert m.color == n.color
            assert (*m.position, m.height, m.radius) == pytest.approx((*n.position, n.height, n.radius), abs=1e-9)


def test_the_regions_show_their_colours(scene):
    big = scene_presets.preset("clean").but(frames=40)
    renderer = Renderer(big)
    for region in scene_folder.color_regions(big):
        cut = region.cut(renderer[region.frame][0].image)
        assert np.abs(cut.astype(int) - scenes.COLORS[region.color]).max() <= 3
    assert {r.color for r in scene_folder.color_regions(big)} == Patterns.of_scene(big).colors


def test_the_regions_can_be_read(folder):
    regions, _ = read_regions(folder / "regions.yaml")
    assert all(0 <= region.frame < 6 for region in regions)


def test_nothing_is_written_over_unless_it_is_asked_for(scene, folder):
    before = (folder / "truth.jsonl").read_bytes()
    with pytest.raises(VisionError, match=r"holds video.mp4, truth.jsonl, .* already; .*--force"):
        scene_folder.write(scene, folder)
    assert (folder / "truth.jsonl").read_bytes() == before
    assert scene_folder.write(scene.but(frames=2), folder, force=True) == 2
    assert len(truths.read(folder / "truth.jsonl")) == 2
    scene_folder.write(scene, folder, force=True)


def test_stopped_in_between_it_leaves_whole_files(scene, tmp_path):
    def stop(done, _):
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        scene_folder.write(scene, tmp_path, progress=stop)
    assert len(truths.read(tmp_path / "truth.jsonl")) == 3
    film = cv2.VideoCapture(str(tmp_path / "video.mp4"))
    assert [film.read()[0] for _ in range(4)] == [True, True, True, False]
    assert not list(tmp_path.glob("*unfinished*"))


def test_fewer_pictures_than_before_leave_none_of_the_old_ones(scene, tmp_path):
    scene_folder.write(scene, tmp_path, lossless=True)
    scene_folder.write(scene.but(frames=2), tmp_path, lossless=True, force=True)
    assert len(list((tmp_path / "frames").iterdir())) == 2
