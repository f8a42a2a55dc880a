"""The panels in a window that no browser looks at: what is typed is written into the boxes, what is dragged into the handle."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import pieper
from pieper.errors import ArrayError
from pieper.ik.iteration import iterate
from pieper.motion.trajectory import Trajectory

pytest.importorskip("viser", reason="the panels need the extra 'viewer'")

from pieper.viewer.compare_panel import ComparePanel
from pieper.viewer.paths import COLORS, Track
from pieper.viewer.paths_panel import PathsPanel
from pieper.viewer.server import Server
from pieper.viewer.solve_panel import AMBER, RED, SolvePanel
from pieper.viewer.view import View

START = [0.1, -1.2, 1.4, -1.7, -1.5, 0.3]
Q_START = [-1.28, 4.41, 1.54, -1.16, -1.56, 0.0]
NAN = float("nan")
TYPED = 1e-9  # [m and rad] nothing is rounded between a box and the arm


@pytest.fixture
def opened():
    made = []

    def open_view(name, *panels, q=None):
        view = View(Server(port=0), pieper.load(name), panels=panels)
        made.append(view)
        if q is not None:
            view.command(q)
            view.step(0.03)
        return view

    yield open_view
    for view in made:
        view.close()


def drag(panel, position, wxyz=None, phase="update"):
    panel.gizmo.position = position
    if wxyz is not None:
        panel.gizmo.wxyz = wxyz
    panel._on_drag(SimpleNamespace(phase=phase))


def fill(boxes, numbers):
    for box, number in zip(boxes, numbers, strict=True):
        box.value = number


def values(boxes):
    return tuple(box.value for box in boxes)


# --- drag to solve


def test_the_ghosts_are_the_solutions_that_are_not_taken(opened):
    panel = SolvePanel(shown=True)
    opened("ur5e", panel, q=START)
    assert panel.ghosts.count == 7
    assert panel.apart.count == 0
    assert len(panel.solutions.options) == 8
    assert panel.solutions.value.startswith("2  front, elbow up, flip")
    assert "solution 2 of 8: front, elbow up, flip" in panel.message.content
    assert "inherit" in panel.message.content


def test_a_drag_moves_the_arm_on_its_branch_and_the_boxes(opened):
    panel = SolvePanel(shown=True)
    view = opened("ur5e", panel, q=START)
    p, label = view.arm.fk(START)[:3, 3], panel.solutions.value
    drag(panel, p, phase="start")
    for k in range(1, 6):
        drag(panel, p + 0.01 * k * np.array([-1.0, 0.5, 0.2]))
        view.step(0.03)
        np.testing.assert_allclose(view.arm.fk(view.q)[:3, 3], panel.gizmo.position, atol=1e-9)
        np.testing.assert_allclose(values(panel.position), panel.gizmo.position, atol=TYPED)
    drag(panel, panel.gizmo.position, phase="end")
    assert panel.solutions.value == label


def test_typed_numbers_put_the_handle(opened):
    panel = SolvePanel(shown=True)
    view = opened("ur5e", panel, q=START)
    T = view.arm.fk([0.3, -1.0, 1.2, -1.5, -1.4, 0.1])
    from pieper.spatial import rotation

    fill(panel.position, tuple(T[:3, 3].tolist()))
    fill(panel.rpy, tuple(np.degrees(rotation.as_rpy(T[:3, :3])).tolist()))
    view.step(0.03)
    np.testing.assert_allclose(view.arm.fk(view.q), T, atol=TYPED)
    np.testing.assert_allclose(panel.gizmo.position, T[:3, 3], atol=TYPED)


def test_every_branch_by_buttons_list_and_keys(opened):
    panel = SolvePanel(shown=True)
    view = opened("ur5e", panel, q=START)
    T, seen = view.arm.fk(START), []
    for _ in range(8):
        panel.next()
        view.step(0.03)
        np.testing.assert_allclose(view.arm.fk(view.q), T, atol=1e-9)
        seen.append(panel.solutions.value)
    assert len(set(seen)) == 8
    panel.previous()
    assert panel.solutions.value == seen[-2]
    panel.solutions.value = panel.solutions.options[4]
    assert panel.solving.solved.chosen == 4


def test_out_of_reach_is_red_with_the_nearest_pose_and_the_arm_stays(opened):
    panel = SolvePanel(shown=True)
    view = opened("ur5e", panel, q=START)
    fill(panel.position, (2.0, 0.0, 0.3))
    view.step(0.03)
    np.testing.assert_allclose(view.q, START, atol=1e-9)
    assert panel.apart.count == 1
    assert panel.ghosts.count == 0
    assert panel._gap.visible
    assert "out of reach by 1.04 m" in panel.message.content
    assert "#d63c3c" in panel.message.content
    assert tuple(panel.apart._parts[0][1].batched_colors[0]) == RED
    fill(panel.position, tuple(view.arm.fk(START)[:3, 3].tolist()))
    assert panel.apart.count == 0
    assert not panel._gap.visible
    assert panel.ghosts.count == 7


def test_a_solution_outside_limits_is_amber_and_the_arm_is_not_sent_there(opened):
    panel = SolvePanel(shown=True)
    view = opened("mh12", panel)
    q = [1.8, 0.8, -0.3, -0.5, 1.5, 1.6]
    view.command(q)
    outside = [k for k, inside in enumerate(panel.solving.solved.inside) if not inside]
    assert outside  # four of its eight
    panel.solutions.value = panel.solutions.options[outside[0]]
    view.step(0.03)
    np.testing.assert_allclose(view.q, q, atol=1e-9)
    assert tuple(panel.apart._parts[0][1].batched_colors[0]) == AMBER
    assert "(outside limits)" in panel.solutions.value
    assert "outside the joint limits" in panel.message.content


def test_nan_is_told_and_put_back(opened):
    panel = SolvePanel(shown=True)
    view = opened("ur5e", panel, q=START)
    before = values(panel.position), values(panel.rpy), tuple(panel.gizmo.position)
    panel.position[0].value = NAN
    assert "three finite numbers" in panel.message.content
    assert values(panel.position) == before[0]
    panel.rpy[1].value = float("inf")
    assert "three finite angles" in panel.message.content
    np.testing.assert_allclose(values(panel.rpy), before[1], atol=1e-9)
    drag(panel, np.array([NAN, 0.0, 0.0]))
    np.testing.assert_allclose(panel.gizmo.position, before[2], atol=1e-12)
    drag(panel, np.array(before[2]), wxyz=np.zeros(4))
    assert np.linalg.norm(panel.gizmo.wxyz) == pytest.approx(1.0)
    view.step(0.03)
    np.testing.assert_allclose(view.q, START, atol=1e-9)


def test_a_drag_without_an_end_does_no_harm(opened):
    """The browser is closed in mid-drag: no end is told."""
    panel = SolvePanel(shown=True, kind="position")
    view = opened("ur5e", panel, q=START)
    p = view.arm.fk(START)[:3, 3]
    drag(panel, p, phase="start")
    drag(panel, p + 0.02)
    panel.next()
    view.command(START)
    view.step(0.03)
    np.testing.assert_allclose(panel.gizmo.position, p, atol=1e-9)
    np.testing.assert_allclose(view.q, START, atol=1e-9)


def test_what_other_panels_do_moves_the_target(opened):
    panel = SolvePanel()
    view = opened("ur5e", panel, q=START)
    q = [0.5, -1.0, 1.0, -1.2, -1.0, 0.0]
    view.command(q)
    np.testing.assert_allclose(panel.gizmo.position, view.arm.fk(q)[:3, 3], atol=1e-9)
    assert not panel._root.visible
    panel.shown.value = True
    assert panel._root.visible
    assert panel.ghosts.count == len(panel.solving.solved.ghosts) > 0


def test_kinds_of_targets(opened):
    panel = SolvePanel(shown=True)
    view = opened("ur5e", panel, q=START)
    panel.kind.value = "position only"
    assert panel.solving.kind == "position"
    assert panel.gizmo.disable_rotations
    assert not any(box.visible for box in panel.rpy)
    assert panel.ghosts.count == 15
    panel.kind.value = "position and tool x"
    assert (panel.solving.kind, panel.solving.axis) == ("axis", "x")
    assert not panel.gizmo.disable_rotations
    np.testing.assert_allclose(view.target, START, atol=1e-6)


def test_seven_joints_slide_while_the_tip_stays(opened):
    panel = SolvePanel(shown=True)
    view = opened("panda", panel, q=[0.4, -0.3, 0.1, -2.1, 0.2, 1.9, 0.5])
    assert panel.along.visible
    assert not panel.along.disabled
    T, places = view.arm.fk(view.q), []
    for value in (0, 300, 700, 1000):
        panel.along.value = value
        view.step(0.03)
        np.testing.assert_allclose(view.arm.fk(view.q), T, atol=1e-8)
        places.append(view.q)
    assert np.ptp(places, axis=0).max() > 0.2


def test_six_joints_at_a_pose_have_no_self_motion(opened):
    panel = SolvePanel(shown=True)
    opened("ur5e", panel, q=START)
    assert not panel.along.visible


# --- two models


def test_row_b17_the_difference_of_two_models_is_live(opened):
    """Row B17: the models of the MH12 in one scene, with the difference in mm and mrad."""
    panel = ComparePanel(pieper.load("mh12-report"))
    view = opened("mh12", panel, q=[0.0] * 6)
    at_zero = panel.live.content
    view.command([0.3, 0.2, -0.1, 0.0, 0.5, 0.4])
    view.step(0.03)
    assert panel.live.content != at_zero
    found = panel.comparison.difference(view.q)
    assert f"{1e3 * float(found.distance):.4f} mm" in panel.live.content
    assert f"{1e3 * float(found.angle):.4f} mrad" in panel.live.content
    np.testing.assert_allclose(panel.other_view.q, panel.comparison.as_other(view.q))
    assert "joint_5_b_inverted = -joint_5_b" in panel.rules.content
    assert panel._gap.visible
    assert "drawn " in panel._gap_label.text


def test_the_largest_difference_is_measured_and_gone_to(opened):
    panel = ComparePanel(pieper.load("mh12-report"))
    view = opened("mh12", panel, q=[0.0] * 6)
    assert panel.go.disabled
    panel.samples.value = 5000
    panel.measure()
    assert "0.2" in panel.spread.content
    assert "5000" in panel.spread.content
    assert not panel.go.disabled
    panel._go_to_worst()
    view.step(0.03)
    assert f"{1e3 * float(panel.comparison.difference(view.q).distance):.4f} mm" in panel.spread.content
    assert panel.live.content.count("mm") == 4


def test_both_solve_the_same_pose(opened):
    panel = ComparePanel(pieper.load("mh12-report"), beside=False)
    opened("mh12", panel, q=[0.3, 0.2, -0.1, 0.0, 0.5, 0.4])
    panel.solve_both()
    assert "joint_2_l" in panel.solved.content
    assert "tip off by" in panel.solved.content
    panel.placing.value = "side by side"
    assert np.linalg.norm(panel.other_view._root.position) > 0.5


def test_equal_models_draw_no_gap(opened):
    panel = ComparePanel(pieper.load("kr210"))
    opened("kr210", panel)
    assert not panel._gap.visible
    assert "0.0000 mm" in panel.live.content


# --- motions


def tracks():
    arm = pieper.load("ur5e")
    made = []
    for number, k1 in enumerate((0.1, 1.0)):
        steps = iterate(arm.chain, [0.5, -0.6, 0.2], Q_START, orientation="hold", k1=k1, position_stop=1e-3)
        made.append(Track.from_steps(arm, steps, name=f"k1 = {k1}", color=COLORS[number]))
    return made


def test_motions_play_pause_and_begin_again(opened):
    panel = PathsPanel(tracks(), playing=True)
    view = opened("ur5e", panel)
    assert not view.arm_view.visible
    for _ in range(10):
        view.step(0.1)
    assert panel.player.time == pytest.approx(1.0)
    assert panel.time.value == pytest.approx(1.0)
    for arm_view, track in zip(panel.arm_views, panel.player.tracks, strict=True):
        np.testing.assert_allclose(arm_view.q, track.at(1.0), atol=1e-9)
    panel.player.pause()
    view.step(0.1)
    assert panel.player.time == pytest.approx(1.0)
    panel.time.value = 6.1
    for arm_view in panel.arm_views:
        np.testing.assert_allclose(arm_view.arm.fk(arm_view.q)[:3, 3], [0.5, -0.6, 0.2], atol=1e-3)
    panel.time.value = NAN
    assert panel.player.time == pytest.approx(6.1)


def test_the_arm_comes_back_when_it_is_moved(opened):
    panel = PathsPanel(tracks())
    view = opened("ur5e", panel)
    panel.time.value = 3.0
    assert not view.arm_view.visible
    panel._sent()
    view.step(0.03)
    assert view.arm_view.visible
    np.testing.assert_allclose(view.q, panel.player.tracks[0].at(3.0), atol=1e-9)


def test_curves_of_each_motion_and_the_mark_of_the_time(opened):
    panel = PathsPanel(tracks())
    opened("ur5e", panel)
    assert len(panel.plot.data) == 1 + 6 + 1
    assert panel.curves.options == ("joints", "tip", "error")
    panel.seek(3.0)
    mark = panel.plot.data[-1]
    here = int(np.flatnonzero(np.isfinite(mark))[0])
    assert panel.plot.data[0][here] == pytest.approx(3.0, abs=0.02)
    assert mark[here] == panel.plot.data[1][here]
    panel.curves.value = "error"
    assert panel.plot.scales["y"]["distr"] == 3
    assert len(panel.plot.data[0]) == 62
    panel.plotted.value = "k1 = 1.0"
    assert len(panel.plot.data[0]) == 5
    panel.curves.value = "tip"
    assert [one.get("label") for one in panel.plot.series] == ["t [s]", "x", "y", "z", "now"]


def test_a_motion_can_be_hidden(opened):
    panel = PathsPanel(tracks())
    opened("ur5e", panel)
    panel.shown[1].value = False
    assert [arm_view.visible for arm_view in panel.arm_views] == [True, False]
    assert [all(node.visible for node in nodes) for nodes in panel._traces] == [True, False]


def test_speed_that_makes_no_sense_is_told_and_put_back(opened):
    panel = PathsPanel(tracks())
    view = opened("ur5e", panel)
    panel.speed.value = 2.0
    assert panel.player.speed == 2.0
    for wrong in (NAN, -1.0, 1e9):
        panel.speed.value = wrong
        assert panel.player.speed == 2.0
        assert panel.speed.value == 2.0
        assert "speed must be from 0.01 to 100" in view._word.content


def test_one_point_and_no_motion(opened):
    arm = pieper.load("ur5e")
    panel = PathsPanel([Track.of(arm, Trajectory([0.0], [START]))], playing=True)
    view = opened("ur5e", panel)
    view.step(0.1)
    np.testing.assert_allclose(panel.arm_views[0].q, START)
    with pytest.raises(ArrayError, match="at least one motion"):
        PathsPanel([])


def test_all_panels_together(opened):
    panels = SolvePanel(shown=True), ComparePanel(pieper.load("ur5")), PathsPanel(tracks(), playing=True)
    view = opened("ur5e", *panels, q=START)
    for _ in range(5):
        view.step(0.03)
    fill(panels[0].position, (0.4, 0.2, 0.4))
    view.step(0.03)
    np.testing.assert_allclose(view.arm.fk(view.q)[:3, 3], [0.4, 0.2, 0.4], atol=1e-9)
    np.testing.assert_allclose(panels[1].other_view.q, view.q)
