"""MuJoCo's own window on a simulation. It needs a screen."""

from __future__ import annotations

import os
import sys
import time
from typing import TYPE_CHECKING

from pieper.errors import MissingLibraryError
from pieper.sim.mujoco_arm import SOLIDS
from pieper.sim.offscreen import import_mujoco

if TYPE_CHECKING:
    from collections.abc import Callable

    from pieper.sim.physics import MujocoSimulator

_FRAME = 1.0 / 60.0  # [s]


def open_window(robot: MujocoSimulator) -> Callable[[], None]:
    """Show a simulation from now on, in real time: the simulator waits for the clock. Returns what closes the window.

    Raises
    ------
    MissingLibraryError
        There is no screen, or the window cannot be opened.
    """
    import_mujoco()
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise MissingLibraryError(
            "a window needs a screen, and DISPLAY is not set; make a film instead, with --record FILE"
        )
    try:
        import mujoco.viewer

        window = mujoco.viewer.launch_passive(robot.model, robot.data, show_left_ui=False, show_right_ui=False)
    except Exception as cause:
        raise MissingLibraryError(f"MuJoCo's window does not open: {' '.join(str(cause).split())}") from cause
    window.opt.geomgroup[SOLIDS] = 0
    began, shown = time.monotonic() - robot.time, [0.0]

    def observe() -> None:
        if robot.time < shown[0] + _FRAME or not window.is_running():
            return
        shown[0] = robot.time
        window.sync()
        time.sleep(max(0.0, began + robot.time - time.monotonic()))

    robot.observers.append(observe)

    def close() -> None:
        robot.observers.remove(observe)
        window.close()

    return close
