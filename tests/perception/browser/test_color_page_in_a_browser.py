"""Boxes dragged in Chromium; what came of it is read on the side of Python."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import pytest

from pieper.perception.color_learning import learn
from pieper.perception.color_page import ColorPage
from tests.perception.color_scenes import PLACES, frame, share_found

SCREENSHOTS = Path(__file__).parents[3] / "build" / "screenshots"
PATIENCE = 60.0  # [s]; a busy machine draws slowly in software


@pytest.fixture(scope="module")
def chromium():
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    path = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if path is None:
        pytest.skip("no Chromium is installed (apt-get install chromium)")
    with playwright.sync_playwright() as runner:
        # No sandbox, as the tests may run as root; nothing but our own page is opened.
        browser = runner.chromium.launch(
            executable_path=path, args=["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
        )
        yield browser
        browser.close()


@pytest.fixture
def opened(chromium, tmp_path):
    for n in range(4):
        assert cv2.imwrite(str(tmp_path / f"{n}.png"), frame(seed=n))
    faults, elsewhere = [], []
    with ColorPage(tmp_path, names=["red", "blue"]) as page:
        tab = chromium.new_context(viewport={"width": 1100, "height": 640}).new_page()
        tab.set_default_timeout(1e3 * PATIENCE)
        tab.on("pageerror", lambda error: faults.append(str(error)))
        tab.on("request", lambda request: elsewhere.append(request.url))
        tab.goto(page.url)
        tab.locator("canvas[data-frame='0']").wait_for()
        yield page, tab
        assert not faults
        assert all(url.startswith((f"http://127.0.0.1:{page.port}/", "data:", "blob:")) for url in elsewhere)
        tab.context.close()


def drag(tab, place, zoom=1, half=6):
    """Drag a box about a place of the frame."""
    corner = tab.locator("canvas").bounding_box()
    x, y = (corner["x"] + zoom * (place[0] + 0.5), corner["y"] + zoom * (place[1] + 0.5))
    tab.mouse.move(x - zoom * half, y - zoom * half)
    tab.mouse.down()
    tab.mouse.move(x, y)
    tab.mouse.move(x + zoom * half, y + zoom * half)
    tab.mouse.up()


def test_A4_boxes_are_dragged_on_frames_that_are_stepped_through(opened):
    page, tab = opened
    assert "token" not in tab.url
    drag(tab, PLACES["red"][0])
    tab.get_by_label("blue").check()
    tab.get_by_label("Zoom").select_option("2")
    drag(tab, PLACES["blue"][0], zoom=2)
    tab.get_by_role("button", name="Next frame").click()
    tab.locator("canvas[data-frame='1']").wait_for()
    tab.get_by_label("Frame number").fill("3")
    tab.get_by_label("Frame number").press("Enter")
    tab.locator("canvas[data-frame='3']").wait_for()
    tab.get_by_label("New colour").fill("green")
    tab.get_by_role("button", name="Add colour").click()
    drag(tab, PLACES["green"][0], zoom=2)
    drag(tab, PLACES["green"][1], zoom=2)
    assert tab.locator("#boxes li").count() == 4
    tab.locator("#boxes li").nth(3).get_by_role("button", name="Remove").click()
    tab.get_by_role("button", name="Preview").click()
    tab.get_by_text("no remarks").wait_for()
    SCREENSHOTS.mkdir(parents=True, exist_ok=True)
    tab.screenshot(path=SCREENSHOTS / "color_page.png")
    tab.get_by_role("button", name="Done").click()
    regions = page.wait(PATIENCE)
    assert [(r.color, r.frame) for r in regions] == [("red", 0), ("blue", 0), ("green", 3)]
    for r in regions:
        x, y = PLACES[r.color][0]
        assert (r.x, r.y, r.width, r.height) == (x - 6, y - 6, 13, 13)
    model = learn(lambda n: frame(seed=n), regions).model
    assert share_found(frame(seed=9), model.table()) == 1.0


def test_a_box_that_is_too_small_and_nothing_at_all_are_complained_of(opened):
    _, tab = opened
    drag(tab, PLACES["red"][0], half=0)
    tab.get_by_text("that box is too small").wait_for()
    tab.get_by_role("button", name="Done").click()
    tab.get_by_text("there are no boxes yet").wait_for()
