"""The window without a browser: who moves the arm, what is told, what is kept."""

from __future__ import annotations

import math
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

import pieper
from pieper.errors import ArrayError, MotionError
from pieper.sim.kinematic import KinematicSimulator
from pieper.viewer.jog import as_json, as_python, home, joint_lines, random_pose, slider_range

pytest.importorskip("viser", reason="the viewer's extra is not installed")

from viser import _messages

from pieper.atomic_file import write_text
from pieper.viewer.arm_view import frame_size
from pieper.viewer.panel import Panel
from pieper.viewer.server import Server
from pieper.viewer.view import View, reach

UR_TYPES = ("ur3", "ur3e", "ur5", "ur5e", "ur10", "ur10e", "ur16e", "ur20")


class Probe(Panel):
    title = "Probe"

    def __init__(self):
        self.seen = []

    def build(self, view):
        self.seen.append("build")
        view.server.gui.add_button("Nothing")

    def on_command(self, q):
        self.seen.append(("command", q.tolist()))

    def on_state(self, state):
        self.seen.append(("state", state.q.tolist()))

    def on_tick(self, dt):
        self.seen.append(("tick", dt))

    def close(self):
        self.seen.append("close")


def scaled(arm, scale):
    """The same arm, `scale` times as large."""
    names = "".join(f'<link name="l{i}"/>' for i in range(arm.dof + 1))
    axes = "".join(
        f'<joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/>'
        f'<origin xyz="0 0 {scale * reach(arm) / arm.dof!r}"/><axis xyz="0 {i % 2} {1 - i % 2}"/>'
        '<limit lower="-2" upper="2" velocity="1" effort="1"/></joint>'
        for i in range(arm.dof)
    )
    return pieper.load(f'<robot name="scaled">{names}{axes}</robot>')


@pytest.fixture
def mh12():
    return pieper.load("mh12")


@pytest.fixture
def view(mh12):
    with View(Server(port=0), mh12, KinematicSimulator(mh12.chain)) as window:
        yield window


def test_motion_is_no_faster_than_the_arm(view, mh12):
    goal = np.array([1.0, 0.5, 0.0, 0.0, 0.0, 0.0])
    view.command(goal)
    before = view.q
    for _ in range(200):
        view.step(0.01)
        assert np.all(np.abs(view.q - before) <= 0.01 * mh12.chain.max_velocity + 1e-12)
        before = view.q
    assert view.q.tolist() == goal.tolist()


def test_a_refusal_of_the_robot_is_told_and_changes_nothing(view):
    view.command([9.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert "outside its limits" in view._word.content
    assert view._word.visible
    assert not view.target.any()
    view.command([0.1, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert not view._word.visible


@pytest.mark.parametrize("wrong", [[math.nan] * 6, [0.0] * 5])
def test_what_is_no_joint_vector_is_refused(view, wrong):
    with pytest.raises(ArrayError):
        view.command(wrong)
    assert not view.target.any()


def test_stopping_stops(view):
    view.command([2.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    view.step(0.1)
    view.stop_motion()
    at = view.robot.read().q.tolist()
    view.step(1.0)
    assert view.q.tolist() == at == view.target.tolist()
    assert 0.0 < at[0] < 2.0


def test_panels_are_told_of_everything(mh12):
    probe = Probe()
    with View(Server(port=0), mh12, panels=[probe]) as view:
        view.command([0.5, 0.0, 0.0, 0.0, 0.0, 0.0])
        view.step(0.02)
        view.step(0.02)
    names = [seen if isinstance(seen, str) else seen[0] for seen in probe.seen]
    assert names == ["build", "command", "state", "tick", "tick", "close"]


def test_a_robot_that_fails_is_told_and_the_window_stays(mh12):
    class Gone(KinematicSimulator):
        broken = False

        def read(self):
            if self.broken:
                raise MotionError("the robot has gone")
            return super().read()

        def stop(self):
            pass

    robot = Gone(mh12.chain)
    with View(Server(port=0), mh12, robot) as view:
        view.start()
        robot.broken = True
        end = time.monotonic() + 20.0
        while "gone" not in view._word.content and time.monotonic() < end:
            time.sleep(0.02)
        assert "the robot has gone" in view._word.content
        robot.broken = False


def test_sliders_follow_what_others_command(view):
    view.command([0.25, 0.0, -0.5, 0.0, 0.0, 0.0])
    assert [slider.value for slider in view.jog.sliders] == [0.25, 0.0, -0.5, 0.0, 0.0, 0.0]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, None, [0.0, math.nan]])
def test_numbers_that_are_none_are_not_taken_from_a_browser(view, value):
    sent = []
    client = SimpleNamespace(message_buffer=SimpleNamespace(push=sent.append))
    view.server._websock_server._client_state_from_id[7] = client
    view.control.holder = 7
    slider = view.jog.sliders[0]
    assert not view.server._admits(7, _messages.GuiUpdateMessage(slider._impl.uuid, {"value": value}))
    assert [message.updates for message in sent] == [{"value": 0.0}]
    assert view.server._admits(7, _messages.GuiUpdateMessage(slider._impl.uuid, {"value": 0.5}))
    bad = _messages.TransformControlsUpdateMessage("/arm", (1.0, 0.0, 0.0, 0.0), (math.nan, 0.0, 0.0))
    assert not view.server._admits(7, bad)
    assert not view.server._admits(7, _messages.TransformControlsUpdateMessage("/arm", (0.0,) * 4, (0.0,) * 3))
    assert len(sent) == 5
    del view.server._websock_server._client_state_from_id[7]


def test_whoever_looks_on_moves_nothing_and_is_shown_what_holds(view):
    sent = []
    view.server._websock_server._client_state_from_id[8] = SimpleNamespace(
        message_buffer=SimpleNamespace(push=sent.append)
    )
    view.control.holder = 7
    message = _messages.GuiUpdateMessage(view.jog.sliders[0]._impl.uuid, {"value": 0.5})
    assert not view.server._admits(8, message)
    assert [message.updates for message in sent] == [{"value": 0.0}]
    del view.server._websock_server._client_state_from_id[8]


@pytest.mark.parametrize("name", UR_TYPES)
def test_E1_every_type_of_ur_opens(name):
    """Row E1: each type is drawn, and its own tip is read off in the window."""
    arm = pieper.load(name)
    q = np.array([-1.28, -1.0, 1.54, -1.16, -1.56, 0.0])
    with View(Server(port=0), arm, KinematicSimulator(arm.chain)) as view:
        view.command(q)
        view.step(10.0)
        text = view.jog._readout.content
        view.jog._show_readout()
        text = view.jog._readout.content
    assert f"{arm.fk(q)[0, 3]:.6f}" in text


def test_E1_no_two_types_of_ur_look_alike():
    q = [-1.28, -1.0, 1.54, -1.16, -1.56, 0.0]
    tips = {tuple(pieper.load(name).fk(q)[:3, 3].round(6)) for name in UR_TYPES}
    assert len(tips) == len(UR_TYPES)


def test_the_page_to_keep_is_whole(view, tmp_path):
    page = tmp_path / "page.html"
    page.write_text("old", encoding="utf-8")
    view.export(page)
    text = page.read_text(encoding="utf-8")
    assert text.rstrip().endswith("</html>")
    assert "__VISER_EMBED_DATA__" in text
    assert view.server.guard.token not in text
    assert list(tmp_path.iterdir()) == [page]


def test_a_file_that_cannot_be_written_leaves_the_old_one(tmp_path, monkeypatch):
    page = tmp_path / "page.html"
    page.write_text("old", encoding="utf-8")
    with pytest.raises(UnicodeEncodeError):
        write_text(page, "half \udcff")
    assert page.read_text(encoding="utf-8") == "old"
    assert list(tmp_path.iterdir()) == [page]


def test_closing_twice_and_from_several_threads_is_once(mh12):
    probe = Probe()
    view = View(Server(port=0), mh12, panels=[probe])
    view.start()
    threads = [threading.Thread(target=view.close) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert probe.seen.count("close") == 1


# --- what the jog panel knows without a browser


@pytest.mark.parametrize("name", ["mh12", "kinova_gen3_7dof", "panda", "ur5e"])
def test_random_poses_and_home_are_within_limits(name):
    arm = pieper.load(name)
    rng = np.random.default_rng(0)
    for q in [home(arm), *(random_pose(arm, rng) for _ in range(50))]:
        assert np.all((q >= arm.limits[:, 0]) & (q <= arm.limits[:, 1]))
        assert np.isfinite(q).all()


def test_joints_without_limits_have_sliders_of_a_turn_each_way():
    arm = pieper.load("kinova_gen3_7dof")
    ends = slider_range(arm)
    free = np.isinf(arm.limits).all(axis=1)
    assert free.any()
    assert np.allclose(ends[free], [-2.0 * math.pi, 2.0 * math.pi])
    assert np.array_equal(ends[~free], arm.limits[~free])


def test_what_is_copied_says_the_same_number_for_number(mh12):
    import json

    q = random_pose(mh12, np.random.default_rng(1))
    names: dict[str, object] = {}
    exec(as_python(mh12, q), names)
    assert names["q"] == q.tolist()
    assert list(json.loads(as_json(mh12, q))["q"].values()) == q.tolist()
    assert [line.split()[0] for line in joint_lines(mh12, q)] == list(mh12.joint_names)


def test_what_happens_after_the_server_has_stopped_is_quiet_and_stops_the_arm(mh12):
    """A browser that goes last brings the arm to rest when there is no page to write into."""
    window = View(Server(port=0), mh12, KinematicSimulator(mh12.chain))
    window.command([0.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    window.step(0.05)
    window.server.stop()
    assert not window.server.is_running
    window.stop_motion()  # warnings are errors here
    assert window.target.tolist() == window.q.tolist()
    window.say("nobody reads it")
    window.step(0.05)
    window.close()
    window.stop_motion()


def test_words_are_shown_as_they_are(view):
    """They name joints and files, which are not to be taken for marks of a page, still less for something to fetch."""
    view.say("![i](http://x.example/i.png) <img src=x onerror=alert(1)> joint_1_s", bad=True)
    assert "![i](http://x.example/i.png) &lt;img src=x onerror=alert(1)&gt; joint_1_s" in view._word.content
    assert "#d63c3c" in view._word.content
    assert type(view._word).__name__ == "GuiHtmlHandle"


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_arms_of_every_scale_are_in_sight(mh12, scale):
    chain = scaled(mh12, scale)
    with View(Server(port=0), chain) as window:
        camera = window.server.initial_camera
        away = float(np.linalg.norm(np.subtract(camera.position, camera.look_at)))
        assert window.size == pytest.approx(scale * reach(mh12))
        assert camera.near < 0.1 * away < 10.0 * away < camera.far
        assert frame_size(chain) == pytest.approx(scale * frame_size(mh12))


def test_the_strokes_of_sliding_joints_count_for_the_reach():
    joints = "".join(
        f'<joint name="j{i}" type="prismatic"><parent link="l{i}"/><child link="l{i + 1}"/><origin xyz="0 0 0.3"/>'
        f'<axis xyz="{axis}"/><limit lower="-2" upper="2" velocity="1" effort="1"/></joint>'
        for i, axis in enumerate(("1 0 0", "0 1 0", "0 0 1"))
    )
    links = "".join(f'<link name="l{i}"/>' for i in range(4))
    assert reach(pieper.load(f'<robot name="gantry">{links}{joints}</robot>')) == pytest.approx(0.9 + 3 * 2.0)
