"""Patterns against exact places, their laws, missing and false markers, scale in pixels, and their YAML."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from pieper.errors import UnknownNameError, VisionError
from pieper.perception.field_view import PixelView
from pieper.perception.lone_marker import lone_markers
from pieper.perception.pattern import BUILT_IN, Pattern, PatternMarker, Patterns, load_patterns
from pieper.perception.pattern_finder import PatternFinder
from tests.perception.pattern_scenes import blobs_of, made, overhead, rotation

ROUNDING = 1e-9  # m, rad: of a projection and back
SSL, VSSS, REPORT = (load_patterns(name) for name in ("ssl", "vsss", "report"))
LENS = (-0.2, 0.05, 0.001, -0.001, 0.0)


def team(patterns, rng, count=10):
    """Robots 350 mm apart, each turned somehow."""
    names = rng.choice([robot.name for robot in patterns.robots], count, replace=False)
    return {
        str(name): (-0.7 + 0.35 * (i % 5) + rng.uniform(-0.03, 0.03), -0.3 + 0.6 * (i // 5), rng.uniform(-np.pi, np.pi))
        for i, name in enumerate(names)
    }


def turned(a, b):
    return abs(float(np.angle(np.exp(1j * (a - b)))))


@pytest.mark.parametrize("patterns", [SSL, VSSS], ids=["ssl", "vsss"])
@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_exact_blobs_give_the_exact_robots_and_the_ball(patterns, seed):
    rng = np.random.default_rng(seed)
    view, poses = overhead(distortion=LENS), team(patterns, rng)
    blobs = blobs_of(view, patterns, poses, ball=(0.1, 0.02))
    *robots, ball = PatternFinder(patterns, view).find(blobs)
    assert {r.name for r in robots} == set(poses)
    for r in robots:
        x, y, heading = poses[r.name]
        np.testing.assert_allclose(r.position, [x, y], atol=ROUNDING)
        assert turned(r.heading, heading) < 1e-7
        assert r.confidence == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_allclose(ball.position, [0.1, 0.02], atol=ROUNDING)
    assert (ball.kind, ball.name, ball.heading) == ("ball", "ball", None)
    taken = [row for s in (*robots, ball) for row in s.blobs]
    assert len(taken) == len(set(taken)) == len(blobs)


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**32 - 1))
@example(371)  # two patches that look like the ball, equally well
def test_the_order_of_blobs_does_not_matter(seed):
    rng = np.random.default_rng(seed)
    view = overhead()
    blobs = blobs_of(view, SSL, team(SSL, rng), noise=0.1, miss=0.1, clutter=8, rng=rng, ball=(0, 0))
    order = rng.permutation(len(blobs))
    one, other = PatternFinder(SSL, view).find(blobs), PatternFinder(SSL, view).find(blobs.select(order))
    assert len(one) == len(other)
    for a in one:
        b = min(other, key=lambda s: np.hypot(*(s.position - a.position)))
        assert (a.kind, a.name) == (b.kind, b.name)
        assert set(a.blobs) == {int(order[row]) for row in b.blobs}
        np.testing.assert_allclose(a.position, b.position, atol=1e-12)


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_fit_is_the_least_squares_fit_and_its_covariance(seed):
    """Against SciPy's Levenberg-Marquardt with the same weights, from blobs that are each known to a different degree."""
    rng = np.random.default_rng(seed)
    view, pose = overhead(), (0.2, -0.1, 2.5)
    blobs = blobs_of(view, SSL, {"blue_3": pose})
    A = rng.normal(size=(5, 2, 2)) * 0.05
    blobs = replace(blobs, covariance=A @ A.transpose(0, 2, 1) + np.eye(2) * 1e-3)
    blobs = replace(
        blobs, centroid=blobs.centroid + np.array([rng.multivariate_normal([0, 0], C) for C in blobs.covariance])
    )
    (robot,) = PatternFinder(SSL, view).find(blobs)
    markers = {robot.name: robot for robot in SSL.robots}["blue_3"].markers
    J = view.jacobian(blobs.centroid, height=0.15)
    C = J @ (blobs.covariance + np.eye(2) * 0.01**2) @ J.transpose(0, 2, 1)
    L = np.linalg.inv(np.linalg.cholesky(C))
    seen = view.to_field(blobs.centroid, height=0.15)
    places = np.array([m.position for m in markers])

    def residual(p):
        return (L @ (seen - p[:2] - places @ rotation(p[2]).T)[..., None]).reshape(-1)

    fit = least_squares(residual, pose, xtol=1e-15, ftol=1e-15, gtol=1e-15)
    np.testing.assert_allclose(
        robot.position, fit.x[:2], atol=1e-6
    )  # second order in residuals of some 0.1 mm over 65 mm
    assert turned(robot.heading, fit.x[2]) < 2e-5
    np.testing.assert_allclose(robot.covariance, np.linalg.inv(fit.jac.T @ fit.jac), rtol=0.02, atol=1e-10)


def test_errors_are_as_large_as_the_covariances_say():
    rng, view, noise, value = np.random.default_rng(3), overhead(), 0.15, []
    poses = team(SSL, rng)
    finder = PatternFinder(SSL, view)
    for _ in range(30):
        for s in finder.find(blobs_of(view, SSL, poses, noise=noise, rng=rng)):
            x, y, heading = poses[s.name]
            e = np.array([*(s.position - (x, y)), np.angle(np.exp(1j * (s.heading - heading)))])
            value.append(e @ np.linalg.solve(s.covariance, e))
    assert len(value) == 300
    assert 2.6 < np.mean(value) < 3.4  # chi-squared of 3 degrees: 3 +- 0.14 one sigma


def test_missing_and_false_markers():
    """A tenth of the markers gone and as many false ones: 97 % of the robots are found, where they are, and none is invented."""
    rng, view, found, false, total = np.random.default_rng(5), overhead(), 0, 0, 0
    finder = PatternFinder(SSL, view)
    for _ in range(30):
        poses = team(SSL, rng)
        blobs = blobs_of(view, SSL, poses, noise=0.1, miss=0.1, clutter=5, rng=rng)
        places = np.array([p[:2] for p in poses.values()])
        total += len(poses)
        for s in finder.find(blobs):
            if s.kind == "robot":
                distance = np.hypot(*(places - s.position).T)
                found += distance.min() < 5e-3
                false += distance.min() > 20e-3
                near = list(poses)[int(distance.argmin())]
                assert s.name in (None, near) or distance.min() > 5e-3
    assert found >= 0.97 * total
    assert false <= 0.005 * total


def test_two_robots_side_by_side_do_not_share_markers():
    view = overhead()
    for gap in (0.180, 0.185, 0.2):
        for heading in np.linspace(-3, 3, 7):
            poses = {"blue_1": (0.0, 0.0, heading), "yellow_4": (gap, 0.0, 1.3 * heading)}
            robots = PatternFinder(SSL, view).find(blobs_of(view, SSL, poses))
            assert {r.name for r in robots} == set(poses)
            assert not set(robots[0].blobs) & set(robots[1].blobs)


def test_one_name_is_given_once_and_what_is_open_stays_open():
    view = overhead()
    blobs = blobs_of(view, SSL, {"blue_3": (0, 0, 0)})
    other = blobs_of(view, SSL, {"blue_3": (0.5, 0, 0)}, noise=0.3, rng=np.random.default_rng(1))
    both = made(blobs.names, [*blobs.color, *other.color], np.concatenate([blobs.centroid, other.centroid]), radius=6.5)
    assert sorted(r.name or "" for r in PatternFinder(SSL, view).find(both)) == ["", "blue_3"]
    front_left = next(i for i in range(5) if i != 0 and blobs.color[i] == blobs.color[1])
    (robot,) = PatternFinder(SSL, view).find(blobs.select([i for i in range(5) if i != front_left]))
    assert robot.name is None
    assert robot.heading == pytest.approx(0.0, abs=1e-6)
    assert robot.confidence == pytest.approx(0.8, abs=1e-3)


def test_a_marker_that_is_half_hidden_counts_little():
    """The pose stays within 1 mm where a plain mean of the centroids would be 4 mm off."""
    view = overhead()
    finder = PatternFinder(REPORT, view)
    whole = blobs_of(view, REPORT, {"robot": (0.1, 0.1, 0.4)})
    for _ in range(5):
        finder.find(whole)
    k = 0
    centroid, area = whole.centroid.copy(), whole.area.copy()
    centroid[k] += [0.5 * whole.radius[k], 0.0]
    area[k] *= 0.5
    (robot,) = finder.find(replace(whole, centroid=centroid, area=area))
    assert np.hypot(*(robot.position - [0.1, 0.1])) < 1e-3
    assert np.sqrt(robot.covariance[0, 0]) < 5e-3


@pytest.mark.parametrize("mm_per_px", [1.5, 3.0, 4.7])
def test_in_pixels_the_scale_is_found(mm_per_px):
    rng, view = np.random.default_rng(2), overhead(mm_per_px)
    poses = {
        name: (0.5 * (x - 0.5) * mm_per_px / 3, 0.5 * (y - 0.5) * mm_per_px / 3, h)
        for name, (x, y, h) in zip(
            ["blue_0", "blue_5", "yellow_7", "yellow_11"],
            [(0, 0, 1.0), (1, 0, -2.0), (0, 1, 3.0), (1, 1, 0.1)],
            strict=True,
        )
    }
    if mm_per_px < 2:  # so near that the robots would touch
        poses = {name: (2 * x, 2 * y, h) for name, (x, y, h) in poses.items()}
    blobs = blobs_of(view, SSL, poses, noise=0.05, rng=rng)
    finder = PatternFinder(SSL, PixelView())
    robots = finder.find(blobs)
    assert {r.name for r in robots} == set(poses)
    assert finder.scale == pytest.approx(1e3 / mm_per_px * 2.4 / (2.4 - 0.15), rel=0.02)
    for r in robots:
        x, y, heading = poses[r.name]
        np.testing.assert_allclose(r.position, view.to_image([x, y], height=0.15), atol=0.3)
        assert turned(r.heading, -heading) < 0.02  # in the image, y goes down


def test_robots_of_one_marker_have_no_heading():
    patterns = Patterns((Pattern("cup", (PatternMarker("red", (0.0, 0.0), 0.1, 0.02),)),))
    view = overhead()
    (cup,) = PatternFinder(patterns, view).find(blobs_of(view, patterns, {"cup": (0.2, 0.3, 1.0)}))
    assert (cup.kind, cup.name, cup.heading) == ("robot", "cup", None)
    np.testing.assert_allclose(cup.position, [0.2, 0.3], atol=ROUNDING)


def test_nothing_gives_nothing():
    assert PatternFinder(SSL, overhead()).find(made(("blue",), [], np.zeros((0, 2)))) == ()
    one = made(tuple(sorted(SSL.colors)), [0], [[100.0, 100.0]])
    assert [s.kind for s in PatternFinder(replace(SSL, ball=None), overhead()).find(one)] == []


def test_lone_markers_are_all_or_the_largest():
    blobs = made(("red", "green"), [0, 0, 1, 1], [[1, 1], [20, 1], [40, 1], [60, 1]], radius=[3, 5, 4, 4])
    seen = lone_markers(blobs, PixelView(), {"red": "largest", "green": "all"})
    assert [(s.kind, s.name, s.position[0]) for s in seen] == [
        ("marker", "red", 20),
        ("marker", "green", 40),
        ("marker", "green", 60),
    ]
    assert lone_markers(blobs, PixelView(), {}) == ()


# --- files


def test_built_in_sets():
    assert set(BUILT_IN) == {"report", "ssl", "vsss", "circles"}
    assert len({tuple(m.color for m in r.markers) for r in SSL.robots}) == 32
    assert len(VSSS.robots) == 20
    for name in BUILT_IN:
        assert load_patterns(name).robots


def test_a_file_of_ones_own(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(
        "robots:\n  - name: a\n    height_mm: 100\n    markers:\n      - {color: red, position_mm: [30, 0], radius_mm: 20}\n"
        "      - {color: blue, position_mm: [-30, 10], height_mm: 50}\nball: {color: orange}\n"
    )
    patterns = load_patterns(path)
    assert patterns.robots[0].markers == (
        PatternMarker("red", (0.03, 0.0), 0.1, 0.02),
        PatternMarker("blue", (-0.03, 0.01), 0.05, 0.0),
    )
    assert patterns.colors == {"red", "blue", "orange"}
    assert patterns.recolored({"red": "pink"}).colors == {"pink", "blue", "orange"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("robots:\n  - name: a\n", r"line 2, robots\[0\].markers: is missing"),
        ("robots:\n  - {name: a, layout: x, colors: [red]}\n", r"line 2, robots\[0\].layout: no layout 'x'"),
        ("robots:\n  - name: a\n    markers: [{position_mm: [0, 0]}]\n", "every marker needs a color"),
        ("robots:\n  - name: a\n    markers: [{color: red, position_mm: [0]}]\n", "position_mm: must be 2 numbers"),
        (
            "robots:\n  - name: a\n    markers: [{color: red, position_mm: [0, 0], radius_mm: -1}]\n",
            "must be at least 0",
        ),
        ("robot: []\n", "no field 'robot'"),
        ("format: other\nball: {color: red}\n", "format: must be 'pieper patterns 1', got 'other'"),
        ("robots: []\n", "there is no ball either"),
        (
            "robots:\n  - &r {name: a, markers: [{color: red, position_mm: [0, 0]}]}\n  - *r\n",
            "anchors and aliases",
        ),
        (
            (
                "robots:\n  - {name: a, markers: [{color: red, position_mm: [0, 0]}]}\n"
                "  - {name: a, markers: [{color: blue, position_mm: [0, 0]}]}\n"
            ),
            "two named a",
        ),
        (
            (
                "robots:\n  - {name: a, markers: [{color: red, position_mm: [0, 0]}]}\n"
                "  - {name: b, markers: [{color: red, position_mm: [0, 0]}]}\n"
            ),
            "look the same",
        ),
    ],
)
def test_malformed_files_are_said_with_line_and_field(tmp_path, text, message):
    path = tmp_path / "patterns.yaml"
    path.write_text(text)
    with pytest.raises(VisionError, match=message) as error:
        load_patterns(path)
    assert str(error.value).startswith(str(path))


def test_unknown_names():
    with pytest.raises(UnknownNameError, match="no pattern set or file 'sll'; did you mean 'ssl'"):
        load_patterns("sll")
    with pytest.raises(UnknownNameError, match="no robot 'blue_77'"):
        SSL.only(["blue_77"])
    with pytest.raises(VisionError, match="mm_per_px must be a positive number"):
        PatternFinder(SSL, PixelView(), mm_per_px=0.0)
