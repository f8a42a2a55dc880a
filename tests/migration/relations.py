"""The words of the last column, as assertions: how what the other package gives agrees with what is given here."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from pieper.arm import Arm
from pieper.model.chain import Chain

SAME = 1e-9  # what two chains of a dozen double-precision products may differ by, a thousand times over
SAMPLES = 20

Relation = Callable[[Any, Any, Any, float], None]
"""Takes what is given there, what is given here, the arm of the section, and a tolerance."""


def numbers(value: Any) -> Any:
    """What a package gives as arrays: its poses as matrices, its containers as they are."""
    if isinstance(value, dict):
        return {key: numbers(each) for key, each in value.items()}
    for name in ("A", "homogeneous"):
        if hasattr(value, name):
            return np.array(getattr(value, name))
    if callable(getattr(value, "matrix", None)):
        return np.array(value.matrix())
    if isinstance(value, (list, tuple)) and not all(isinstance(each, str) for each in value):
        return np.array([numbers(each) for each in value])
    return value


def same(theirs: Any, ours: Any, _: Any, tolerance: float) -> None:
    theirs, ours = numbers(theirs), numbers(ours)
    if isinstance(ours, dict):
        assert list(theirs) == list(ours)
        for name in ours:
            same(theirs[name], ours[name], _, tolerance)
        return
    if isinstance(ours, (str, bool, np.bool_)) or (isinstance(ours, (list, tuple)) and isinstance(ours[0], str)):
        assert (list(theirs) if isinstance(ours, (list, tuple)) else theirs) == (
            list(ours) if isinstance(ours, (list, tuple)) else ours
        )
        return
    theirs, ours = np.asarray(theirs, dtype=float), np.asarray(ours, dtype=float)
    assert theirs.shape == ours.shape
    np.testing.assert_allclose(theirs, ours, rtol=0, atol=tolerance)


def same_or_negated(theirs: Any, ours: Any, _: Any, tolerance: float) -> None:
    theirs, ours = np.asarray(theirs), np.asarray(ours)
    same(theirs if theirs @ ours > 0 else -theirs, ours, _, tolerance)


def forward(robot: Any) -> tuple[int, Callable[[Any], Any]]:
    """How many joints a robot of any package has, and its forward kinematics."""
    if isinstance(robot, Chain):
        robot = Arm(robot)
    if isinstance(robot, Arm):
        return robot.dof, robot.fk
    package = type(robot).__module__.split(".")[0]
    if package == "ikpy":
        active = np.array(robot.active_links_mask)
        whole = lambda q: np.where(active, np.insert(np.zeros(1), 0, q)[np.cumsum(active) - 1], 0.0)  # noqa: E731
        return int(active.sum()), lambda q: robot.forward_kinematics(whole(q))
    if package == "kinpy":
        return robot.dof, lambda q: robot.forward_kinematics(q).matrix()
    if package == "roboticstoolbox":
        return robot.n, lambda q: robot.fkine(q).A
    if package == "ssik":
        return robot.dof, robot.fk
    if package == "eaik":
        return len(robot.getOriginal_H().T if len(robot.getOriginal_H()) == 3 else robot.getOriginal_H()), robot.fwdKin
    if package == "pinocchio":
        import pinocchio

        data = robot.createData()

        def tip(q: Any) -> Any:
            pinocchio.framesForwardKinematics(robot, data, np.asarray(q))
            return data.oMf[robot.nframes - 1].homogeneous

        return robot.nq, tip
    raise AssertionError(f"no forward kinematics known of {type(robot)}")


def same_arm(theirs: Any, ours: Any, _: Any, tolerance: float) -> None:
    (count, there), (dof, here) = forward(theirs), forward(ours)
    assert count == dof
    for q in np.random.default_rng(9).uniform(-2.0, 2.0, (SAMPLES, dof)):
        np.testing.assert_allclose(there(q), here(q), rtol=0, atol=tolerance)


def turned(apart: Any) -> Any:
    """Differences of angles without their whole turns."""
    return np.remainder(np.asarray(apart) + math.pi, 2.0 * math.pi) - math.pi


def among(theirs: Any, ours: Any, _: Any, tolerance: float) -> None:
    rows = np.atleast_2d(numbers(ours))
    for q in np.atleast_2d(numbers(theirs)):
        assert np.abs(turned(rows - q)).max(axis=1).min() <= tolerance


def same_set(theirs: Any, ours: Any, _: Any, tolerance: float) -> None:
    theirs, ours = numbers(theirs), numbers(ours)
    ours = ours[~np.isnan(ours).any(axis=-1)]
    assert len(theirs) == len(ours) > 0
    among(theirs, ours, _, tolerance)
    among(ours, theirs, _, tolerance)


def same_rows(theirs: Any, ours: Any, _: Any, tolerance: float) -> None:
    """As `same_set`, but whole turns count."""
    theirs, ours = np.array(theirs), np.array(list(ours))
    assert len(theirs) == len(ours) > 0
    apart = np.abs(theirs[:, None] - ours[None]).max(axis=-1)
    assert apart.min(axis=0).max() <= tolerance
    assert apart.min(axis=1).max() <= tolerance


def same_position(theirs: Any, ours: Any, arm: Arm, tolerance: float) -> None:
    same(arm.fk(theirs)[:3, 3], arm.fk(ours)[:3, 3], arm, tolerance)


def same_tool_axis(theirs: Any, ours: Any, arm: Arm, tolerance: float) -> None:
    same(arm.fk(theirs)[:3, 2:], arm.fk(ours)[:3, 2:], arm, tolerance)


def same_shape(theirs: Any, ours: Any, _: Any, tolerance: float) -> None:
    assert np.shape(numbers(theirs)) == np.shape(numbers(ours))


def no_worse(theirs: Any, ours: Any, _: Any, tolerance: float) -> None:
    assert 0.0 <= ours <= theirs + tolerance


def same_sets(theirs: Any, ours: Any, _: Any, tolerance: float) -> None:
    """As `same_set`, for each target of a batch."""
    assert len(theirs) == len(ours)
    for there, here in zip(theirs, ours, strict=True):
        same_set(there, here, _, tolerance)


def both_run(theirs: Any, ours: Any, _: Any, tolerance: float) -> None:
    """Each gives something of its own kind, not to be compared: a drawing, a sentence."""
    assert theirs is not None
    assert ours is not None


RELATIONS: dict[str, Relation] = {
    "same": same,
    "same or negated": same_or_negated,
    "same arm": same_arm,
    "same set": same_set,
    "same rows": same_rows,
    "same sets": same_sets,
    "same position": same_position,
    "same tool axis": same_tool_axis,
    "same shape": same_shape,
    "among": among,
    "no worse": no_worse,
    "both run": both_run,
    "ours runs": both_run,
}
