"""The window as people use it, in Chromium; values are read on the side of Python."""

from __future__ import annotations

import json

import numpy as np

from pieper.viewer import control
from pieper.viewer.control import TAKE_OVER

HERE = "You control the arm"


def slider(page, joint):
    return page.get_by_role("slider").nth(joint)


def box(page, joint):
    return page.locator("input.mantine-NumberInput-input").nth(joint)


def enter(page, joint, text):
    """Type into a number box, key by key as people do."""
    box(page, joint).click()
    page.keyboard.press("Control+A")
    page.keyboard.type(text)
    page.keyboard.press("Enter")


def press(page, name):
    page.get_by_role("button", name=name, exact=True).or_(page.get_by_text(name, exact=True)).first.click()


class TestJogging:
    """In one page, with the arm at home before each."""

    def test_sliders_move_by_keys(self, mh12, jogged, until):
        view, page = jogged
        slider(page, 1).focus()
        for _ in range(20):
            page.keyboard.press("ArrowRight")
        until(
            page, lambda: abs(view.q[1] - 0.02) < 1.1e-3
        )  # twenty steps of a milliradian, on the grid that begins at the limit
        assert np.all(view.target[[0, 2, 3, 4, 5]] == 0.0)

    def test_a_typed_value_is_taken_exactly(self, mh12, jogged, until, keep):
        view, page = jogged
        enter(page, 0, "-0.912345678")
        until(page, lambda: view.q[0] == -0.912345678)
        T = mh12.fk(view.q)
        until(page, lambda: f"{T[0, 3]:.6f}" in page.locator("pre").first.inner_text())
        keep(page, "mh12_jog")

    def test_values_beyond_the_limits_stay_at_the_limit(self, mh12, jogged, until):
        view, page = jogged
        enter(page, 0, "9")
        until(page, lambda: view.target[0] == mh12.limits[0, 1])
        until(page, lambda: abs(float(box(page, 0).input_value()) - mh12.limits[0, 1]) < 1e-8)

    def test_what_is_not_a_number_moves_nothing(self, jogged):
        view, page = jogged
        for nonsense in ("NaN", "abc", "-", "1e", "--1", ""):
            box(page, 0).click()
            page.keyboard.press("Control+A")
            page.keyboard.press("Delete")
            page.keyboard.type(nonsense)
            page.keyboard.press("Enter")
            page.wait_for_timeout(100)
            assert view.target[0] in (0.0, 1.0, -1.0)  # the box of the browser keeps what digits there are
            assert np.all(view.target[1:] == 0.0)

    def test_home_random_stop_and_frames(self, mh12, jogged, until):
        view, page = jogged
        press(page, "Random")
        until(page, lambda: view.target.any())
        goal = view.target
        assert np.all((goal >= mh12.limits[:, 0]) & (goal <= mh12.limits[:, 1]))
        until(page, lambda: np.allclose(view.q, goal, rtol=0.0, atol=1e-12))
        press(page, "Home")
        until(page, lambda: not view.q.any())
        page.get_by_label("Frame", exact=True).first.click()
        page.get_by_role("option", name="link_3_u").click()
        at = mh12.fk(view.q, up_to="link_3_u")[:3, 3]
        until(page, lambda: f"{at[2]:.6f}" in page.locator("pre").first.inner_text())

    def test_copying_gives_python_and_json(self, mh12, jogged, until):
        view, page = jogged
        view.command([0.25, 0.0, 0.0, 0.0, 0.5, 0.0])
        until(page, lambda: view.q[0] == 0.25)
        until(page, lambda: "0.250000" in page.locator("pre").first.inner_text())
        page.get_by_role("button", name="Copy as Python").click()
        names: dict[str, object] = {}
        exec(page.evaluate("navigator.clipboard.readText()"), names)
        assert names["q"] == view.q.tolist()
        page.get_by_role("button", name="Copy as JSON").click()
        copied = json.loads(page.evaluate("navigator.clipboard.readText()"))
        assert copied["q"] == dict(zip(mh12.joint_names, view.q.tolist(), strict=True))
        assert copied["position"] == mh12.fk(view.q)[:3, 3].tolist()


def test_it_opens_and_shows_the_arm(mh12, window, look, keep):
    view = window(mh12, frames=True, axes=True)
    page = look(view)
    assert page.get_by_role("slider").count() >= 6
    assert page.get_by_text("joint_1_s [rad]").first.is_visible()
    assert "position    x y z  [m]" in page.locator("pre").first.inner_text()
    view.command([0.4, 0.3, -0.2, 0.5, 0.6, 0.1])
    keep(page, "mh12_jog_frames")


def test_a_reload_shows_what_holds_and_keeps_control(mh12, window, look, until):
    view = window(mh12)
    page = look(view)
    enter(page, 2, "0.5")
    until(page, lambda: view.q[2] == 0.5)
    page.reload()
    page.get_by_role("tab", name="Jog").first.wait_for()
    until(page, lambda: box(page, 2).input_value() == "0.5")
    until(page, lambda: view.control.holder is not None and len(view.server.get_clients()) == 1)
    assert view.control.holder in view.server.get_clients()
    enter(page, 2, "0.25")
    until(page, lambda: view.q[2] == 0.25)


def test_two_windows_and_the_handing_over(mh12, window, look, until, keep, monkeypatch):
    view = window(mh12)
    first = look(view)
    until(first, lambda: view.control.holder is not None)
    had = view.control.holder
    second = look(view)
    second.get_by_text("You are looking on.").wait_for()
    first.get_by_text(HERE).wait_for()
    enter(second, 0, "0.5")
    until(second, lambda: box(second, 0).input_value() == "0")  # it is shown again what holds
    assert not view.target.any()
    keep(second, "looking_on")
    second.get_by_role("button", name=TAKE_OVER).click()
    until(second, lambda: view.control.holder not in (None, had))
    first.get_by_text("You are looking on.").wait_for()
    second.get_by_role("button", name=TAKE_OVER).wait_for(state="hidden")
    enter(second, 0, "0.7")
    until(second, lambda: view.q[0] == 0.7)
    enter(first, 0, "0.1")
    until(first, lambda: box(first, 0).input_value() == "0.7")
    assert view.target[0] == 0.7
    monkeypatch.setattr(control, "_RELOAD", 0.0)  # otherwise it might be a page that is loaded anew
    second.context.close()
    first.get_by_text("Nobody controls the arm.").wait_for()
    assert view.control.holder is None
    first.get_by_role("button", name=TAKE_OVER).click()
    until(first, lambda: view.control.holder == had)


def test_the_arm_stops_when_the_browser_is_closed_in_the_middle_of_a_drag(mh12, window, look, until, chromium):
    view = window(mh12)
    page = look(view)
    track = slider(page, 0).bounding_box()
    x, y = track["x"] + 0.5 * track["width"], track["y"] + 0.5 * track["height"]
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 60, y, steps=5)
    until(page, lambda: view.target[0] > 0.1)
    page.context.close()
    other = look(view)
    until(other, lambda: view.control.holder is not None and len(view.server.get_clients()) == 1)
    assert np.all(view.target == view.q)
    enter(other, 0, "0.2")
    until(other, lambda: view.q[0] == 0.2)


def test_the_tabs_of_the_view(mh12, window, look, until, keep):
    view = window(mh12)
    page = look(view)
    page.get_by_role("tab", name="View").first.click()
    for label in ("Dark", "Frames", "Joint axes"):
        page.get_by_label(label, exact=True).first.click()
    until(page, lambda: view.scenery.dark)
    page.get_by_role("tab", name="Jog").first.click()
    press(page, "Random")
    until(page, lambda: view.target.any() and np.allclose(view.q, view.target, rtol=0.0, atol=1e-12))
    keep(page, "mh12_dark_frames_axes")


def test_the_exported_page_opens_with_no_network(mh12, window, chromium, tmp_path, keep):
    view = window(mh12, frames=True)
    view.command([0.4, 0.3, -0.2, 0.5, 0.6, 0.1])
    view.step(2.0)
    view.export(tmp_path / "mh12.html")
    assert [path.name for path in tmp_path.iterdir()] == ["mh12.html"]
    context = chromium.new_context(viewport={"width": 960, "height": 640}, offline=True)
    page = context.new_page()
    asked, faults = [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.goto((tmp_path / "mh12.html").as_uri())
    page.locator("canvas").first.wait_for()
    keep(page, "mh12_exported")
    context.close()
    assert not faults
    assert [url for url in asked if not url.startswith(("file:", "blob:", "data:"))] == []
