"""A pick in the browser: what the page holds is where things are, in real time, and nothing is left behind."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="mujoco is not installed")
pytest.importorskip("viser", reason="viser is not installed")

from pieper.cli.main import main
from pieper.tasks import pick_tasks, pick_view
from pieper.tasks.pick import PickAndPlace
from pieper.tasks.pick_view import PickView

SEEN = 1e-5  # [m]; smaller moves are not sent to the page


class Clock:
    """Time that passes only when somebody sleeps."""

    def __init__(self):
        self.now = 100.0

    def monotonic(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(pick_view, "time", clock)
    return clock


def test_the_page_shows_where_everything_is_in_real_time(clock):
    run = PickAndPlace(pick_tasks.task("mh12"), planner="direct")
    with PickView(run, port=0) as page:
        assert page.url.startswith("http://127.0.0.1:")
        assert not page.wait_for_page(longest=3.0)
        assert clock.now == pytest.approx(103.0, abs=0.2)
        began = clock.now
        run.gripper.close()
        run.robot.command(run.task.q_home + 0.1)
        run.robot.step(0.5)
        assert clock.now - began == pytest.approx(0.5, abs=0.05)
        page.show()
        np.testing.assert_allclose(page._things["can 3"].position, run.robot.pose("can 3")[:3, 3], atol=SEEN)
        np.testing.assert_allclose(page._hand.position, run.robot.tip()[:3, 3], atol=SEEN)
        apart = page._parts["finger/left/pad"].position[1] - page._parts["finger/right/pad"].position[1]
        assert apart == pytest.approx(run.gripper.width + run.task.gripper.pad[0], abs=SEEN)
        for k in range(20):
            page.say(f"line {k} <b>")
        assert "line 19 &lt;b&gt;" in page._log.content
        assert "line 2 " not in page._log.content
    assert not run.robot.observers
    assert not page.server.is_running


def test_without_anybody_looking_the_command_goes_on(clock, capsys, monkeypatch):
    monkeypatch.setattr("pieper.cli.pick.has_display", lambda: False)
    assert main(["pick", "--arm", "mh12", "--cycles", "1", "--view", "--planner", "direct"]) == 0
    out = capsys.readouterr().out
    assert "http://127.0.0.1:" in out
    assert "nobody has opened the page yet" in out
    assert "1 of 1 placed" in out
