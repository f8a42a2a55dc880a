"""The report's tracker does what the report says, weaknesses and all; the rows of its description, one by one."""

import cv2
import numpy as np
import pytest

from pieper.errors import VisionError
from pieper.perception import scene_presets
from pieper.perception.frame import Frame
from pieper.perception.report import MANY_GATE, ONE_GATE, Patch, ReportColor, ReportTracker, gaussian_mask
from pieper.perception.synthetic import Renderer

RED, BLUE, GREEN = (30, 30, 220), (220, 60, 30), (60, 220, 60)
CARPET = (70, 60, 50)


def grain(paint, shape=(15, 15), seed=0, sigma=3.0):
    random = np.random.default_rng(seed)
    return np.clip(np.array(paint) + random.normal(0, sigma, (*shape, 3)), 0, 255).astype(np.uint8)


def learn(name, paint, *, single=True):
    return ReportColor.learn(name, [grain(paint, seed=k) for k in range(3)], single=single, threshold=6.0)


@pytest.fixture
def colors():
    return [learn("Blue", BLUE), learn("Green", GREEN, single=False)]


def picture(*discs):
    image = np.full((240, 320, 3), CARPET, np.uint8)
    for paint, x, y, radius in discs:
        cv2.circle(image, (x, y), radius, paint, -1)
    return image


def frames(*images):
    return [Frame(image, k, k / 30) for k, image in enumerate(images)]


def test_A5_each_capture_has_a_mean_and_a_covariance_in_hsv_and_both_are_printed():
    region = grain(BLUE)
    color = ReportColor.learn("Blue", [region])
    hsv = cv2.cvtColor(region, cv2.COLOR_BGR2HSV).reshape(-1, 3)
    ((mean, covariance),) = color.captures
    assert mean == pytest.approx(hsv.mean(axis=0))
    assert covariance == pytest.approx(np.cov(hsv.T.astype(float)))
    assert covariance.shape == (3, 3)
    assert color.as_printed().startswith("Media HSV: [")
    assert "Covarianza HSV:" in color.as_printed()


def test_A6_the_reports_model_is_the_mean_of_means_and_the_mean_of_covariances():
    regions = [grain(BLUE), grain((180, 90, 60), seed=1)]
    color = ReportColor.learn("Blue", regions)
    one, two = (ReportColor.learn("Blue", [region]) for region in regions)
    assert color.mean == pytest.approx((one.mean + two.mean) / 2)
    assert color.covariance == pytest.approx((one.covariance + two.covariance) / 2)


def test_P3_the_reports_model_forgets_the_spread_between_captures_and_wraps_red():
    apart = ReportColor.learn("Blue", [grain(BLUE), grain((140, 60, 30), seed=1)])
    middle = np.round(apart.mean).astype(np.uint8)[None, None]
    own = cv2.cvtColor(grain(BLUE), cv2.COLOR_BGR2HSV)
    assert gaussian_mask(middle, apart.mean, apart.covariance, 3.0).all()
    assert (
        gaussian_mask(own, apart.mean, apart.covariance, 3.0).mean() < 0.05 * 255
    )  # not even what it was learned from
    assert 30 < ReportColor.learn("Red", [grain(RED)]).mean[0] < 150  # red is at 0 and at 180; its mean is neither


def test_A7_the_threshold_is_a_distance_and_not_its_square():
    mean, covariance = np.array([90.0, 120, 130]), np.diag([4.0, 25, 100])
    hsv = np.array([[[90 + 2 * k, 120, 130] for k in range(6)]], np.uint8)  # 0, 1, ... standard deviations away
    for threshold in (0.5, 2.5, 4.5):
        assert (gaussian_mask(hsv, mean, covariance, threshold)[0] > 0).sum() == int(threshold) + 1
    assert set(np.unique(gaussian_mask(hsv, mean, covariance, 2.5))) == {0, 255}


def test_A8_the_mask_is_eroded_once_and_dilated_twice_with_a_kernel_of_any_size(colors):
    image = picture((BLUE, 100, 100, 12))
    image[30:32, 30:32] = BLUE  # a speck that erosion takes
    hsv = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
    for size in ((3, 3), (5, 5), (3, 7)):
        tracker = ReportTracker(colors, kernel=size)
        tracker.find(image)
        raw = gaussian_mask(hsv, colors[0].mean, colors[0].covariance, colors[0].threshold)
        kernel = np.ones(size, np.uint8)
        assert np.array_equal(tracker.masks["Blue"], cv2.dilate(cv2.erode(raw, kernel), kernel, iterations=2))
        assert raw[30, 30]
        assert not tracker.masks["Blue"][30, 30]


def test_A9_the_combined_mask_is_the_union_of_the_masks(colors):
    tracker = ReportTracker(colors)
    tracker.find(picture((BLUE, 100, 100, 12), (GREEN, 200, 100, 12)))
    union = (tracker.masks["Blue"] > 0) | (tracker.masks["Green"] > 0)
    assert np.array_equal(tracker.combined() > 0, union)
    assert union[100, 100]
    assert union[100, 200]


@pytest.mark.parametrize(("radius", "found"), [(6, False), (8, True), (11, True), (14, False)])
def test_A10_only_the_largest_patch_counts_and_only_within_the_gate(colors, radius, found):
    tracker = ReportTracker(colors)  # the mask grows by two pixels
    patches = tracker.find(picture((BLUE, 100, 100, radius), (BLUE, 200, 100, radius - 3)))
    assert len(patches) == found
    if found:
        assert (patches[0].x, patches[0].y) == (100, 100)
        assert ONE_GATE[0] < patches[0].radius < ONE_GATE[1]


def test_A10_the_gate_excludes_its_ends(colors, monkeypatch):
    tracker = ReportTracker(colors)
    for radius, count in ((9.0, 0), (9.01, 1), (15.49, 1), (15.5, 0)):
        monkeypatch.setattr(cv2, "minEnclosingCircle", lambda _, r=radius: ((100.9, 50.9), r))
        patches = tracker.find(picture((BLUE, 100, 100, 11)))
        assert len(patches) == count
        assert all((p.x, p.y) == (100, 50) for p in patches)  # cut, not rounded


def test_A11_every_green_patch_within_its_gate_is_found(colors):
    tracker = ReportTracker(colors)
    patches = tracker.find(
        picture((GREEN, 60, 60, 10), (GREEN, 160, 60, 9), (GREEN, 260, 60, 3), (GREEN, 100, 180, 20))
    )
    assert sorted((p.x, p.y) for p in patches) == [(60, 60), (160, 60)]
    assert all(MANY_GATE[0] < p.radius < MANY_GATE[1] for p in patches)


def test_A12_a_circle_and_a_name_are_drawn_and_the_radius_is_told(colors):
    tracker = ReportTracker(colors)
    image = picture((BLUE, 100, 100, 11))
    tracker.update(frames(image)[0])
    (patch,) = tracker.patches
    assert patch.label == "Blue"
    assert patch.radius == pytest.approx(13, abs=1.5)  # 11, and two pixels of dilation
    drawn = tracker.drawn(image)
    assert (drawn[100, 100 + int(patch.radius)] != image[100, 100 + int(patch.radius)]).any()
    assert (drawn[90:102, 112:140] != image[90:102, 112:140]).any()  # the name, ten pixels to the right
    assert np.array_equal(image, picture((BLUE, 100, 100, 11)))  # on a copy


def test_A13_the_filter_predicts_in_every_frame_and_corrects_when_the_marker_is_found(colors):
    tracker = ReportTracker(colors)
    seen = [picture((BLUE, 60 + 4 * k, 100, 11)) for k in range(30)]
    for frame in frames(*seen):
        (estimate,) = tracker.update(frame)
        assert estimate.state == "seen"
        assert estimate.position == pytest.approx([60 + 4 * frame.index, 100])
    for k in range(30, 35):
        (estimate,) = tracker.update(Frame(picture(), k, k / 30))
        assert estimate.state == "hidden"
        assert estimate.position == pytest.approx([60 + 4 * k, 100], abs=4)
        assert estimate.unseen == pytest.approx((k - 29) / 30)


def test_A14_a_hidden_marker_has_its_text_and_a_red_cross_however_long_it_lasts(colors):
    tracker = ReportTracker(colors)
    for frame in frames(*[picture((BLUE, 150, 100, 11))] * 20, *[picture()] * 70):
        tracker.update(frame)
    (patch,) = tracker.patches
    assert patch.occluded
    assert patch.label == "Blue P(Ocuido)"
    drawn = tracker.drawn(picture())
    assert (drawn[patch.y, patch.x] == (0, 0, 255)).all()
    assert (drawn[patch.y, patch.x - 9] == (0, 0, 255)).all()
    assert (drawn[patch.y, patch.x - 14] == CARPET).all()  # 20 pixels across
    assert (drawn[patch.y - 8 : patch.y, patch.x + 12 : patch.x + 80] == (0, 0, 255)).all(axis=-1).any()


def test_P4_nothing_of_an_earlier_frame_stays(colors):
    tracker = ReportTracker(colors)
    tracker.update(frames(picture((BLUE, 100, 100, 11), (GREEN, 60, 60, 10)))[0])
    assert {p.color for p in tracker.patches} == {"Blue", "Green"}
    tracker.update(Frame(picture(), 1, 1 / 30))
    assert [(p.color, p.occluded) for p in tracker.patches] == [("Blue", True)]


def test_P5_a_seen_marker_is_reported_raw_and_green_has_no_filter(colors):
    tracker = ReportTracker(colors)
    places = [100, 100, 100, 100, 130]  # a jump that a filter would damp
    for frame, x in zip(
        frames(*[picture((BLUE, x, 100, 11), (GREEN, x, 180, 10)) for x in places]), places, strict=True
    ):
        blue, green = tracker.update(frame)
        assert blue.position == pytest.approx([x, 100])
    assert (blue.velocity != 0).any()
    assert (green.velocity == 0).all()
    hidden = tracker.update(Frame(picture(), 5, 5 / 30))
    assert [estimate.name for estimate in hidden] == ["Blue"]


def test_the_filter_starts_at_the_corner_of_the_image(colors):
    (estimate,) = ReportTracker(colors).update(frames(picture())[0])
    assert estimate.state == "hidden"
    assert (estimate.position == 0).all()


def test_on_the_reports_own_robot_it_is_most_of_a_pixel_off():
    scene = scene_presets.preset("report").but(frames=6)
    renderer = Renderer(scene)
    cuts = {}
    for marker in renderer[0][1].objects[0].markers:
        u, v = np.rint(marker.image).astype(int)
        cuts.setdefault(marker.color, []).append(renderer[0][0].image[v - 7 : v + 8, u - 7 : u + 8])
    tracker = ReportTracker(
        [ReportColor.learn(name, regions, single=name != "green") for name, regions in cuts.items()]
    )
    away = []
    for frame, truth in renderer:
        patches = tracker.find(frame.image)
        for marker in truth.objects[0].markers:
            away.append(
                min(np.hypot(p.x - marker.image[0], p.y - marker.image[1]) for p in patches if p.color == marker.color)
            )
    assert 0.4 < np.sqrt(np.mean(np.square(away))) < 1.3


@pytest.mark.parametrize(("regions", "words"), [
    ([], "at least one region"),
    ([np.zeros((0, 5, 3), np.uint8)], "at least four pixels"),
    ([np.zeros((1, 1, 3), np.uint8)], "at least four pixels"),
    ([np.zeros((5, 5), np.uint8)], "three channels"),
    ([np.full((9, 9, 3), 80, np.uint8)], "flat: their covariance in HSV is singular"),
])  # fmt: skip
def test_regions_that_do_not_suffice_are_refused(regions, words):
    with pytest.raises(VisionError, match=words):
        ReportColor.learn("Blue", regions)


def test_two_colours_of_one_name_are_refused(colors):
    with pytest.raises(VisionError, match="distinct names"):
        ReportTracker([colors[0], colors[0]])


def test_a_patch_that_is_predicted_says_so():
    assert Patch("Red", 1, 2, 0.0, occluded=True).label == "Red P(Ocuido)"
