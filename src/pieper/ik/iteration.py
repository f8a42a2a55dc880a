"""The teaching method: step the joints along the pseudo-inverse of the Jacobian until the tip is there.

    q  <-  q + alpha * pinv(J(q)) @ (k1 * delta_r, k2 * delta_phi)

`delta_r` is what is left to go, `delta_phi` the axis times the angle of ``R_desired R_now^T``, what is left to turn, both in base
axes. The orientation can be treated in three ways, which are easily mistaken for one another:

- ``"ignore"``: three rows. The tip turns as it likes.
- ``"hold"``: six rows with ``delta_phi = 0``. This does not ignore the orientation: it asks the tip not to turn, and
  fails where a position can be reached only by turning.
- ``"reach"``: six rows, with what is left to turn.

With ``alpha * k1`` below 1 the error shrinks by ``1 - alpha * k1`` in every step, as long as the pseudo-inverse is one.
There are no joint limits in the method. `pieper.ik.solve` keeps them, and is the one to use for work.

References
----------
Siciliano et al., Robotics: Modelling, Planning and Control (2009), section 3.7.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import count
from typing import TYPE_CHECKING, Literal

import numpy as np

from pieper.errors import ArrayError
from pieper.kinematics.fk import fk
from pieper.kinematics.jacobian import jacobian
from pieper.kinematics.joints import as_joints
from pieper.kinematics.manipulability import pseudo_inverse
from pieper.spatial._checks import FloatArray, poses, stack
from pieper.spatial.rotation import as_rotation_vector

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import ArrayLike

    from pieper.model.chain import Chain

Orientation = Literal["ignore", "hold", "reach"]


@dataclass(frozen=True, eq=False)
class Step:
    """Where the iteration stands. Step 0 is the start.

    Attributes
    ----------
    iteration : int
        Number of updates made so far.
    q : (n,) array
        Joint values [rad or m].
    T : (4, 4) array
        Pose of the tip in the base frame.
    error : (3,) or (6,) array
        What is left: position [m], then rotation vector [rad] (zero when the orientation is held), in base axes.
    norm : float
        Length of `error`, metres and radians alike.
    """

    iteration: int
    q: FloatArray
    T: FloatArray
    error: FloatArray
    norm: float


def iterate(
    chain: Chain,
    target: ArrayLike,
    q_start: ArrayLike,
    *,
    orientation: Orientation = "ignore",
    alpha: float = 1.0,
    k1: float = 1.0,
    k2: float = 1.0,
    damping: float = 0.0,
    iterations: int | None = None,
    position_stop: float | None = None,
    rotation_stop: float | None = None,
    target_offset: ArrayLike | None = None,
) -> Iterator[Step]:
    """Every step of the iteration, the start included.

    Parameters
    ----------
    chain : Chain
    target : (3,) or (4, 4) array
        Position of the tip in the base frame [m], or its pose; "reach" needs a pose.
    q_start : (n,) array
        Joint values at the start [rad or m]. A warm start is the last ``q`` of the run before.
    orientation : "ignore", "hold" or "reach"
        See the module.
    alpha, k1, k2 : float
        Gains: of the whole step, of the position, of the rotation.
    damping : float
        With a damping d above 0, ``J^T (J J^T + d^2 I)^-1`` takes the place of the pseudo-inverse.
    iterations : int, optional
        Number of updates at most. Without it the run ends by the stops alone.
    position_stop : float, optional
        Ends once the distance that is left is below this [m], and, where `rotation_stop` is given, the angle below that.
    rotation_stop : float, optional
        The same for the angle that is left [rad]; for "reach".
    target_offset : (3,) array, optional
        Distances [m] by which the target is moved away from the planes of the base frame first, each with the sign of its
        coordinate; a coordinate of 0 stays. For the replay of a published run; it makes answers worse.

    Yields
    ------
    Step

    Raises
    ------
    ArrayError
        Wrong shape, not finite, not a rotation, an unknown word for `orientation`, a gain or stop that is not a positive
        number, or neither `iterations` nor a stop.

    Examples
    --------
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("mh12-report").chain()
    >>> norms = [s.norm for s in iterate(arm, [0.3, 0.3, 0.3], [0.0] * 5, alpha=0.06, iterations=100)]
    >>> [round(norms[k], 5) for k in (0, 50, 100)]
    [1.17161, 0.05281, 0.00239]
    """
    goal = _goal(target, orientation, target_offset)
    q = as_joints(chain, q_start, name="q_start")
    if q.ndim != 1:
        raise ArrayError(
            f"q_start must have shape ({chain.dof},), got {q.shape}; the iteration runs one start at a time"
        )
    for name, value in (("alpha", alpha), ("k1", k1), ("k2", k2)):
        if not 0.0 < value < np.inf:
            raise ArrayError(f"{name} must be a positive number, got {value!r}")
    if not 0.0 <= damping < np.inf:
        raise ArrayError(f"damping must be a number of at least 0, got {damping!r}")
    for name, stop in (("position_stop", position_stop), ("rotation_stop", rotation_stop)):
        if stop is not None and not 0.0 < stop < np.inf:
            raise ArrayError(f"{name} must be a positive number or None, got {stop!r}")
    if rotation_stop is not None and orientation != "reach":
        raise ArrayError(f"rotation_stop needs orientation 'reach', got {orientation!r}")
    if iterations is None and position_stop is None and rotation_stop is None:
        raise ArrayError("give iterations, position_stop or rotation_stop; nothing else ends the run")
    if iterations is not None and iterations < 0:
        raise ArrayError(f"iterations must be at least 0, got {iterations!r}")
    gains = alpha * np.repeat([k1, k2], 3)
    return _steps(chain, goal, q, orientation, gains, damping, iterations, (position_stop, rotation_stop))


def _steps(
    chain: Chain,
    goal: FloatArray,
    q: FloatArray,
    orientation: Orientation,
    gains: FloatArray,
    damping: float,
    iterations: int | None,
    stops: tuple[float | None, float | None],
) -> Iterator[Step]:
    for iteration in count():
        T = fk(chain, q)
        left = np.zeros(6)
        left[:3] = goal[:3, 3] - T[:3, 3]
        if orientation == "reach":
            left[3:] = as_rotation_vector(goal[:3, :3] @ T[:3, :3].T)
        rows = 3 if orientation == "ignore" else 6
        error = left[:rows]
        yield Step(iteration, q, T, error, float(np.linalg.norm(error)))
        if iteration == iterations or _arrived(left, stops):
            return
        J = jacobian(chain, q)[:rows]
        if damping > 0.0:
            step = J.T @ np.linalg.solve(J @ J.T + damping**2 * np.eye(rows), gains[:rows] * error)
        else:
            step = pseudo_inverse(J) @ (gains[:rows] * error)
        q = q + step


def _arrived(left: FloatArray, stops: tuple[float | None, float | None]) -> bool:
    near = [float(np.linalg.norm(part)) < stop for part, stop in zip((left[:3], left[3:]), stops, strict=True) if stop]
    return bool(near) and all(near)


def run(
    chain: Chain,
    target: ArrayLike,
    q_start: ArrayLike,
    *,
    callback: Callable[[Step], object] | None = None,
    orientation: Orientation = "ignore",
    alpha: float = 1.0,
    k1: float = 1.0,
    k2: float = 1.0,
    damping: float = 0.0,
    iterations: int | None = None,
    position_stop: float | None = None,
    rotation_stop: float | None = None,
    target_offset: ArrayLike | None = None,
) -> Step:
    """The last step of `iterate`.

    Parameters
    ----------
    callback : callable, optional
        Called with every `Step`, the start included. Returning False ends the run.
    chain, target, q_start, orientation, alpha, k1, k2, damping, iterations, position_stop, rotation_stop, target_offset
        As for `iterate`.

    Returns
    -------
    Step
        Joint values, pose and what is left to go, in metres and radians.

    Raises
    ------
    ArrayError, UnknownNameError
        As from `iterate`.

    Examples
    --------
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("ur5e").chain()
    >>> last = run(arm, [0.5, -0.6, 0.2], [-1.28, 4.41, 1.54, -1.16, -1.56, 0.0], k1=0.1, position_stop=1e-3)
    >>> last.iteration, round(last.norm, 6)
    (61, 0.00092)
    """
    step: Step | None = None
    for step in iterate(
        chain,
        target,
        q_start,
        orientation=orientation,
        alpha=alpha,
        k1=k1,
        k2=k2,
        damping=damping,
        iterations=iterations,
        position_stop=position_stop,
        rotation_stop=rotation_stop,
        target_offset=target_offset,
    ):
        if callback is not None and callback(step) is False:
            break
    assert step is not None  # the start is always there
    return step


def _goal(target: ArrayLike, orientation: Orientation, target_offset: ArrayLike | None) -> FloatArray:
    """The target as a pose, moved by the offset."""
    if orientation not in ("ignore", "hold", "reach"):
        raise ArrayError(f"orientation must be 'ignore', 'hold' or 'reach', got {orientation!r}")
    given = np.asarray(target)
    if given.shape == (3,) and orientation != "reach":
        goal = np.eye(4)
        goal[:3, 3] = stack(target, (3,), "target")
    elif given.shape == (4, 4):
        goal = poses(target, "target").copy()
    else:
        wanted = "(4, 4)" if orientation == "reach" else "(3,) or (4, 4)"
        raise ArrayError(f"target must have shape {wanted} to {orientation} the orientation, got {given.shape}")
    if target_offset is not None:
        goal[:3, 3] += np.sign(goal[:3, 3]) * stack(target_offset, (3,), "target_offset")
    return goal
