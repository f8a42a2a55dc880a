"""Colour models: distances, tables, files, and what is said of captures that are odd."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import mahalanobis

from pieper.errors import ArrayError, UnknownNameError, VisionError
from pieper.perception.color import Background, ColorModel
from pieper.perception.color_learning import classified, learn
from pieper.perception.color_regions import Region, parse_region, read_regions
from pieper.perception.color_space import NOISE, OFFSET, SPACES, LogChroma, hsv_statistics, pooled
from pieper.perception.drawn_color import draw_color
from tests.perception.color_scenes import FIELD, PAINT, PLACES, box, frame, learned, share_found

EXACT = 1e-9
"""Two ways to the same number in double precision."""


@pytest.fixture(scope="module")
def taught():
    return learned()


@pytest.fixture(scope="module")
def model(taught):
    return taught.model


def test_A2_one_model_for_each_colour_with_its_name_and_draw_colour():
    names = ("Rojo", "Azul", "my green")
    regions = [Region(name, 0, r.x, r.y, r.width, r.height) for name, r in zip(names, map(box, PAINT), strict=True)]
    model = learn(lambda n: frame(), regions, draw={"my green": (1, 2, 3)}).model
    assert model.names == names
    assert model.means.shape == (3, 3)
    assert model.draw == (draw_color("red"), draw_color("blue"), (1, 2, 3))


def test_a_colour_without_a_draw_colour_is_drawn_as_it_is(model):
    unnamed = learn(lambda n: frame(noise=0), [Region("x", 0, 25, 25, 11, 11)]).model
    assert np.abs(np.subtract(unnamed.draw[0], PAINT["red"])).max() <= 1


@pytest.mark.parametrize("seed", range(3))
def test_A5_mean_and_covariance_are_those_of_opencvs_hsv_where_hue_does_not_wrap(seed):
    pixels = np.random.default_rng(seed).integers([60, 150, 20], [90, 220, 50], (200, 3)).astype(np.uint8)
    hsv = cv2.cvtColor(pixels[None], cv2.COLOR_BGR2HSV)[0].astype(float)
    mean, covariance = hsv_statistics(pixels)
    np.testing.assert_allclose(mean, hsv.mean(axis=0), atol=EXACT)
    np.testing.assert_allclose(covariance, np.cov(hsv.T, ddof=0), atol=1e-7)


def test_A5_P3_the_hue_of_red_wraps():
    reds = [cv2.cvtColor(np.uint8([[[h, 200, 200]]]), cv2.COLOR_HSV2BGR)[0, 0] for h in (176, 178, 2, 4)]
    mean, covariance = hsv_statistics(np.array(reds))
    assert min(mean[0], 180 - mean[0]) < 1.0  # and not 90, the mean of the numbers
    assert covariance[0, 0] < 15.0  # and not 87^2


@given(st.floats(0, 180, exclude_max=True), st.integers(0, 10**6))
@settings(max_examples=50, deadline=None)
def test_turning_all_hues_turns_their_mean(turn, seed):
    space = SPACES["hsv"]
    x = np.random.default_rng(seed).uniform([80, 50, 50], [110, 200, 200], (20, 3))
    turned = (x + np.array([turn, 0, 0])) % [180, 1e9, 1e9]
    difference = space.minus(space.mean(turned) - [turn, 0, 0], space.mean(x))
    np.testing.assert_allclose(difference, 0, atol=1e-7)


@pytest.mark.parametrize("space", sorted(SPACES))
def test_A6_P3_captures_of_equal_size_pool_to_the_covariance_of_all_their_pixels(space):
    """Law of total covariance: the spread between captures is not lost, as a mean of covariances loses it."""
    rng = np.random.default_rng(3)
    captures = [rng.normal(m, 2.0, (50, 3)) for m in ([60, 120, 100], [70, 130, 140], [64, 90, 120])]
    covariances = np.array([np.cov(c.T, ddof=0) for c in captures])
    means = np.array([c.mean(axis=0) for c in captures])
    mean, covariance = pooled(means, covariances, SPACES[space])
    np.testing.assert_allclose(mean, np.concatenate(captures).mean(axis=0), atol=EXACT)
    np.testing.assert_allclose(covariance, np.cov(np.concatenate(captures).T, ddof=0), atol=1e-8)
    assert np.trace(covariance) > 5 * np.trace(covariances.mean(axis=0))


def test_A6_P3_a_capture_in_other_light_widens_the_model_along_it():
    bright, dim = frame(seed=1), frame(light=0.6, seed=2)
    once = learn([bright, bright].__getitem__, [box("red"), box("red", 1, 1)]).model
    twice = learn([bright, dim].__getitem__, [box("red"), box("red", 1, 1)]).model
    assert np.trace(twice.covariances[0]) > 3 * np.trace(once.covariances[0])


def test_A7_the_mask_is_a_threshold_on_the_mahalanobis_distance_itself(model):
    """The distance against SciPy's, with the covariance stated in the room: learned, light, and noise of the pixel."""
    pixels = np.random.default_rng(5).integers(0, 256, (40, 3)).astype(np.uint8)
    space = LogChroma()
    for k, name in enumerate(model.names):
        light = space.spread(model.means[k], model.light, model.cast)
        wanted = []
        for pixel in pixels.astype(float):
            noise = np.diag((NOISE / (pixel + OFFSET)) ** 2)
            inverse = np.linalg.inv(model.covariances[k] + light + noise)
            wanted.append(mahalanobis(np.log(pixel + OFFSET), model.means[k], inverse))
        np.testing.assert_allclose(model.distance(pixels, name), wanted, rtol=1e-6)
        for threshold in (1.0, 4.0, 9.0):
            np.testing.assert_array_equal(model.mask(pixels, name, threshold), np.array(wanted) <= threshold)
        np.testing.assert_array_equal(model.mask(pixels, name), np.array(wanted) <= model.threshold)


def test_A7_the_threshold_says_which_share_of_a_gaussian_it_holds(model):
    x = np.random.default_rng(0).standard_normal((200_000, 3))
    assert (np.linalg.norm(x, axis=1) <= model.threshold).mean() == pytest.approx(model.share_inside, abs=5e-4)


@pytest.mark.parametrize("space", sorted(SPACES))
def test_markers_are_found_and_the_field_is_not(space):
    model = learned(space=space).model
    image = frame(seed=9)
    table = model.table()
    assert share_found(image, table) == 1.0
    assert (table.classify(image[:, 170:]) == 0).mean() > 0.999  # field alone


def test_a_table_is_the_model_at_the_middle_of_each_cell(model):
    side = 16
    middle = (np.arange(side) + 0.5) * 16 - 0.5
    cells = np.stack(np.meshgrid(middle, middle, middle, indexing="ij"), axis=-1)
    exact, table = model.classify(cells), model.table(bits=4).labels
    assert (exact != table).mean() < 1e-3  # single precision decides a few on the border otherwise
    assert set(np.unique(table)) == {0, 1, 2, 3}


def test_no_cell_is_left_out_by_looking_only_near_the_colour(model):
    everywhere = ColorModel(model.names, model.means, model.covariances, threshold=model.threshold)
    side = 32
    middle = (np.arange(side) + 0.5) * 8 - 0.5
    pixels = np.stack(np.meshgrid(middle, middle, middle, indexing="ij"), axis=-1).reshape(-1, 3)
    for k, name in enumerate(model.names):
        inside = set(np.flatnonzero(everywhere.mask(pixels, name, everywhere.threshold * 0.999)))
        assert inside <= set(everywhere._near(k, middle.astype(np.float32)))


def test_an_area_without_markers_is_background_even_where_it_is_like_a_dimmed_marker(model):
    """The field is a dark green: nearer to the marker's green without the background class than with it."""
    bare = ColorModel(model.names, model.means, model.covariances, threshold=8.0)
    wary = ColorModel(model.names, model.means, model.covariances, threshold=8.0, background=model.background)
    field = frame(places={}, seed=4)
    assert (bare.classify(field) != 0).mean() > 0.5
    assert (wary.classify(field) != 0).mean() < 0.001


def test_dark_pixels_have_no_colour(model):
    dark = np.random.default_rng(0).integers(0, 20, (500, 3)).astype(np.uint8)
    assert not model.classify(dark).any()
    assert not model.table().classify(dark[None]).any()


def test_the_corners_of_a_box_around_a_disc_stay_out_of_the_model():
    tight = learn(lambda n: frame(), [box("red", half=6)])
    loose = learn(lambda n: frame(), [box("red", half=13)])
    assert loose.captures[0].share < 0.6
    np.testing.assert_allclose(loose.model.means, tight.model.means, atol=0.02)
    np.testing.assert_allclose(loose.captures[0].hsv_mean, tight.captures[0].hsv_mean, atol=1.0)


def test_a_flat_region_works_and_is_said():
    taught = learn(lambda n: frame(noise=0), [box("red", half=3)])
    assert taught.captures[0].flat
    assert any("is flat" in r and "singular" in r for r in taught.remarks)
    assert share_found(frame(noise=0), taught.model.table(), {"red": PLACES["red"]}) == 1.0


def test_a_region_of_one_pixel_works_and_is_said():
    taught = learn(lambda n: frame(), [Region("red", 0, 30, 30, 1, 1)])
    assert any("one pixel" in r for r in taught.remarks)
    assert taught.model.distance(np.uint8([PAINT["red"]]), "red")[0] < 2.0


def test_a_loose_box_is_said():
    taught = learn(lambda n: frame(), [Region("red", 0, 4, 4, 52, 52)])
    assert any("a tighter box says more" in r for r in taught.remarks)


def test_colours_that_overlap_are_said_with_the_pair():
    regions = [box("red"), Region("crimson", 0, 85, 65, 11, 11), box("blue")]
    remarks = learn(lambda n: frame(), regions).remarks
    said = [r for r in remarks if "overlap" in r]
    assert len(said) == 1
    assert "'red' and 'crimson'" in said[0]


def test_validation_tells_confusion_shares_and_what_holds_for_captures_left_out(taught):
    report = taught.model.notes["validation"]
    for name in PAINT:
        assert sum(report["confusion"][name].values()) == pytest.approx(1.0, abs=1e-3)
        assert report["confusion"][name][name] > 0.99
        assert report["held_out"][name] > 0.99
    area = np.pi * 11**2 * 2 / (180 * 100)
    for row in report["explained"].values():
        assert list(row.values()) == pytest.approx([area] * 3, rel=0.1)  # the rims are mixed
    assert taught.remarks == ()


@pytest.mark.parametrize("space", sorted(SPACES))
def test_a_model_is_written_and_read(space, tmp_path):
    model = learned(space=space, source={"source": "x.mp4"}).model
    model.save(tmp_path / "c.yaml")
    again = ColorModel.load(tmp_path / "c.yaml")
    assert (again.names, again.draw, again.space, again.threshold) == (model.names, model.draw, space, model.threshold)
    np.testing.assert_allclose(again.means, model.means, rtol=1e-6)
    assert (again.table().labels != model.table().labels).mean() < 1e-4  # written with seven digits
    noted = again.notes["learned"]
    assert noted["source"] == "x.mp4"
    assert noted["frames"] == [0, 1]
    assert set(noted) >= {"date", "pieper", "numpy"}
    assert again.notes["regions"][0]["roi"] == [23, 23, 15, 15]
    assert again.notes["validation"]["confusion"]["red"]["red"] > 0.99
    again.save(tmp_path / "d.yaml")
    assert (tmp_path / "d.yaml").read_text() == (tmp_path / "c.yaml").read_text()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("space: log-chroma", "space: lab", r"c\.yaml, line \d+, space: no space 'lab'"),
        ("threshold: 4.0", "threshold: -1", r"line \d+, threshold: must be at least 0.1"),
        ("mean: [", "mean: [1, ", r"line \d+, colors\.red\.mean: must be 3 numbers"),
        ("covariance: [[", "covariance: [[-", r"line \d+, colors\.red\.covariance: must be symmetric and positive"),
        ("draw: '#", "draw: '!", r"line \d+, colors\.red\.draw: a draw colour must be"),
        ("format: pieper colors 1", "format: pieper colors 9", r"line \d+, format: must be 'pieper colors 1'"),
        ("weights: [", "weights: [-", r"line \d+, background\.weights: must be positive"),
        ("colors:", "colours:", r"line \d+, colours: no field 'colours' in this file; did you mean 'colors'"),
    ],
)
def test_a_malformed_file_is_refused_with_line_and_field(model, tmp_path, old, new, message):
    path = tmp_path / "c.yaml"
    model.save(path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(VisionError, match=message):
        ColorModel.load(path)


def test_A4_a_region_is_frame_x_y_w_h():
    assert parse_region("my red:12,3,4,5,6") == Region("my red", 12, 3, 4, 5, 6)
    assert parse_region("12,3,4,5,6", "red") == Region("red", 12, 3, 4, 5, 6)
    for wrong in ("12,3,4,5,6", "red:1,2,3,4", "red:1,2,3,4,x", "red:"):
        with pytest.raises(VisionError, match=r"a region must be|must be whole pixels"):
            parse_region(wrong)


@pytest.mark.parametrize(
    ("region", "message"),
    [
        (Region("red", 0, 5, 5, 0, 9), "is empty"),
        (Region("red", 0, 5, 5, 9, -2), "is empty"),
        (Region("red", 0, 175, 5, 9, 9), "reaches beyond the image of 180 x 100"),
        (Region("red", 0, -1, 5, 9, 9), "reaches beyond"),
    ],
)
def test_P1_A4_regions_that_are_empty_or_outside_are_refused(region, message):
    with pytest.raises(VisionError, match=message):
        learn(lambda n: frame(), [region])


def test_no_regions_and_dark_regions_are_refused():
    with pytest.raises(VisionError, match="no regions"):
        learn(lambda n: frame(), [])
    with pytest.raises(VisionError, match="too dark to have a colour"):
        learn(lambda n: frame(light=0.05), [box("red")])


@pytest.mark.parametrize("image", [np.zeros((9, 9), np.uint8), np.zeros((9, 9, 3), np.uint16)])
def test_grey_and_16_bit_frames_are_refused(image):
    with pytest.raises(VisionError, match="must be a colour image of 8 bits"):
        learn(lambda n: image, [Region("red", 0, 0, 0, 5, 5)])


def test_A4_regions_in_files(tmp_path):
    wanted = [Region("red", 1, 2, 3, 4, 5), Region("red", 2, 2, 3, 4, 5), Region("blue", 1, 9, 9, 4, 5)]
    (tmp_path / "r.yaml").write_text(
        "colors:\n  red: [[1, 2, 3, 4, 5], [2, 2, 3, 4, 5]]\n  blue: [[1, 9, 9, 4, 5]]\ndraw: {red: '#ff0000'}\n"
    )
    assert read_regions(tmp_path / "r.yaml") == (wanted, {"red": (0, 0, 255)})
    (tmp_path / "r.csv").write_text(
        "color,frame,x,y,width,height\nred,1,2,3,4,5\nred,2,2,3,4,5\n\nblue, 1, 9, 9, 4, 5\n"
    )
    assert read_regions(tmp_path / "r.csv")[0] == wanted


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("r.csv", "red,1,2,3,4,5\n", r"r\.csv, line 1: the columns must be color,frame"),
        ("r.csv", "color,frame,x,y,width,height\nred,1,2\n", r"r\.csv, line 2: must have 6 columns, got 3"),
        ("r.csv", "color,frame,x,y,width,height\nred,1,2,3,4,b\n", r"r\.csv, line 2: must be whole numbers"),
        ("r.yaml", "colors:\n  red: [[1, 2, 3, 4]]\n", r"r\.yaml, line 2, colors\.red: must be any x 5 numbers"),
        ("r.yaml", "colors:\n  red: [[1, 2, 3, 4, 5.5]]\n", r"line 2, colors\.red: must be lists of whole numbers"),
        ("r.yaml", "colors: {red: []}\ndraw: {blue: red}\n", r"line 2, draw\.blue: is not among the colors"),
    ],
)
def test_malformed_files_of_regions_name_the_line(tmp_path, name, text, message):
    (tmp_path / name).write_text(text)
    with pytest.raises(VisionError, match=message):
        read_regions(tmp_path / name)


def test_malformed_models_are_refused(model):
    with pytest.raises(ArrayError, match="positive definite"):
        ColorModel(("red",), np.zeros((1, 3)), np.zeros((1, 3, 3)))
    with pytest.raises(ArrayError, match=r"means must have shape \(2, 3\)"):
        ColorModel(("red", "blue"), np.zeros((1, 3)), np.eye(3)[None])
    with pytest.raises(VisionError, match="different words"):
        ColorModel(("red", "red"), np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1)))
    with pytest.raises(UnknownNameError, match="no colour 'rde'"):
        model.mask(np.zeros((1, 3), np.uint8), "rde")
    with pytest.raises(ArrayError, match="scale 16-bit images"):
        model.mask(np.full((1, 3), 4000, np.uint16), "red")
    with pytest.raises(VisionError, match="log-chroma follow the light"):
        learned(space="hsv").model.relit([0.1, 0.1, 0.1])
    assert Background().weights.size == 0


def test_another_light_moves_every_colour_as_it_moves_its_pixels(model):
    gain = np.log([0.5, 0.45, 0.4])
    moved = model.relit(gain)
    for k, paint in enumerate(PAINT.values()):
        now = np.log(np.array(paint) * np.exp(gain) + OFFSET)
        np.testing.assert_allclose(moved._now[k], now, atol=0.05)  # noise of the samples
    assert share_found(frame(light=1.0, cast=(0.5, 0.45, 0.4)), moved.table()) == 1.0
    np.testing.assert_array_equal(model.relit(np.zeros(3)).table().labels, model.table().labels)


def test_a_picture_shows_what_is_found(model):
    image = frame(seed=7)
    both = classified(image, model)
    assert both.shape == (100, 360, 3)
    np.testing.assert_array_equal(both[:, :180], image)
    np.testing.assert_array_equal(both[30, 180 + 30], np.maximum(image[30, 30] // 4, model.draw[0]))
    assert FIELD[1] // 4 + 5 > both[5, 180 + 5, 1]


def test_a_misspelt_field_is_not_passed_over(tmp_path):
    path = tmp_path / "c.yaml"
    ColorModel(("red",), np.log([[46, 46, 236]]), [0.01 * np.eye(3)]).save(path)
    path.write_text(path.read_text() + "treshold: 2.5\n")
    with pytest.raises(
        VisionError, match=r"line \d+, treshold: no field 'treshold' in this file; did you mean 'threshold'"
    ):
        ColorModel.load(path)
