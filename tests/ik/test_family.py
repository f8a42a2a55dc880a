"""Which closed form an arm has."""

from __future__ import annotations

import numpy as np
import pytest

from pieper.errors import ArrayError
from pieper.ik.family import find_family, size_of
from pieper.model.chain import Chain
from pieper.spatial.pose import inverse
from pieper.spatial.twist import adjoint, exp
from tests.robots import chain

WRIST = ("abb_irb120", "abb_irb2400", "abb_irb6640", "kuka_kr210_l150", "kuka_kr210_robond", "puma560", "yaskawa_mh12")
THREE_PARALLEL = ("ur3", "ur3e", "ur5", "ur5e", "ur10", "ur10e", "ur16e", "ur20", "ur30")
FIVE_JOINTS = ("kuka_youbot", "mh12-report", "so100", "so101")
NONE = ("abb_crb15000", "fanuc_crx10ia", "fanuc_crx10ia_l", "kinova_gen3_6dof", "ufactory_xarm6")


def disturbed(arm: Chain, angle: float, length: float, seed: int = 0) -> Chain:
    """The arm with every axis moved a little, as a calibration or rounding would."""
    rng = np.random.default_rng(seed)
    screws = arm.screws.copy()
    for i in range(len(screws)):
        small = np.concatenate([rng.normal(size=3) * length, rng.normal(size=3) * angle])
        screws[i] = adjoint(exp(small)) @ screws[i]
    return Chain(arm.name, screws, arm.home, arm.limits, arm.joint_names)


def flipped(arm: Chain, joints: tuple[int, ...]) -> Chain:
    """The arm with some joints counted the other way round."""
    screws = arm.screws.copy()
    screws[list(joints)] *= -1.0
    return Chain(arm.name, screws, arm.home, arm.limits, arm.joint_names)


def backwards(arm: Chain) -> Chain:
    """The arm bolted down by its flange, with its old base as the tool."""
    T = np.asarray(inverse(arm.home))
    screws = np.array([-(adjoint(T) @ s) for s in arm.screws[::-1]])
    return Chain(arm.name, screws, T, arm.limits[::-1], arm.joint_names[::-1])


@pytest.mark.parametrize("name", WRIST)
def test_spherical_wrists(name):
    family = find_family(chain(name))
    assert (family.name, family.level, family.max_solutions) == ("spherical wrist", "exact", 8)
    assert "axes 4, 5 and 6 meet" in family.reason
    assert "axes 2 and 3 are parallel" in family.reason


@pytest.mark.parametrize("name", THREE_PARALLEL)
def test_three_parallel_axes(name):
    family = find_family(chain(name))
    assert (family.name, family.level, family.max_solutions) == ("three parallel axes", "exact", 8)
    assert str(family) == "axes 2, 3 and 4 are parallel, and axes 5 and 6 meet: up to 8 answers (exact)"


@pytest.mark.parametrize("name", FIVE_JOINTS)
def test_five_joints(name):
    family = find_family(chain(name))
    assert (family.name, family.level, family.max_solutions) == ("three parallel axes", "exact", 4)


@pytest.mark.parametrize("name", NONE)
def test_general_arms_have_none_and_say_why(name):
    family = find_family(chain(name))
    assert not family.has_closed_form
    assert not family.complete
    assert family.reason.startswith("no three axes meet or are parallel where a closed form needs it")
    with pytest.raises(ArrayError, match=r"has no closed form: no three axes.*; use pieper.ik.solve"):
        _ = family.native


def test_reasons_for_other_chains():
    assert "7 joints" in find_family(chain("franka_panda")).reason
    assert "lock some joints" in find_family(chain("franka_panda")).reason
    arm = chain("ur5e")
    one = Chain("slide", np.eye(6)[[0]], np.eye(4), np.array([[-1.0, 1.0]]), ("x",))
    assert "too few joints: 1" in find_family(one).reason
    spatial = Chain("3R", arm.screws[[0, 1, 5]], arm.home, arm.limits[:3], arm.joint_names[:3])
    assert "turn and slide as RRR" in find_family(spatial).reason
    coupled = Chain(
        "mimic",
        arm.screws,
        arm.home,
        arm.limits[:5],
        arm.joint_names[:5],
        coupling=np.vstack([np.eye(5), np.eye(5)[4]]),
    )
    assert "mimic" in find_family(coupled).reason


@pytest.mark.parametrize("name", ["ur5e", "kuka_kr210_robond", "kuka_youbot"])
@pytest.mark.parametrize("joints", [(2,), (1, 3), (0, 4), (0, 1, 2, 3, 4)])
def test_the_sign_of_a_joint_does_not_matter(name, joints):
    family = find_family(flipped(chain(name), joints))
    assert family.name == find_family(chain(name)).name
    assert family.level == "exact"
    assert family.self_test is not None
    assert family.self_test.passed


@pytest.mark.parametrize("name", [*WRIST, *THREE_PARALLEL, *FIVE_JOINTS])
def test_mirrored_arms_are_read_from_the_tip(name):
    family = find_family(backwards(chain(name)))
    assert family.has_closed_form
    assert family.level == "exact"
    assert family.self_test is not None
    assert family.self_test.passed


@pytest.mark.parametrize("name", ["ur5e", "kuka_kr210_robond", "so101"])
def test_base_tool_and_units_do_not_matter(name):
    arm = chain(name)
    T = exp(np.array([0.3, -2.0, 0.7, 1.0, 0.5, -0.2]))
    assert find_family(arm.with_base(T).with_tool(T)).level == "exact"
    for factor in (1e-3, 1e3):  # the same arm for ants, and in millimetres
        home = arm.home.copy()
        home[:3, 3] *= factor
        screws = arm.screws * np.array([factor] * 3 + [1.0] * 3)
        scaled = Chain(arm.name, screws, home, arm.limits, arm.joint_names)
        assert size_of(scaled) == pytest.approx(factor * size_of(arm), rel=1e-9)
        assert find_family(scaled).level == "exact"


@pytest.mark.parametrize("name", ["ur5e", "kuka_kr210_robond", "yaskawa_mh12", "puma560"])
def test_levels(name):
    arm = chain(name)
    rounded = find_family(disturbed(arm, 1e-6, 1e-6))
    assert rounded.level == "rounded"
    assert rounded.complete
    assert "rounded: off by" in rounded.reason
    assert 1e-9 < rounded.deviation < 1e-5
    assert rounded.self_test is not None
    assert rounded.self_test.passed
    calibrated = disturbed(arm, 1e-4, 1e-4)
    assert not find_family(calibrated).has_closed_form
    approximate = find_family(calibrated, approximate=True)
    assert approximate.level == "approximate"
    assert approximate.has_closed_form
    assert not approximate.complete


def test_a_closed_form_costs_milliseconds_not_accuracy():
    test = find_family(chain("kuka_kr210_robond")).self_test
    assert test is not None
    assert test.recall == 1.0
    assert test.grid == 1.0
    assert test.worst_error < 1e-14
