"""What is counted in a voxel is what solving its poses one by one gives, on every kind of arm."""

from __future__ import annotations

import numpy as np
import pytest

import pieper
from pieper.errors import ArrayError, MapError
from pieper.ik.target import position_and_axis
from pieper.kinematics.jacobian import jacobian
from pieper.kinematics.reach import extent
from pieper.workspace.measure import QUANTITIES, Measurer
from pieper.workspace.orientations import spread_directions, spread_rotations, spread_turns
from pieper.workspace.survey import LINE, Survey, survey
from tests.robots import NAMES, chain

FLOAT32 = 1e-6  # what single precision leaves of a number


def one_by_one(asked: Survey, centre: np.ndarray) -> dict[str, float]:
    """The same of one voxel, from answers to one pose after the other."""
    arm = asked.chain
    solver = pieper.load(arm)
    kept, counts = [], []
    for i in range(asked.samples):
        if asked.kind == "directions":
            answers = solver.ik(position_and_axis(centre, asked.directions()[i], axis_tip=LINE))
        else:
            T = np.eye(4)
            T[:3, :3], T[:3, 3] = asked.rotations()[i], centre
            answers = solver.ik(T)
        inside = answers.q[answers.within_limits]
        counts.append(len(inside))
        kept += list(inside)
    if not kept:
        return {"reached": 0, "solutions": 0, "most_solutions": 0}
    lower, upper = arm.limits.T
    singular = [np.linalg.svd(jacobian(arm, q), compute_uv=False) for q in kept]
    measures = [float(np.prod(s)) for s in singular]
    return {
        "reached": int(np.count_nonzero(counts)),
        "solutions": sum(counts),
        "most_solutions": max(counts),
        "manipulability": max(measures),
        "singularity": max(
            s.min() for s, m in zip(singular, measures, strict=True) if m > max(measures) * (1.0 - 1e-9)
        ),
        "limit_margin": max(float(np.minimum(q - lower, upper - q).min()) for q in kept),
    }


@pytest.mark.parametrize("name", ["ur5e", "kuka_kr210_robond", "yaskawa_mh12", "kuka_youbot", "fanuc_crx10ia"])
def test_a_voxel_holds_what_its_poses_have_one_by_one(name: str) -> None:
    arm = chain(name)
    size = 0.25 * float(np.abs(arm.home[:3, 3]).max() + 0.3)
    asked = survey(arm, voxel=size, orientations=12, box=[[size, 0.0, size], [2.0 * size, size, 2.0 * size]])
    found = Measurer(asked).chunk(0)
    some = 0
    for place, centre in zip(np.ndindex(asked.grid.shape), asked.grid.centres(0), strict=True):
        expected = one_by_one(asked, centre)
        some += expected["reached"]
        for quantity, value in expected.items():
            assert float(found[quantity][place]) == pytest.approx(value, rel=FLOAT32, abs=FLOAT32), quantity
    assert some > 0


def test_seven_joints_count_branches_at_one_value_of_the_joint_that_is_held() -> None:
    arm = chain("franka_panda")
    asked = survey(arm, voxel=0.1, orientations=8, redundancy=6, box=[[0.4, 0.0, 0.4], [0.4, 0.1, 0.4]])
    found = Measurer(asked).chunk(0)
    from pieper.ik import redundancy

    values = redundancy.prepare(arm).samples(6)
    for place, centre in zip(np.ndindex(asked.grid.shape), asked.grid.centres(0), strict=True):
        T = np.tile(np.eye(4), (8, 1, 1))
        T[:, :3, :3], T[:, :3, 3] = asked.rotations(), centre
        counts = np.array([pieper.load(arm).ik(T, redundancy=[v]).within_limits.sum(axis=1) for v in values])
        assert found["reached"][place] == np.count_nonzero(counts.sum(axis=0))
        assert found["most_solutions"][place] == counts.max()
        assert found["solutions"][place] == counts.max(axis=0).sum()
    assert "panda_joint7" in asked.words


@pytest.mark.parametrize("name", NAMES)
def test_every_arm_can_be_asked(name: str) -> None:
    size = 0.25 * float(np.ptp(extent(chain(name)), axis=0).min())
    asked = survey(chain(name), voxel=size, orientations=3, redundancy=2, chunk=3)
    found = [Measurer(asked).chunk(k) for k in range(asked.grid.chunks)]
    assert max(int(each["reached"].max()) for each in found) > 0
    for each in found:
        reached = each["reached"] > 0
        assert set(each) == set(QUANTITIES)
        assert (each["solutions"] >= each["reached"]).all()
        assert (np.isnan(each["manipulability"]) == ~reached).all()
        assert (each["limit_margin"][reached] >= 0.0).all()


def test_chunks_of_any_size_hold_the_same() -> None:
    arm = chain("ur5e")
    box = [[0.2, -0.3, 0.1], [0.7, 0.3, 0.4]]
    whole = survey(arm, voxel=0.1, orientations=30, box=box, chunk=100)
    parts = survey(arm, voxel=0.1, orientations=30, box=box, chunk=2)
    at_once = Measurer(whole).chunk(0)
    measurer = Measurer(parts)
    for k in range(parts.grid.chunks):
        for name, array in measurer.chunk(k).items():
            assert array.tobytes() == at_once[name][parts.grid.slices(k)].tobytes()


def test_collisions_take_answers_away() -> None:
    arm = pieper.load("ur5e")
    box = [[0.1, 0.0, 0.1], [0.3, 0.0, 0.3]]
    touching = Measurer(survey(arm, voxel=0.1, orientations=10, box=box)).chunk(0)
    asked = survey(arm, voxel=0.1, orientations=10, box=box, collision=True)
    free = Measurer(asked).chunk(0)
    assert (free["solutions"] <= touching["solutions"]).all()
    assert free["solutions"].sum() < touching["solutions"].sum()
    assert "nothing touching" in asked.words


def test_a_tool_moves_the_map() -> None:
    arm = pieper.load("ur5e")
    T = np.eye(4)
    T[2, 3] = 0.2
    far = [[1.05, 0.0, 0.2], [1.05, 0.0, 0.2]]
    with_tool = Measurer(survey(arm.with_tool(T), voxel=0.05, orientations=300, box=far)).chunk(0)
    assert with_tool["reached"].max() > 0
    with pytest.raises(
        ArrayError, match=r"the box is outside the reach of 'ur5e', whose tip gets to x from -0\.\d+ to"
    ):
        survey(arm, voxel=0.05, box=far)


def test_orientations_are_rotations_spread_evenly_and_always_the_same() -> None:
    R = spread_rotations(300)
    assert np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max() < 1e-12
    assert np.linalg.det(R).min() > 0.0
    assert spread_rotations(300).tobytes() == R.tobytes()
    turned = spread_rotations(300, seed=7)
    assert turned.tobytes() == spread_rotations(300, seed=7).tobytes()
    # turned all together: the angles between them stay
    assert np.allclose(R[0].T @ R, turned[0].T @ turned, atol=1e-12)
    # and none is alone, nor a twin: for random ones the nearest of 300 is 10 times nearer in places
    cosine = 0.5 * (np.einsum("aij,bij->ab", R, R) - 1.0)
    np.fill_diagonal(cosine, -1.0)
    nearest = np.degrees(np.arccos(np.clip(cosine.max(axis=1), -1.0, 1.0)))
    assert nearest.min() > 15.0
    assert nearest.max() < 40.0
    assert np.allclose(np.linalg.norm(spread_directions(50, seed=3), axis=1), 1.0, atol=1e-12)
    assert spread_turns(5, np.array([0.0, 0.0, 1.0]), seed=2).shape == (5, 3, 3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"voxel": 0.0}, r"voxel must be a positive length \[m\], got 0\.0"),
        ({"voxel": -0.1}, "voxel must be a positive length"),
        ({"voxel": float("nan")}, "voxel must be a positive length"),
        ({"voxel": 1e-12}, "are too many; take larger voxels"),
        ({"orientations": 0}, "orientations must be a whole number of at least 1, got 0"),
        ({"orientations": 2.5}, "orientations must be a whole number"),
        ({"chunk": 0}, "chunk must be a whole number of at least 1, got 0"),
        ({"seed": -1}, "seed must be a whole number of at least 0"),
        ({"redundancy": 0}, "redundancy must be a whole number of at least 1"),
        ({"margin": -0.1}, "margin must be a distance of at least 0"),
        ({"box": [[0, 0, 0], [1, 1]]}, r"box must be finite with shape \(2, 3\)"),
        ({"box": [[0, 0, 0], [1, 1, np.inf]]}, r"box must be finite with shape \(2, 3\)"),
        ({"box": [[1, 0, 0], [0, 1, 1]]}, "along x it goes backwards"),
        ({"box": [[5, 5, 5], [6, 6, 6]]}, "the box is outside the reach of 'ur5e'"),
        ({"layer": ("y", 3.0)}, "the layer is outside the reach of 'ur5e'"),
        ({"layer": ("w", 0.0)}, "an axis is x, y or z, got 'w'"),
        ({"layer": ("y", float("nan"))}, "a layer is at a finite coordinate"),
    ],
)
def test_bad_questions_are_refused_in_words(options: dict, message: str) -> None:
    with pytest.raises(ArrayError, match=message):
        survey(chain("ur5e"), **options)


def test_arms_without_a_complete_solver_are_refused() -> None:
    from pieper.model.chain import Chain

    with pytest.raises(ArrayError, match="no joints"):
        survey(Chain("rod", np.empty((0, 6)), np.eye(4), np.empty((0, 2)), ()))
    eight = np.random.default_rng(0).standard_normal((8, 6))
    eight[:, 3:] /= np.linalg.norm(eight[:, 3:], axis=1)[:, None]
    for row in eight:
        row[:3] -= row[3:] * (row[:3] @ row[3:])
    arm = Chain("snake", eight, np.eye(4), [[-3, 3]] * 8, tuple(f"j{i}" for i in range(8)))
    with pytest.raises(ArrayError, match="no complete solver takes 'snake' with 8 joints; lock all but seven first"):
        survey(arm)


def test_instructions_that_the_processor_does_not_have_are_refused() -> None:
    from dataclasses import replace

    with pytest.raises(
        MapError, match="the map is made with the instructions 'abacus', which this processor does not have"
    ):
        Measurer(replace(survey(chain("ur5e"), voxel=0.5), instructions="abacus"))


def test_what_stands_around_takes_answers_away() -> None:
    """In each voxel of a world those answers are left that its collision model calls free, and an empty one takes none."""
    from pieper.model.description import Box
    from pieper.motion.collision import CollisionModel
    from pieper.motion.world import Item, World

    arm = pieper.load("ur5e")
    T = np.eye(4)
    T[:3, 3] = [0.5, 0.3, 0.0]
    around = World((Item("table", Box([0.6, 0.6, 0.4]), T),))
    options = {"voxel": 0.2, "orientations": 6, "box": [[0.2, 0.0, 0.2], [0.6, 0.2, 0.4]]}
    alone = Measurer(survey(arm, collision=True, **options)).chunk(0)
    empty = Measurer(survey(arm, world=World(), **options)).chunk(0)
    asked = survey(arm, world=around, **options)
    found = Measurer(asked).chunk(0)
    for name in QUANTITIES:
        assert empty[name].tobytes() == alone[name].tobytes()
    model = CollisionModel(arm, around, margin=0.0)
    for place, centre in zip(np.ndindex(asked.grid.shape), asked.grid.centres(0), strict=True):
        poses = np.tile(np.eye(4), (6, 1, 1))
        poses[:, :3, :3], poses[:, :3, 3] = asked.rotations(), centre
        answers = arm.ik(poses)
        expected = sum(int(model.is_free(q)) for q in answers.q[answers.within_limits])
        assert found["solutions"][place] == expected
    assert 0 < found["solutions"].sum() < alone["solutions"].sum()
    assert "nothing touching among 1 obstacles" in asked.words
    # a map among other obstacles is another map
    assert len({survey(arm, world=world, **options).record()["solids"] for world in (around, World())}) == 2
