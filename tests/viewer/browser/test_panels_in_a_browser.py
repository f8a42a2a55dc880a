"""The panels as people use them: in Chromium, with mouse and keys; values are read on the side of Python.

A picture of each state is left in ``build/screenshots``.
"""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

import pieper
from pieper.ik.iteration import iterate
from pieper.model import catalog
from pieper.model.dh import from_dh
from pieper.sim.kinematic import KinematicSimulator
from pieper.viewer.compare_panel import ComparePanel
from pieper.viewer.paths import COLORS, Track
from pieper.viewer.paths_panel import PathsPanel
from pieper.viewer.server import Server
from pieper.viewer.solve_panel import SolvePanel
from pieper.viewer.view import View

SMALL, LARGE = (760, 560), (1400, 860)  # [px]; drawing takes longer the larger
START = [0.1, -1.2, 1.4, -1.7, -1.5, 0.3]
PATIENCE = 60.0  # [s] a busy machine draws slowly in software


@pytest.fixture
def opened(chromium, capfd):
    """Opens a window with panels in a browser, and gives both."""
    made, wrong = [], []

    def open_view(name, *panels, simulated=False, dh=None, size=SMALL, **options):
        arm = pieper.load(name) if dh is None else pieper.Arm(from_dh(catalog.dh_tables(name)[dh]))
        robot = KinematicSimulator(arm.chain) if simulated else None
        view = View(Server(port=0), arm, robot, panels=panels, **options)
        view.start()
        page = chromium.new_page(viewport=dict(zip(("width", "height"), size, strict=True)))
        page.on("pageerror", lambda error: wrong.append(str(error)))
        made.extend([page, view])
        page.goto(view.server.url)
        page.get_by_role("tab", name="Jog").first.wait_for(timeout=1e3 * PATIENCE)
        page.add_style_tag(
            content="[class*=Notifications-root] { display: none }"
        )  # a note about slow drawing is in the way
        if panels:
            page.get_by_role("tab", name=panels[0].title).first.click()
        return view, page

    yield open_view
    for thing in made:
        thing.close()
    assert not wrong
    assert "Traceback" not in capfd.readouterr().err  # viser prints what fails in its threads


def until(met, page=None, patience=PATIENCE):
    """Waits until something holds; the page goes on living meanwhile."""
    end = time.monotonic() + patience
    while not met():
        assert time.monotonic() < end, "waited in vain"
        page.wait_for_timeout(50) if page else time.sleep(0.05)


def type_into(page, label, text):
    box = page.get_by_label(label, exact=True).first
    box.fill(text)
    box.press("Enter")
    page.wait_for_timeout(100)


def type_position(page, panel, **wanted):
    for name, value in wanted.items():
        type_into(page, f"{name} [m]", str(value))
        until(lambda name=name, value=value: panel.position["xyz".index(name)].value == value, page)


def on_screen(view, page, point):
    """Where a point of the world is in the page [px]."""
    camera = next(iter(view.server.get_clients().values())).camera
    size = page.viewport_size
    ahead = camera.look_at - camera.position
    ahead = ahead / np.linalg.norm(ahead)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right = right / np.linalg.norm(right)
    p = np.asarray(point) - camera.position
    scale = 0.5 * size["height"] / np.tan(0.5 * camera.fov) / (p @ ahead)
    return 0.5 * size["width"] + scale * (p @ right), 0.5 * size["height"] - scale * (p @ np.cross(right, ahead))


def grip(view, page, panel):
    """The arrow of the handle along its y axis, and 60 pixels on along it."""
    T = np.asarray(panel.solving.solved.T_base_target)
    arrow, beyond = (T[:3, 3] + share * panel.gizmo.scale * T[:3, 1] for share in (0.8, 1.3))
    x, y = on_screen(view, page, arrow)
    further = np.array(on_screen(view, page, beyond)) - (x, y)
    return (x, y), np.array([x, y]) + 60.0 * further / np.linalg.norm(further)


def test_all_solutions_of_a_ur5e_by_boxes_buttons_and_keys(opened, keep):
    panel = SolvePanel(shown=True)
    view, page = opened("ur5e", panel)
    view.command(START)
    T = view.arm.fk(START)
    until(lambda: page.get_by_text("solution 2 of 8").count() > 0, page)
    keep(page, "solve_ur5e_eight_ghosts")
    seen = {panel.solutions.value}
    for press in (
        lambda: page.get_by_role("button", name="next", exact=True).click(),
        lambda: page.get_by_role("button", name="next", exact=True).click(),
        lambda: (page.mouse.click(200, 450), page.keyboard.press("n")),
    ):
        before = panel.solutions.value
        press()
        until(lambda before=before: panel.solutions.value != before, page)
        seen.add(panel.solutions.value)
        until(lambda: np.allclose(view.arm.fk(view.q), T, atol=1e-9), page)
    assert len(seen) == 4
    page.get_by_role("button", name="previous", exact=True).click()
    until(lambda: panel.solving.solved.chosen == 3, page)
    type_position(page, panel, x=0.45)
    assert panel.gizmo.position[0] == pytest.approx(0.45)
    until(lambda: abs(view.arm.fk(view.q)[0, 3] - 0.45) < 1e-9, page)


def test_an_unreachable_target_is_red_and_what_is_no_number_is_harmless(opened, keep):
    panel = SolvePanel(shown=True)
    view, page = opened("ur5e", panel)
    view.command(START)
    page.get_by_text("solution 2 of 8").first.wait_for(timeout=1e3 * PATIENCE)
    type_position(page, panel, x=0.9, y=0.2, z=0.7)
    until(lambda: page.get_by_text("out of reach by").count() > 0, page)
    assert panel.apart.count == 1
    keep(page, "solve_unreachable")
    np.testing.assert_allclose(view.arm.fk(view.q)[:3, 3], view.arm.fk(START)[:3, 3], atol=1e-9)
    for text in ("NaN", "1e999", "", "-"):
        type_into(page, "y [m]", text)
        page.wait_for_timeout(200)
        assert np.isfinite(panel.solving.solved.T_base_target).all()
    type_position(page, panel, z=0.4, y=0.25, x=0.5)
    until(lambda: np.allclose(view.arm.fk(view.q)[:3, 3], [0.5, 0.25, 0.4], atol=1e-9), page)


def test_the_handle_is_dragged_and_the_browser_closed_in_between(opened):
    panel = SolvePanel(shown=True)
    view, page = opened("ur5e", panel, simulated=True, size=LARGE)
    view.command(START)
    page.get_by_text("solution 2 of 8").first.wait_for(timeout=1e3 * PATIENCE)
    label, before = panel.solutions.value, np.array(panel.gizmo.position)

    def has_dragged():
        """Try once; what is not drawn yet cannot be held."""
        (x, y), further = grip(view, page, panel)
        page.mouse.up()
        page.mouse.move(x, y)
        page.wait_for_timeout(200)
        page.mouse.down()
        for share in np.linspace(0.2, 1.0, 5):
            page.mouse.move(*(np.array([x, y]) + share * (further - (x, y))))
            page.wait_for_timeout(100)
        end = time.monotonic() + 3.0
        while np.linalg.norm(panel.gizmo.position - before) <= 0.02 and time.monotonic() < end:
            page.wait_for_timeout(50)
        return np.linalg.norm(panel.gizmo.position - before) > 0.02

    until(has_dragged, page)
    stopped, stop = threading.Event(), view.control._on_lost
    view.control._on_lost = lambda: (stop(), stopped.set())
    page.close()  # the button is still down
    until(lambda: stopped.is_set() and not view.server.get_clients())
    T = panel.solving.solved.T_base_target
    assert panel.solutions.value == label
    across = view.arm.fk(START)[:3, :3].T @ (T[:3, 3] - before)
    np.testing.assert_allclose(across[[0, 2]], 0.0, atol=1e-6)  # along the arrow that was held
    panel.next()  # the panel is alive, and nobody holds it
    assert panel.solutions.value != label


def test_row_b17_two_models_of_the_kr210(opened, keep):
    """Row B17: both models in one scene, with the difference of forward and inverse kinematics as numbers."""
    other = pieper.Arm(from_dh(catalog.dh_tables("kr210")["report"]))
    panel = ComparePanel(other, names=("URDF", "DH table"))
    view, page = opened("kr210", panel)
    view.command([0.3, 0.2, -0.3, 0.4, 0.5, 0.6])
    page.get_by_role("button", name="Measure").click()
    until(lambda: "mean" in panel.spread.content, page)
    page.get_by_role("button", name="Solve by both").click()
    until(lambda: "reached by both" in panel.solved.content, page)
    page.get_by_text("DH table against URDF").first.wait_for()
    keep(page, "compare_kr210")
    np.testing.assert_allclose(panel.other_view.q, view.q)


def test_row_b17_the_mh12_and_the_screws_of_its_report(opened, keep):
    """Row B17 with M1: the report's constants upon the exact ones."""
    panel = ComparePanel(pieper.load("mh12-report"), beside=False)
    view, page = opened("mh12", panel)
    page.get_by_role("button", name="Measure").click()
    until(lambda: "mean" in panel.spread.content, page)
    page.get_by_role("button", name="Go to the largest").click()
    until(lambda: np.abs(view.q).max() > 0.1, page)
    page.get_by_text("0.4270 mrad").first.wait_for()
    keep(page, "compare_mh12_report")


def test_row_e7_a_path_is_played_and_run_through(opened, keep):
    """Rows E4 to E7: the iterations of a UR5e with two gains, with their traces and curves."""
    arm, tracks = pieper.load("ur5e"), []
    for color, k1 in zip(COLORS, (0.1, 1.0), strict=False):
        start = [-1.28, 4.41, 1.54, -1.16, -1.56, 0.0]
        steps = iterate(arm.chain, [0.5, -0.6, 0.2], start, orientation="hold", k1=k1, position_stop=1e-3)
        tracks.append(Track.from_steps(arm, steps, name=f"k1 = {k1}", color=color))
    panel = PathsPanel(tracks)
    _view, page = opened("ur5e", panel)
    page.get_by_role("button", name="play", exact=True).click()
    until(lambda: panel.player.time > 1.0, page)
    page.get_by_role("button", name="pause", exact=True).click()
    until(lambda: not panel.player.playing, page)
    page.locator("canvas.u-over, .u-over").first.wait_for(state="attached", timeout=1e3 * PATIENCE)
    keep(page, "paths_ur5e")
    page.get_by_role("button", name="to the start", exact=True).click()
    until(lambda: panel.player.time == 0.0, page)
    slider = page.get_by_role("slider").first
    slider.focus()
    page.keyboard.press("ArrowRight")
    until(lambda: panel.player.time > 0.0, page)


def test_row_d7_d10_dh_frames_of_a_youbot(opened, keep):
    """Rows D7 and D10: the frames of the DH rows, with names and axes."""
    view, page = opened("youbot", dh="full", frames=True, axes=False)
    view.arm_view.opacity = 0.4  # or the frames are inside
    view.command(view.limited([2.0, 1.2, -1.4, 1.9, 2.5]))
    until(lambda: view.control.holder is not None, page)
    keep(page, "youbot_dh_frames")
    assert len(view.arm_view._frames) == 2 * len(view.arm.chain.frames)
