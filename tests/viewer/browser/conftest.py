"""One Chromium for every test here, windows of the viewer to look at with it, and pictures that are kept."""

from __future__ import annotations

import shutil
import time
from pathlib import Path

import pytest

import pieper

SCREENSHOTS = Path(__file__).parents[3] / "build" / "screenshots"
FLAGS = [
    "--headless=new",
    "--no-sandbox",  # the tests may run as root; nothing but our own page is opened
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-dev-shm-usage",
]
SMALL, LARGE = (760, 560), (1280, 820)  # [px]; pictures are taken large, all else goes faster small
PATIENCE = 60.0  # [s]; a busy machine draws slowly in software


@pytest.fixture(scope="session")
def chromium():
    """A browser without a screen; where there is none, the tests say so and skip."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    pytest.importorskip("viser", reason="the viewer's extra is not installed")
    path = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if path is None:
        pytest.skip("no Chromium is installed (apt-get install chromium)")
    with playwright.sync_playwright() as runner:
        browser = runner.chromium.launch(executable_path=path, args=FLAGS)
        yield browser
        browser.close()


def start_view(arm, **options):
    """A viewer of an arm that a simulator moves, on a free port."""
    from pieper.sim.kinematic import KinematicSimulator
    from pieper.viewer.server import Server
    from pieper.viewer.view import View

    view = View(Server(port=0), arm, KinematicSimulator(arm.chain), **options)
    view.start()
    return view


def open_page(chromium, view, faults, **options):
    """A page on a viewer, ready to be used; what goes wrong in it is added to `faults`."""
    page = chromium.new_context(viewport=dict(zip(("width", "height"), SMALL, strict=True)), **options).new_page()
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.set_default_timeout(1e3 * PATIENCE)
    page.goto(view.server.url)
    page.get_by_role("tab", name="Jog").first.wait_for()
    return page


@pytest.fixture
def window():
    """Starts viewers, and ends them."""
    started = []

    def start(arm, **options):
        started.append(start_view(arm, **options))
        return started[-1]

    yield start
    for view in started:
        view.close()


@pytest.fixture
def look(chromium):
    """Opens a viewer in a page of its own; a fault in a page fails the test."""
    pages, faults = [], []

    def look_at(view, **options):
        pages.append(open_page(chromium, view, faults, **options))
        return pages[-1]

    yield look_at
    for page in pages:
        page.context.close()
    assert not faults


@pytest.fixture(scope="module")
def mh12():
    return pieper.load("mh12")


@pytest.fixture(scope="class")
def lasting(chromium, mh12):
    """One window and one page for all tests of a class that only move the arm."""
    faults = []
    view = start_view(mh12)
    page = open_page(chromium, view, faults, permissions=["clipboard-read", "clipboard-write"])
    yield view, page
    page.context.close()
    view.close()
    assert not faults


@pytest.fixture
def jogged(lasting, until):
    """The same with the arm at home."""
    view, page = lasting
    view.command([0.0] * view.arm.dof)
    until(page, lambda: not view.q.any())
    return view, page


@pytest.fixture
def keep():
    """Keeps a picture of a page for people to look at, without the note that drawing is slow here."""

    def save(page, name):
        page.add_style_tag(content="[class*=Notifications-root] { display: none }")
        page.set_viewport_size(dict(zip(("width", "height"), LARGE, strict=True)))
        for _ in range(3):  # until what has come is drawn, at the new size
            page.evaluate("new Promise(drawn => requestAnimationFrame(() => requestAnimationFrame(drawn)))")
            page.wait_for_timeout(150)
        SCREENSHOTS.mkdir(parents=True, exist_ok=True)
        page.screenshot(path=SCREENSHOTS / f"{name}.png")
        page.set_viewport_size(dict(zip(("width", "height"), SMALL, strict=True)))

    return save


@pytest.fixture
def until():
    """Waits until something holds on the side of Python, while the page goes on living."""

    def wait(page, met, patience=PATIENCE):
        end = time.monotonic() + patience
        while not met():
            assert time.monotonic() < end, "waited in vain"
            page.wait_for_timeout(50)

    return wait
