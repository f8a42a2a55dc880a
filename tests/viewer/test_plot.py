"""Figures: what they say, read from their artists, and the files that they are written to."""

import csv
import inspect
import math
import sys
import threading
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pieper
from pieper.errors import ArrayError, MissingExtraError, PieperError, PieperWarning, UnknownNameError
from pieper.ik.iteration import iterate
from pieper.motion.trajectory import Trajectory
from pieper.viewer import plot
from pieper.viewer.compare import Comparison
from pieper.viewer.stance import stance

GOLDEN = Path(__file__).parents[1] / "golden"
START = [-1.28, 4.41, 1.54, -1.16, -1.56, 0.0]
TARGET = np.array([0.50, -0.60, 0.20])
REPLAY = 1e-9  # [m] the iteration replayed elsewhere
AS_DRAWN = 1e-12  # what an artist holds is what was given, up to the factor of a unit
FIGURES = ("path", "joints", "error", "manipulability", "compare")
SIGNATURES = {".png": b"\x89PNG\r\n\x1a\n", ".pdf": b"%PDF-", ".svg": b"<?xml"}


@pytest.fixture(scope="module")
def ur5e():
    return pieper.load("ur5e")


@pytest.fixture(scope="module")
def steps(ur5e):
    """The runs of row E6 by their gain."""
    return {
        k1: list(iterate(ur5e.chain, TARGET, START, orientation="hold", k1=k1, position_stop=1e-3)) for k1 in (0.1, 1.0)
    }


def positions(run):
    return np.array([step.T[:3, 3] for step in run])


def move(arm, scale: float = 1.0) -> Trajectory:
    q = scale * np.outer([0.0, 1.0, -0.5], np.linspace(1.0, 0.2, arm.dof))
    return Trajectory([0.0, 1.0, 2.5], q, dq=np.zeros_like(q), joint_names=arm.joint_names)


def lines(axes) -> dict[str, np.ndarray]:
    """Label and data (m, 2) or (m, 3) of every line with a label."""
    get = (lambda line: line.get_data_3d()) if hasattr(axes, "zaxis") else (lambda line: line.get_data())
    return {
        line.get_label(): np.array(get(line), dtype=float).T
        for line in axes.lines
        if not line.get_label().startswith("_")
    }


def legend(figure) -> list[str]:
    found = figure.legends or [axes.get_legend() for axes in figure.axes if axes.get_legend()]
    return [text.get_text() for one in found for text in one.get_texts()]


# --- path


def test_row_e7_the_path_as_the_course_draws_it(steps):
    with (GOLDEN / "ur5e_path_k1_0.1.csv").open() as file:
        golden = np.array([[float(row[k]) for k in "xyz"] for row in csv.DictReader(file)])
    figure = plot.path(positions(steps[0.1]), target=TARGET)
    (axes,) = figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_zlabel()) == ("x [m]", "y [m]", "z [m]")
    (line,) = [line for line in axes.lines if line.get_label() == "TCP trajectory"]
    assert (line.get_linestyle(), line.get_marker()) == ("-", ".")
    np.testing.assert_allclose(np.array(line.get_data_3d()).T, golden, rtol=0, atol=REPLAY)
    assert legend(figure)[0] == "TCP trajectory"
    straight = lines(axes)["straight line"]
    np.testing.assert_allclose(straight, [golden[0], TARGET], rtol=0, atol=REPLAY)
    assert "largest distance from it: 0.0101 m" in legend(figure)


@pytest.mark.parametrize(("k1", "largest", "digit"), [(0.1, 0.0101, 5e-5), (1.0, 0.327, 5e-4)])
def test_row_e7_distance_from_the_straight_line(steps, k1, largest, digit):
    line = plot.straight_line(positions(steps[k1]), TARGET)
    assert line.largest == pytest.approx(largest, abs=digit)
    farthest = positions(steps[k1])[line.farthest]
    assert np.linalg.norm(farthest - line.foot[line.farthest]) == pytest.approx(line.largest)


def test_several_paths_keep_their_names_and_distances(steps):
    figure = plot.path({"slow": positions(steps[0.1]), "fast": positions(steps[1.0])}, target=TARGET)
    said = legend(figure)
    assert said[:2] == ["slow", "fast"]
    assert {"slow: 0.0101 m from it at most", "fast: 0.327 m from it at most"} < set(said)
    assert said.count("straight line") == 1
    colours = [line.get_color() for line in figure.axes[0].lines if line.get_label() in ("slow", "fast")]
    assert len(set(colours)) == 2


@pytest.mark.parametrize(
    "points", [np.zeros((1, 3)), np.zeros((4, 3)), [[0, 0, 0], [0, 0, 1.0]], np.eye(3) * 1e-9 + 5.0]
)
def test_metres_are_equally_long_along_the_axes(points):
    (axes,) = plot.path(points).axes
    sides = np.array([np.ptp(get()) for get in (axes.get_xlim, axes.get_ylim, axes.get_zlim)])
    np.testing.assert_allclose(axes.get_box_aspect() / sides, (axes.get_box_aspect() / sides)[0], rtol=1e-9)
    assert (sides > 0.0).all()
    for side, column in zip((axes.get_xlim(), axes.get_ylim(), axes.get_zlim()), np.array(points).T, strict=True):
        assert side[0] <= column.min() <= column.max() <= side[1]


def test_poses_are_drawn_as_their_positions(ur5e):
    T = ur5e.fk(move(ur5e).q)
    drawn = lines(plot.path(T).axes[0])["TCP trajectory"]
    np.testing.assert_allclose(drawn, T[:, :3, 3], rtol=0, atol=AS_DRAWN)


@given(
    st.lists(st.tuples(*[st.floats(-10.0, 10.0)] * 3), min_size=1, max_size=8),
    st.tuples(*[st.floats(-10.0, 10.0)] * 3),
)
@settings(max_examples=50)
def test_distances_from_a_line_are_those_of_geometry(points, target):
    line = plot.straight_line(points, target)
    start, end = line.ends
    across = np.asarray(points) - line.foot
    rounding = 1e-7 * (1.0 + np.abs(points).max() + np.abs(target).max()) ** 2  # of a scalar product of such numbers
    assert np.abs(across @ (end - start)).max() <= rounding
    assert (line.distance <= np.linalg.norm(np.asarray(points) - start, axis=1) + rounding).all()


# --- joints


def test_joints_run_between_their_limits(ur5e):
    figure = plot.joints(ur5e, move(ur5e))
    assert len(figure.axes) == 2 * ur5e.dof
    for i, name in enumerate(ur5e.joint_names):
        value, speed = figure.axes[2 * i : 2 * i + 2]
        assert value.get_title(loc="left") == name
        assert value.get_ylabel().endswith("[rad]")
        assert speed.get_ylabel().endswith("[rad/s]")
        drawn = lines(value)
        np.testing.assert_allclose(drawn["points"][:, 1], move(ur5e).q[:, i], rtol=0, atol=AS_DRAWN)
        np.testing.assert_allclose(
            drawn["value"][:, 1], move(ur5e).sample(drawn["value"][:, 0]).q[:, i], rtol=0, atol=AS_DRAWN
        )
        drawn = lines(speed)["value"]
        np.testing.assert_allclose(drawn[:, 1], move(ur5e).sample(drawn[:, 0]).dq[:, i], rtol=0, atol=AS_DRAWN)
        limits = sorted(line.get_ydata()[0] for line in value.lines if line.get_label().startswith("_"))
        np.testing.assert_allclose(limits, ur5e.limits[i], rtol=0, atol=AS_DRAWN)
        limits = sorted(line.get_ydata()[0] for line in speed.lines if line.get_label().startswith("_"))
        np.testing.assert_allclose(limits, [-ur5e.chain.max_velocity[i], ur5e.chain.max_velocity[i]], atol=AS_DRAWN)
        assert len(value.patches) == len(speed.patches) == 2
    assert figure.axes[-1].get_xlabel() == "time $t$ [s]"
    assert not any("value beyond" in text for text in legend(figure))


def test_what_is_beyond_a_limit_is_marked(ur5e):
    figure = plot.joints(ur5e, move(ur5e, 7.0))
    beyond = lines(figure.axes[0])["beyond a limit"][:, 1]
    value = lines(figure.axes[0])["value"][:, 1]
    np.testing.assert_array_equal(np.isfinite(beyond), np.abs(value) > ur5e.limits[0, 1])
    assert "value beyond a limit" in legend(figure)
    lower, upper = figure.axes[0].get_ylim()
    assert lower < value.min() < value.max() < upper


def test_degrees_are_for_joints_that_turn():
    arm = pieper.load("ur5e")
    slide = pieper.load(
        '<robot name="rail"><link name="a"/><link name="b"/><link name="c"/>'
        '<joint name="rail" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="1 0 0"/>'
        '<limit lower="0" upper="2" velocity="0.5" effort="1"/></joint>'
        '<joint name="turn" type="revolute"><parent link="b"/><child link="c"/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>'
    )
    figure = plot.joints(slide, move(slide), degrees=True)
    assert [axes.get_ylabel()[-6:] for axes in figure.axes] == [*["_{1}$ [m]"[-6:], "$ [m/s]"[-6:]], " [deg]", "deg/s]"]
    np.testing.assert_allclose(
        lines(figure.axes[2])["value"], lines(plot.joints(slide, move(slide)).axes[2])["value"] * [1.0, 180.0 / np.pi]
    )
    figure = plot.joints(arm, np.zeros((3, 6)), degrees=True)
    assert len(figure.axes) == 6
    assert figure.axes[-1].get_xlabel() == "iteration"


def test_columns_follow_the_names_of_the_joints(ur5e):
    names = ur5e.joint_names[::-1]
    turned = Trajectory(move(ur5e).t, move(ur5e).q[:, ::-1], dq=np.zeros((3, 6)), joint_names=names)
    drawn = [lines(plot.joints(ur5e, given).axes[0])["value"] for given in (move(ur5e), turned)]
    np.testing.assert_array_equal(*drawn)


def test_lower_velocity_limits_can_be_given(ur5e):
    speed = plot.joints(ur5e, move(ur5e), max_velocity=0.7).axes[1]
    limits = sorted(line.get_ydata()[0] for line in speed.lines if line.get_label().startswith("_"))
    np.testing.assert_allclose(limits, [-0.7, 0.7])


def test_one_point_is_a_motion_too(ur5e):
    one = Trajectory([0.0], np.zeros((1, 6)), joint_names=ur5e.joint_names)
    assert np.isfinite(plot.joints(ur5e, one).axes[0].get_xlim()).all()
    assert len(lines(plot.manipulability(ur5e, one).axes[0])) == 2


# --- error


def test_b13_error_against_iteration_falls_as_the_power_of_the_report():
    arm = pieper.load("mh12-report").chain
    run = list(iterate(arm, [0.3, 0.3, 0.3], np.zeros(5), alpha=0.06, iterations=255))
    (axes,) = plot.error(run, rate=0.94, stop=1e-6).axes
    assert axes.get_yscale() == "log"
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("iteration $k$", "position error [m]")
    drawn = lines(axes)
    assert list(drawn) == ["error", "$0.94^k$", "stop at 1e-06 m"]
    np.testing.assert_allclose(drawn["error"][:, 1], [step.norm for step in run], rtol=1e-12)
    expected = drawn["$0.94^k$"][:, 1]
    np.testing.assert_allclose(drawn["error"][:, 1], expected, rtol=0.1)  # the rule holds to first order in the step
    assert drawn["stop at 1e-06 m"][0, 1] == 1e-6


def test_e6_error_of_the_three_gains(steps):
    figure = plot.error({"k1 = 0.1": steps[0.1], "k1 = 1": steps[1.0]})
    drawn = lines(figure.axes[0])
    assert [len(drawn[label]) - 1 for label in ("k1 = 0.1", "k1 = 1")] == [61, 4]
    assert legend(figure) == ["k1 = 0.1", "k1 = 1"]


def test_metres_and_radians_have_axes_of_their_own(ur5e):
    goal = ur5e.fk(np.add(START, 0.3))
    run = list(iterate(ur5e.chain, goal, START, orientation="reach", k1=0.1, k2=0.1, iterations=60))
    place, turn = plot.error(run).axes
    assert turn.get_ylabel() == "rotation error [rad]"
    np.testing.assert_allclose(lines(place)["error"][:, 1], [np.linalg.norm(s.error[:3]) for s in run])
    np.testing.assert_allclose(lines(turn)["error"][:, 1], [np.linalg.norm(s.error[3:]) for s in run])


def test_a_zero_is_left_out_of_a_logarithmic_axis():
    drawn = lines(plot.error([1.0, 0.1, 0.0]).axes[0])["error"][:, 1]
    assert drawn[:2].tolist() == [1.0, 0.1]
    assert math.isnan(drawn[2])


# --- manipulability


def test_manipulability_is_that_of_the_arm_and_its_least_is_marked(ur5e):
    figure = plot.manipulability(ur5e, move(ur5e))
    top, bottom = (lines(axes) for axes in figure.axes)
    t = top["ur5e"][:, 0]
    w = ur5e.manipulability(move(ur5e).sample(t).q)
    np.testing.assert_allclose(top["ur5e"][:, 1], w, rtol=1e-9, atol=1e-15)
    sigma = np.linalg.svd(ur5e.jacobian(move(ur5e).sample(t).q), compute_uv=False)[:, -1]
    np.testing.assert_allclose(bottom["ur5e"][:, 1], sigma, rtol=1e-9, atol=1e-15)
    least = next(label for label in top if label.startswith("least"))
    drawn = top["ur5e"]
    assert top[least].tolist() == [drawn[np.argmin(drawn[:, 1])].tolist()]
    assert figure.axes[0].get_ylim()[0] == 0.0


# --- two models


@pytest.mark.parametrize("question", ["fk", "ik"])
def test_row_b17_two_models_side_by_side(question):
    report, exact = pieper.load("mh12-report"), pieper.load("mh12")
    figure = plot.compare(report, exact, question=question, samples=25)
    left, right, first, second = figure.axes
    assert left.get_title().startswith("mh12-report\n")
    assert right.get_title().startswith("yaskawa_mh12\n")
    assert (left.get_xlim(), left.get_ylim(), left.get_zlim()) == (right.get_xlim(), right.get_ylim(), right.get_zlim())
    assert set(lines(first)) == set(report.joint_names) == set(legend(figure))
    both = Comparison(report, exact)
    q = stance(report.chain)
    for i, name in enumerate(report.joint_names):
        swept = lines(first)[name]
        sweep = np.repeat(q[None], len(swept), axis=0)
        sweep[:, i] = swept[:, 0]
        np.testing.assert_allclose(swept[:, 1], 1e3 * both.difference(sweep).distance, rtol=1e-9)
        np.testing.assert_allclose(swept[[0, -1], 0], both.limits[i])
    units = {"fk": ("[mm]", "[mrad]"), "ik": ("[mm]", "[mrad]")}[question]
    assert first.get_ylabel().endswith(units[0])
    assert second.get_ylabel().endswith(units[1])


def test_row_b17_figure_2_the_pose_of_the_report():
    # Figure 2 of the report: x=-1.028302 y=0.050718 z=1.086594 at these joint values
    q = [-0.049253, -1.282161, 0.975023, 0.320916, -2.363734]
    figure = plot.compare(pieper.load("mh12-report"), pieper.load("mh12"), q=q, samples=5)
    name, place, turn = figure.axes[0].get_title().split("\n")
    assert place == "x=-1.028302  y=0.050718  z=1.086594 m"
    assert turn == "q=(-0.169987, -0.064662, 0.900415, 0.395191)"
    assert name == "mh12-report"
    x, y, z = (float(word.split("=")[1]) for word in figure.axes[1].get_title().split("\n")[1][:-2].split())
    assert (
        1e-5 < math.dist((x, y, z), (-1.028302, 0.050718, 1.086594)) < 1e-3
    )  # the constants of the report are off so much


def test_row_b17_ik_answers_reach_the_same_pose():
    report, exact = pieper.load("mh12-report"), pieper.load("mh12")
    figure = plot.compare(report, exact, question="ik", samples=25)
    both = Comparison(report, exact)
    q = stance(report.chain)
    answer = np.array([float(word) for word in figure.axes[1].get_title().split("(")[1].split(")")[0].split(",")])
    apart = both.other.fk(answer)[:3, 3] - report.fk(q)[:3, 3]
    assert np.linalg.norm(apart) < 3e-4  # four decimals of a radian, on an arm of 2 m
    differences = lines(figure.axes[3])["joint_1_s"][:, 1]
    assert 0.1 < differences.max() < 10.0  # mrad, as far as the constants are off


def test_equal_models_do_not_differ(ur5e):
    figure = plot.compare(ur5e, pieper.load("ur5e"), samples=9)
    for axes in figure.axes[2:]:
        assert all(np.abs(data[:, 1]).max() < 1e-6 for data in lines(axes).values())
        assert axes.get_ylim() == (0.0, 1.0)


def test_what_the_other_cannot_reach_is_told():
    stretched = [0, -0.4, 0.3, 0.2, 1.0, 0]
    with pytest.warns(PieperWarning, match="ur5e and ur3e do not look like models of one arm"):
        figure = plot.compare(pieper.load("ur5e"), pieper.load("ur3e"), question="ik", q=stretched, samples=9)
    assert "out of reach of ur3e: " in figure.axes[3].get_title()
    assert figure.axes[1].get_title() == "ur3e\nno answer"


# --- looks


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_themes_keep_text_readable(ur5e, theme):
    from matplotlib.colors import to_rgb

    for figure in (plot.path(np.eye(3), theme=theme), plot.joints(ur5e, move(ur5e), theme=theme)):
        paper = np.mean(to_rgb(figure.get_facecolor()))
        for axes in figure.axes:
            assert abs(np.mean(to_rgb(axes.xaxis.label.get_color())) - paper) > 0.6
            for line in axes.lines:
                assert np.abs(np.subtract(to_rgb(line.get_color()), to_rgb(figure.get_facecolor()))).max() > 0.3


def test_no_figure_touches_a_global_setting(ur5e):
    before = dict(mpl.rcParams)
    figures = [
        plot.path(np.eye(3)),
        plot.joints(ur5e, move(ur5e)),
        plot.error([1.0, 0.5]),
        plot.manipulability(ur5e, move(ur5e)),
    ]
    assert dict(mpl.rcParams) == before
    from matplotlib import pyplot as plt

    assert plt.get_fignums() == []
    assert len(figures) == 4


def test_figures_are_made_in_any_thread(ur5e, tmp_path):
    made = []

    def draw(number: int) -> None:
        made.append(plot.save(plot.joints(ur5e, move(ur5e, number)), tmp_path / f"{number}.png", dpi=40))

    threads = [threading.Thread(target=draw, args=(number,)) for number in range(1, 4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(path.name for path in made) == ["1.png", "2.png", "3.png"]


def test_every_figure_has_a_title_and_a_theme():
    for name in FIGURES:
        assert {"title", "theme"} < set(inspect.signature(getattr(plot, name)).parameters)


# --- files


@pytest.mark.parametrize("suffix", plot.FORMATS)
def test_files_are_what_their_suffix_says(tmp_path, suffix):
    figure = plot.path(np.eye(3), title="A title")
    file = plot.save(figure, tmp_path / f"path{suffix}")
    assert file.read_bytes().startswith(SIGNATURES[suffix])
    if suffix == ".png":
        from matplotlib.image import imread

        pixels = imread(file)
        assert pixels.shape[:2] == tuple(round(200 * side) for side in figure.get_size_inches()[::-1])
        assert len(np.unique(pixels.reshape(-1, pixels.shape[2]), axis=0)) > 10
    if suffix == ".svg":
        from xml.etree import ElementTree as ET

        assert ET.parse(file).getroot().tag.endswith("svg")
    assert [path.name for path in tmp_path.iterdir()] == [file.name]


def test_a_failed_write_leaves_what_was_there(tmp_path, monkeypatch):
    file = tmp_path / "figure.png"
    file.write_bytes(b"before")
    figure = plot.path(np.eye(3))
    monkeypatch.setattr(
        figure, "savefig", lambda *_, **__: (_ for _ in ()).throw(OSError(28, "No space left on device"))
    )
    with pytest.raises(OSError, match="No space left"):
        plot.save(figure, file)
    assert file.read_bytes() == b"before"
    assert [path.name for path in tmp_path.iterdir()] == ["figure.png"]


def test_a_file_that_cannot_be_is_refused(tmp_path):
    figure = plot.path(np.eye(3))
    with pytest.raises(PieperError, match=r"written as \.png, \.pdf or \.svg, by the suffix"):
        plot.save(figure, tmp_path / "figure.jpg")
    with pytest.raises(FileNotFoundError, match="no such folder"):
        plot.save(figure, tmp_path / "nowhere" / "figure.png")
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(IsADirectoryError, match="is a folder"):
        plot.save(figure, tmp_path / "folder.png")


def test_without_a_screen_a_window_is_refused(monkeypatch):
    monkeypatch.setenv("MPLBACKEND", "Agg")
    mpl.use("Agg")
    with pytest.raises(PieperError, match="no screen to show a figure on; write it to a file"):
        plot.show(plot.path(np.eye(3)))


def test_show_gives_a_figure_a_window(monkeypatch):
    from matplotlib import pyplot as plt

    mpl.use("Agg")
    shown = []
    monkeypatch.setattr(plot, "need_screen", lambda: None)
    monkeypatch.setattr(plt, "show", lambda **options: shown.append(options))
    figure = plot.path(np.eye(3))
    plot.show(figure)
    try:
        assert figure.canvas.manager is not None
        assert figure.canvas.manager.canvas.figure is figure
        assert shown == [{"block": True}]
    finally:
        plt.close("all")


# --- bad input


@pytest.mark.parametrize(
    ("points", "complaint"),
    [
        ([], r"points of 'TCP trajectory' must have shape"),
        (np.empty((0, 3)), "at least one row"),
        ([1.0, 2.0, 3.0], r"shape \(m, 3\) or \(m, 4, 4\)"),
        (np.zeros((5, 2)), r"shape \(..., 3\), got \(5, 2\)"),
        (np.zeros((2, 3, 3)), r"shape \(..., 4, 4\), got \(2, 3, 3\)"),
        ([[0.0, 0.0, math.nan]], "must be finite, got nan"),
        ([["a", "b", "c"]], "real numbers"),
        ({}, "at least one path"),
        ({"a": [[0.0, 0.0, math.inf]]}, "points of 'a' must be finite"),
    ],
)
def test_paths_that_are_none(points, complaint):
    with pytest.raises(ArrayError, match=complaint):
        plot.path(points)


def test_motions_that_are_none(ur5e):
    with pytest.raises(ArrayError, match=r"at least one row, got \(0, 6\)"):
        plot.joints(ur5e, np.empty((0, 6)))
    with pytest.raises(ArrayError, match="6"):
        plot.joints(ur5e, np.zeros((4, 5)))
    with pytest.raises(ArrayError, match=r"got \(6,\)"):
        plot.joints(ur5e, np.zeros(6))
    with pytest.raises(ArrayError, match="finite"):
        plot.manipulability(ur5e, np.full((2, 6), math.nan))
    with pytest.raises(UnknownNameError, match="no joint 'elbw'"):
        plot.joints(ur5e, Trajectory([0.0], np.zeros((1, 6)), joint_names=("elbw", *ur5e.joint_names[1:])))
    with pytest.raises(ArrayError, match="max_velocity must be above 0"):
        plot.joints(ur5e, move(ur5e), max_velocity=0.0)
    with pytest.raises(ArrayError, match="one runs over time"):
        plot.manipulability(ur5e, {"a": move(ur5e), "b": np.zeros((2, 6))})
    with pytest.raises(ArrayError, match="at least one path"):
        plot.manipulability(ur5e, {})


@pytest.mark.parametrize(
    ("steps", "options", "complaint"),
    [
        ([], {}, "at least one"),
        ({}, {}, "at least one run"),
        ([1.0, math.nan], {}, "finite"),
        ([1.0, -0.5], {}, "at least 0 m, got -0.5"),
        ([[1.0]], {}, r"got \(1, 1\)"),
        ([1.0], {"rate": 0.0}, "rate must be a positive number"),
        ([1.0], {"stop": math.nan}, "stop must be a positive number"),
        ([1.0], {"theme": "pink"}, "theme must be 'light' or 'dark', got 'pink'"),
    ],
)
def test_errors_that_are_none(steps, options, complaint):
    with pytest.raises(ArrayError, match=complaint):
        plot.error(steps, **options)


def test_comparisons_that_are_none(ur5e):
    with pytest.raises(ArrayError, match="question must be 'fk' or 'ik', got 'id'"):
        plot.compare(ur5e, ur5e, question="id")
    with pytest.raises(ArrayError, match="samples must be at least 2, got 1"):
        plot.compare(ur5e, ur5e, samples=1)
    with pytest.raises(ArrayError, match=r"shape \(6,\), got \(2, 6\)"):
        plot.compare(ur5e, ur5e, q=np.zeros((2, 6)))
    with pytest.raises(ArrayError, match="no joint name in common"):
        plot.compare(ur5e, pieper.load("panda"))
    with pytest.raises(ArrayError, match="finite"):
        plot.straight_line([[0, 0, 0]], [0, 0, math.inf])
    with pytest.raises(ArrayError, match=r"target must have shape \(3,\), got \(1, 3\)"):
        plot.straight_line([[0, 0, 0]], [[0, 0, 1]])


def test_without_matplotlib_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(
        MissingExtraError, match=r"matplotlib is not installed; a figure needs it: pip install 'pieper\[plot\]'"
    ):
        plot.path(np.eye(3))
