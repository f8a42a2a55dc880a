"""An arm in the browser for two seconds, moving, and the same scene as a page that opens with no network."""

import time
from pathlib import Path

import numpy as np

import pieper
from pieper.errors import MissingExtraError
from pieper.sim.kinematic import KinematicSimulator

ur5e = pieper.load("ur5e")
robot = KinematicSimulator(ur5e.chain, q=[0.0, -1.2, 1.2, -1.5, -1.5, 0.0])

try:
    from pieper.viewer.arm_view import GhostsView
    from pieper.viewer.server import Server
    from pieper.viewer.view import View
except MissingExtraError as reason:
    print(f"not shown: {reason}")
    raise SystemExit from None

with View(Server(), ur5e, robot, frames=True) as view:
    view.start()
    print(f"open {view.server.url}")

    goal = [0.8, -1.0, 1.4, -1.9, -1.5, 0.5]
    answers = ur5e.ik(ur5e.fk(goal))
    ghosts = GhostsView(view.server, "solutions", ur5e)
    ghosts.update(answers.q)
    print(f"{ghosts.count} ghosts, one for each solution of the goal")

    view.command(goal)
    end = time.monotonic() + 2.0  # a program that stays would call view.wait()
    while time.monotonic() < end and not np.array_equal(view.q, goal):
        time.sleep(0.05)
    print(f"tip at {ur5e.fk(view.q)[:3, 3].round(4)} m")

    view.export("ur5e.html")
    print(f"ur5e.html: {Path('ur5e.html').stat().st_size / 1e6:.1f} MB")
