"""What those who come from other packages hand over by habit: taken where it is an array, refused in words where it is not."""

from __future__ import annotations

import re
import warnings
from typing import Any

import numpy as np
import pytest

import pieper
from pieper.errors import ArrayError, DescriptionError, PieperError, UnknownNameError
from pieper.ik.solve import solve
from pieper.model import dh, poe, symbolic
from pieper.model.urdf import as_urdf
from pieper.spatial import pose, rotation
from tests.migration.page import COMPLAINTS, code_of, rows_of, sections

ARM = pieper.load("ur5e")
Q = np.array([0.1, -1.2, 1.4, -1.7, -1.5, 0.3])
T = ARM.fk(Q)
SECTIONS = sections()
SAID = [
    (code_of(passed), code_of(said))
    for section in SECTIONS.values()
    for passed, said in rows_of(section.text, COMPLAINTS)
]
NEEDED = {"kinpy": "kinpy", "pin": "pinocchio", "rtb": "roboticstoolbox"}  # name on the page: module


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What the block at the top of the page defines."""
    names: dict[str, Any] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("foreign"))
        for language, code in SECTIONS[""].blocks:
            assert language == "python"
            exec(compile(code, "the code at the top", "exec"), names)
    return names


@pytest.mark.parametrize(("passed", "said"), SAID, ids=[passed for passed, _ in SAID])
def test_the_page_says_what_is_said(passed: str, said: str, shared: dict[str, Any]) -> None:
    names = dict(shared)
    for name, module in NEEDED.items():
        if re.search(rf"\b{name}\.", passed):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # those of the other package
                names[name] = pytest.importorskip(module, reason=f"{module}: not installed; nox -s peers has it")
    with pytest.raises(PieperError) as raised:
        eval(passed, names)
    assert re.match(".*".join(map(re.escape, said.split("..."))), str(raised.value)), raised.value


def test_the_page_has_such_lines() -> None:
    assert len(SAID) >= 10


class Matrix:
    """As spatialmath's SE3 and Pinocchio's: an object that NumPy can read."""

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Any:
        return np.array(T, dtype=dtype)


class Opaque:
    """As kinpy's Transform: an object that it cannot."""


@pytest.mark.parametrize(
    "take", [lambda T: ARM.ik(T).q, pose.inverse, lambda T: ARM.with_tool(T).fk(Q)], ids=["ik", "inverse", "with_tool"]
)
def test_objects_that_numpy_reads_are_taken(take: Any) -> None:
    np.testing.assert_array_equal(take(Matrix()), take(T))


def test_objects_that_it_cannot_read_are_named() -> None:
    for call in (
        lambda: ARM.ik(Opaque()),
        lambda: pose.inverse(Opaque()),
        lambda: rotation.from_quaternion(Opaque()),
    ):
        with pytest.raises(ArrayError, match="got Opaque; give its numbers as an array"):
            call()
    with pytest.raises(ArrayError, match=r"T_tip_tool must be real numbers of shape \(4, 4\), got Opaque"):
        ARM.with_tool(Opaque())
    with pytest.raises(
        ArrayError, match=r"q must be real numbers, got Opaque; .* shoulder_pan_joint, shoulder_lift_joint"
    ):
        ARM.fk(Opaque())


@pytest.mark.parametrize(
    ("target", "advice"),
    [
        (T[:3, 3], "for a position alone: pieper.ik.target.ignore_orientation"),
        (T[:3, :3], "a pose has a position too: pieper.spatial.pose.from_position_rotation"),
        ([*T[:3, 3], 0.0, 0.0, 0.0, 1.0], "quaternion x, y, z, w"),
    ],
    ids=["position", "rotation", "seven numbers"],
)
def test_targets_of_another_shape_are_told_what_to_do(target: Any, advice: str) -> None:
    for call in (ARM.ik, lambda target: solve(ARM.chain, target), lambda target: solve(ARM.chain, target, count=1)):
        with pytest.raises(ArrayError, match=re.escape(advice)):
            call(target)


@pytest.mark.parametrize("name", ["q0", "initial_position", "q_seed", "q_init", "tol", "max_solutions", "mask"])
def test_options_of_other_packages_are_told_those_of_this_one(name: str) -> None:
    wanted = f"no option '{name}' in inverse kinematics; .*options are: seed, redundancy, .*position_tolerance"
    with pytest.raises(UnknownNameError, match=wanted):
        ARM.ik(T, **{name: Q})
    with pytest.raises(UnknownNameError, match=wanted):
        solve(ARM.chain, T, **{name: Q})


def test_an_arm_where_a_chain_belongs_is_told() -> None:
    with pytest.raises(ArrayError, match=r"chain must be a Chain, as `arm.chain` is one, got Arm"):
        solve(ARM, T)


@pytest.mark.parametrize("reads", [dh.as_dh, poe.as_screws, symbolic.end_effector])
def test_an_arm_where_a_chain_is_written_down_is_told(reads: Any) -> None:
    with pytest.raises(ArrayError, match=r"chain must be a Chain, as `arm.chain` is one, got Arm"):
        reads(ARM)


def test_an_arm_where_a_urdf_is_written_is_told() -> None:
    with pytest.raises(DescriptionError, match=r"Arm: robot: expected a Chain or a Description, as `arm.chain` and"):
        as_urdf(ARM)


def test_a_word_for_the_redundancy_is_told_how_it_is_given() -> None:
    iiwa = pieper.load("kuka_iiwa14")
    with pytest.raises(
        ArrayError, match=r"values of the redundancy must be numbers, or .* as \{'swivel': 0.3\}, got 'swivel'"
    ):
        iiwa.ik(iiwa.fk([0.1] * 7), redundancy="swivel")


def test_a_frame_that_mirrors_is_told_so_and_not_called_rounded() -> None:
    with pytest.raises(
        ArrayError, match=r"rotation block of T_base_tip must be a rotation: it mirrors .*turn one of them round"
    ) as told:
        ARM.ik(np.diag([1.0, 1.0, -1.0, 1.0]))
    assert "rounding" not in str(told.value)


def test_a_joint_to_lock_is_named_not_counted() -> None:
    with pytest.raises(UnknownNameError, match="no joint '2' in chain 'ur5e'; joints are: shoulder_pan_joint"):
        ARM.lock({2: 0.1})


def test_answers_are_neither_true_nor_false() -> None:
    for wanted in (T, pose.from_xyz_rpy([9.0, 0.0, 0.0], [0.0, 0.0, 0.0]), np.stack([T, T])):
        with pytest.raises(ArrayError, match=r"the answers have no truth value; ask answers.reached"):
            bool(ARM.ik(wanted))
