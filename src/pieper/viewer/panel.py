"""What a panel of the viewer is: a tab with controls, told of what happens to the arm; and what it finds in the window."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from pieper.errors import PieperError

if TYPE_CHECKING:
    import threading
    from collections.abc import Callable

    from numpy.typing import ArrayLike

    from pieper.arm import Arm
    from pieper.model.chain import FloatArray
    from pieper.motion.robot import Robot, RobotState
    from pieper.viewer.arm_view import ArmView
    from pieper.viewer.server import Server


class Window(Protocol):
    """What a panel may use of the window that it is in, a `pieper.viewer.view.View`, which describes each of them."""

    server: Server
    arm: Arm
    robot: Robot
    arm_view: ArmView
    lock: threading.RLock
    q: FloatArray
    target: FloatArray
    size: float

    def command(self, q: ArrayLike) -> None:
        """Send the arm to joint values (n,) [rad or m]."""
        ...

    def stop_motion(self) -> None:
        """Bring the arm to rest where it is."""
        ...

    def limited(self, q: ArrayLike) -> FloatArray:
        """The joint values (n,) within the limits that are nearest to `q` (n,) [rad or m]."""
        ...

    def say(self, text: str, *, bad: bool = False) -> None:
        """Write a sentence above the tabs."""
        ...


class Panel:
    """A tab of the viewer. Derive from it, and hand an instance to ``View(panels=[...])``.

    Every method but `build` does nothing unless it is overridden. They are called one at a time, under ``view.lock``, from the thread of
    the viewer; what a control of viser calls back comes from other threads, and takes ``view.lock`` before it touches the arm.

    Attributes
    ----------
    title : str
        Of the tab.

    Examples
    --------
    A panel with one button, which folds the arm:

    >>> class Fold(Panel):
    ...     title = "Fold"
    ...
    ...     def build(self, view):
    ...         view.server.gui.add_button("Fold").on_click(lambda event: view.command(view.limited([0.0] * view.arm.dof)))
    """

    title: str = "Panel"

    def build(self, view: Window) -> None:
        """Make the controls, with ``view.server.gui``; they land in the tab of this panel. Called once."""
        raise NotImplementedError

    def on_command(self, q: FloatArray) -> None:
        """The arm has been sent to joint values `q` (n,), by whatever panel."""

    def on_state(self, state: RobotState) -> None:
        """The arm has moved to ``state.q``; called within one update of the scene, at most some 30 times a second."""

    def on_tick(self, dt: float) -> None:
        """`dt` seconds have passed; called all the time, some 30 times a second, moving or not."""

    def close(self) -> None:
        """The viewer ends."""


def on_event(
    view: Window, act: Callable[[], None], *, complain: Callable[[str], None], quiet: Callable[[], bool] = lambda: False
) -> Callable[[Any], None]:
    """A callback for a control of viser: under the lock, not while the panel itself writes to its controls, and errors told in words.

    Parameters
    ----------
    view : Window
    act : callable
        What the control does.
    complain : callable
        Given the words of a `PieperError`.
    quiet : callable
        Whether the control is being written to by the panel, so that nobody has touched it.

    Returns
    -------
    callable
        To be given to ``on_click`` or ``on_update``.
    """

    def called(_: Any) -> None:
        with view.lock:
            if quiet():
                return
            try:
                act()
            except PieperError as problem:
                complain(str(problem))

    return called
