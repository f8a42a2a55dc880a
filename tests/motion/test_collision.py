"""Collision and distance, against Coal pair by pair, against MuJoCo, and by laws over every robot."""

from __future__ import annotations

import struct
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

import pieper
from pieper.errors import ArrayError, PieperWarning, UnknownNameError, WorldError
from pieper.kinematics.fk import fk_frames
from pieper.model import shape
from pieper.model.description import Box, Capsule, Cylinder, Mesh, Sphere
from pieper.motion.arm_solids import enclosing_capsule
from tests.motion.worlds import at, cluttered, post, states
from tests.robots import NAMES, chain

coal = pytest.importorskip("coal")

from pieper.motion.collision import CollisionModel, Nearest  # noqa: E402  needs coal
from pieper.motion.world import Item, World  # noqa: E402

AS_COAL = 2e-5  # [m] GJK of two cylinders stops there when their gap is wide
AS_MUJOCO = 2e-4  # [m] two iterative solvers with their own tolerances
ROUNDING = 1e-9  # [m]


def as_coal(solid):
    kinds = {
        Box: lambda: coal.Box(*solid.size),
        Cylinder: lambda: coal.Cylinder(solid.radius, solid.length),
        Capsule: lambda: coal.Capsule(solid.radius, solid.length),
        Sphere: lambda: coal.Sphere(solid.radius),
    }
    return kinds[type(solid)]()


def pair_distances(model: CollisionModel, q: np.ndarray) -> dict[tuple[str, str], float]:
    """Every pair of names that the model is to look at, measured solid by solid with Coal alone."""
    request = coal.DistanceRequest()
    moving = [(n, as_coal(s), coal.Transform3s(T[:3, :3], T[:3, 3])) for n, s, T in model.solids(q)]
    still = [(i.name, as_coal(i.solid), coal.Transform3s(i.pose[:3, :3], i.pose[:3, 3])) for i in model.world]
    base = model.chain.frame(0).name
    checked = {frozenset(pair) for pair in model.self_pairs.checked}
    found: dict[tuple[str, str], float] = {}
    pairs = [(m, s) for m in moving for s in still if m[0] != base]
    pairs += [(m, o) for m, o in combinations(moving, 2) if frozenset((m[0], o[0])) in checked]
    for (first, a, T_a), (second, b, T_b) in pairs:
        d = coal.distance(a, T_a, b, T_b, request, coal.DistanceResult())
        found[first, second] = min(found.get((first, second), np.inf), d)
    return found


@pytest.mark.parametrize("name", ["ur5e", "kr210", "panda", "youbot", "gen3"])
def test_distance_and_freedom_as_coal_pair_by_pair(name: str) -> None:
    arm = pieper.load(name)
    reach = shape.from_chain(arm.chain).length / 1.4
    model = CollisionModel(arm, cluttered(reach), margin=0.01)
    q = states(arm.chain, 60)
    free = model.is_free(q)
    assert 0 < free.sum() < len(q)
    for row, is_free in zip(q, free, strict=True):
        each = pair_distances(model, row)
        least = min(each.values())
        nearest = model.distance(row)
        assert nearest.distance == pytest.approx(least, abs=AS_COAL)
        named = min(
            each.get((nearest.first, nearest.second), np.inf), each.get((nearest.second, nearest.first), np.inf)
        )
        assert named == pytest.approx(least, abs=AS_COAL)
        if abs(least - model.margin) > AS_COAL:
            assert is_free == (least >= model.margin)
            assert bool(model.contacts(row)) == (least < model.margin)
        if least > AS_COAL:
            assert np.linalg.norm(nearest.p_first - nearest.p_second) == pytest.approx(least, abs=AS_COAL)


def test_distance_as_mujoco() -> None:
    mujoco = pytest.importorskip("mujoco")
    from benchmarks.shelves import Judge

    model = CollisionModel(pieper.load("ur5e"), cluttered(), margin=0.0)
    judge = Judge(model)
    items = {item.name for item in model.world}
    geoms = [judge.model.geom(g).name for g in range(judge.model.ngeom)]
    arm = [g for g, name in enumerate(geoms) if name not in items and not name.endswith(" base_link")]
    world = [g for g, name in enumerate(geoms) if name in items]
    checked = {frozenset(pair) for pair in model.self_pairs.checked}
    every = [(a, b) for a in range(len(geoms)) for b in range(a) if len({a, b} & set(world)) == 0]
    pairs = [(a, b) for a in arm for b in world]
    pairs += [(a, b) for a, b in every if frozenset((geoms[a].split(" ", 1)[1], geoms[b].split(" ", 1)[1])) in checked]
    seen = 0
    for q in states(model.chain, 60, seed=1):
        judge.data.qpos[:] = q
        mujoco.mj_kinematics(judge.model, judge.data)
        least = min(mujoco.mj_geomDistance(judge.model, judge.data, a, b, 10.0, None) for a, b in pairs)
        nearest = model.distance(q)
        if least > AS_MUJOCO:
            assert nearest.distance == pytest.approx(least, abs=AS_MUJOCO)
            seen += 1
        else:
            assert nearest.distance < 2.0 * AS_MUJOCO
            assert judge.touches(q) or least > -AS_MUJOCO
    assert seen > 5


@pytest.mark.parametrize("name", NAMES)
def test_a_batch_is_its_parts_in_any_shape(name: str) -> None:
    model = CollisionModel(chain(name), cluttered(shape.from_chain(chain(name)).length / 1.4))
    q = states(chain(name), 12)
    one_by_one = [model.is_free(row) for row in q]
    assert all(isinstance(answer, bool) for answer in one_by_one)
    np.testing.assert_array_equal(model.is_free(q.reshape(3, 1, 4, -1)), np.reshape(one_by_one, (3, 1, 4)))
    np.testing.assert_array_equal(model.is_free(q[::-1]), one_by_one[::-1])
    assert model.is_free(q[:0]).shape == (0,)


@pytest.mark.parametrize("name", NAMES)
def test_the_bounds_are_no_larger_than_the_distance(name: str) -> None:
    model = CollisionModel(chain(name), cluttered(shape.from_chain(chain(name)).length / 1.4))
    q = states(chain(name), 20)
    bounds = model.bounds(q, np.inf).min(axis=1)
    for row, bound in zip(q, bounds, strict=True):
        assert max(bound, 0.0) <= max(model.distance(row).distance, 0.0) + AS_COAL


@pytest.mark.parametrize("name", NAMES)
def test_every_pair_of_links_is_in_one_list(name: str) -> None:
    model = CollisionModel(chain(name))
    pairs = model.self_pairs
    lists = (pairs.checked, pairs.adjacent, pairs.always, pairs.never, pairs.allowed)
    listed = [frozenset(pair) for each in lists for pair in each]
    assert len(listed) == len(set(listed))
    assert set(listed) == {frozenset(pair) for pair in combinations(dict.fromkeys(model.names), 2)}


@pytest.mark.parametrize("name", NAMES)
def test_no_point_moves_farther_than_the_bound(name: str) -> None:
    model = CollisionModel(chain(name))
    random = np.random.default_rng(0)
    q = states(chain(name), 30)
    dq = random.normal(size=q.shape) * random.choice([1e-3, 0.1, 1.0], size=(30, 1))
    # within the limits of sliding joints, which the bound relies on
    slides = ~((model.chain.coupling != 0.0) & model.chain.is_revolute[:, None]).any(axis=0)
    dq[:, slides] = 0.0
    bound = model.displacement(dq)
    links = range(len(model.chain.screws) + 1)
    for share in (0.3, 1.0):
        before = fk_frames(model.chain, q, frames=links)
        after = fk_frames(model.chain, q + share * dq, frames=links)
        for each in model._moving_solids:
            mesh = shape.as_mesh(each.solid, sections=12)
            points = mesh.vertices @ each.T[:3, :3].T + each.T[:3, 3]
            p0 = np.einsum("kij,pj->kpi", before[:, each.body, :3, :3], points) + before[:, each.body, None, :3, 3]
            p1 = np.einsum("kij,pj->kpi", after[:, each.body, :3, :3], points) + after[:, each.body, None, :3, 3]
            moved = np.linalg.norm(p1 - p0, axis=2).max(axis=1)
            assert (moved <= bound[:, each.body] + ROUNDING).all()


@pytest.mark.parametrize("name", NAMES)
def test_no_point_moves_farther_as_seen_from_another_link(name: str) -> None:
    model = CollisionModel(chain(name))
    random = np.random.default_rng(1)
    q = states(chain(name), 30)
    dq = random.normal(size=q.shape) * random.choice([1e-3, 0.1, 1.0], size=(30, 1))
    dq[:, ~((model.chain.coupling != 0.0) & model.chain.is_revolute[:, None]).any(axis=0)] = 0.0
    bound = model.approach(dq)[:, len(model.chain.screws) + 1 :]
    links = range(len(model.chain.screws) + 1)
    before, after = (fk_frames(model.chain, values, frames=links) for values in (q, q + dq))
    for column, (low, high) in enumerate(model._groups):
        seen = [np.linalg.inv(Ts[:, low]) @ Ts[:, high] for Ts in (before, after)]
        for each in model._moving_solids:
            if each.body == high:
                mesh = shape.as_mesh(each.solid, sections=12)
                points = np.c_[mesh.vertices @ each.T[:3, :3].T + each.T[:3, 3], np.ones(len(mesh.vertices))].T
                moved = np.linalg.norm(((seen[1] - seen[0]) @ points)[:, :3], axis=1).max(axis=1)
                assert (moved <= bound[:, column] + ROUNDING).all()


@pytest.mark.parametrize("name", ["ur5e", "kr210", "panda"])
def test_moving_arm_and_world_together_changes_nothing(name: str) -> None:
    arm = pieper.load(name)
    T = at(0.3, -0.2, 0.5, (0.3, -0.7, 1.9))
    world = cluttered()
    moved = World(tuple(replace(item, T=T @ item.pose) for item in world))
    model, other = CollisionModel(arm, world), CollisionModel(arm.with_base(T), moved)
    for q in states(arm.chain, 15):
        assert other.distance(q).distance == pytest.approx(model.distance(q).distance, abs=AS_COAL)


@pytest.mark.parametrize(
    "solid",
    [
        Box([0.1, 0.5, 0.2]),
        Box([1.0, 1.0, 0.1]),
        Cylinder(0.2, 1.0),
        Cylinder(0.5, 0.1),
        Capsule(0.1, 0.4),
        Sphere(0.3),
    ],
)
def test_the_capsule_holds_the_solid(solid) -> None:
    a, b, radius, exact = enclosing_capsule(solid)
    points = shape.as_mesh(solid, sections=64).vertices
    along = np.clip((points - a) @ (b - a) / max((b - a) @ (b - a), 1e-300), 0.0, 1.0)
    apart = np.linalg.norm(points - a - along[:, None] * (b - a), axis=1)
    assert apart.max() <= radius + ROUNDING
    assert exact == isinstance(solid, Capsule | Sphere)


def stl(path: Path, size: float) -> Path:
    """A cube about the origin as a binary STL file."""
    mesh = shape.as_mesh(Box([size, size, size]))
    rows = b"".join(
        struct.pack("<12fH", 0, 0, 0, *mesh.vertices[face].ravel().astype(np.float32), 0) for face in mesh.faces
    )
    path.write_bytes(b"\0" * 80 + struct.pack("<I", len(mesh.faces)) + rows)
    return path


URDF = """<robot name="r">
  <link name="base"/>
  <link name="arm"><collision><origin xyz="0.5 0 0"/><geometry>{0}</geometry></collision></link>
  <link name="hand"><collision><origin xyz="0.2 0 0"/><geometry><sphere radius="0.1"/></geometry></collision></link>
  <link name="finger"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
  <joint name="a" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
  <joint name="b" type="revolute"><parent link="arm"/><child link="hand"/><origin xyz="1 0 0"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
  <joint name="f" type="prismatic"><parent link="hand"/><child link="finger"/><origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>
    <limit lower="0.02" upper="0.1" effort="1" velocity="1"/></joint>
</robot>"""


def test_the_meshes_of_a_description_are_used(tmp_path: Path) -> None:
    stl(tmp_path / "cube.stl", 200.0)
    (tmp_path / "r.urdf").write_text(URDF.format('<mesh filename="cube.stl" scale="0.001 0.001 0.001"/>'))
    arm = pieper.load(tmp_path / "r.urdf", tip="hand")
    model = CollisionModel(arm, World((Item("wall", Box([0.1, 4.0, 4.0]), at(0.0, 2.2, 0.0, (0, 0, np.pi / 2))),)))
    # the cube of 0.2 m reaches y = 0.6 with the arm along y; the finger ends at 1.45 and beside the chain at its lower limit
    up = model.distance([np.pi / 2, 0.0])
    assert (up.first, up.second) == ("finger", "wall")
    assert up.distance == pytest.approx(2.15 - 1.45, abs=1e-6)
    only_cube = CollisionModel(arm, World((Item("near", Box([0.1, 0.1, 0.1]), at(0.5, 0.3, 0.0)),)))
    assert only_cube.distance([0.0, 0.0]).distance == pytest.approx(0.25 - 0.1, abs=1e-6)
    assert {name for name, _, _ in model.solids([0.0, 0.0])} == {"arm", "hand", "finger"}


def test_a_missing_mesh_is_told_and_the_chain_is_used(tmp_path: Path) -> None:
    (tmp_path / "r.urdf").write_text(URDF.format('<mesh filename="nowhere.stl"/>'))
    with pytest.warns(PieperWarning, match="mesh not found"):
        arm = pieper.load(tmp_path / "r.urdf", tip="hand")
    with pytest.warns(PieperWarning, match=r"collision mesh 'nowhere.stl' of 'r' was not found.*capsules"):
        model = CollisionModel(arm)
    assert model.names[0] == "base"


def test_moving_links_that_nothing_could_notice_are_told() -> None:
    solid = URDF.format('<box size="0.2 0.2 0.2"/>')
    whole = pieper.load(solid, tip="hand")
    CollisionModel(whole)  # no warning
    start, end = solid.index('<link name="hand">'), solid.index('<joint name="a"')
    bare = solid[:start] + '<link name="hand"/><link name="finger"/>\n' + solid[end:]
    with pytest.warns(
        PieperWarning, match="no collision geometry for hand, finger of 'r': nothing notices what they touch; give"
    ):
        CollisionModel(pieper.load(bare, tip="hand"))
    drawn = solid.replace("<collision>", "<visual>", 1).replace("</collision>", "</visual>", 1)
    with pytest.warns(PieperWarning, match="no collision geometry for arm of 'r': nothing notices what it touches"):
        CollisionModel(pieper.load(drawn, tip="hand"))
    empty = (
        solid[: solid.index('<link name="arm">')] + '<link name="arm"/>' + solid[solid.index('<link name="hand">') :]
    )
    CollisionModel(pieper.load(empty, tip="hand"))  # a frame between two axes, not drawn: no warning


def test_a_mesh_of_the_world_is_its_surface(tmp_path: Path) -> None:
    file = stl(tmp_path / "cube.stl", 1.0)
    item = Item("cube", Mesh("cube.stl", np.ones(3), str(file)), at(2.0, 0.0, 0.5))
    arm = pieper.load("ur5e")
    as_mesh = CollisionModel(arm, World((item,)))
    as_box = CollisionModel(arm, World((replace(item, solid=Box([1.0, 1.0, 1.0])),)))
    for q in states(arm.chain, 20):
        assert as_mesh.distance(q).distance == pytest.approx(as_box.distance(q).distance, abs=AS_COAL)
    broken = tmp_path / "broken.stl"
    broken.write_bytes(b"solid")
    with pytest.raises(WorldError, match=r"mesh 'cube': .*broken.stl (cannot be read|has no finite corners)"):
        CollisionModel(arm, World((replace(item, solid=Mesh("broken.stl", np.ones(3), str(broken))),)))
    broken.write_bytes(b"no mesh")
    with pytest.raises(WorldError) as refused:
        CollisionModel(arm, World((replace(item, solid=Mesh("broken.stl", np.ones(3), str(broken))),)))
    message = str(refused.value)
    assert message.startswith(f"mesh 'cube': {broken} cannot be read: ")
    assert message.endswith("; give an STL, OBJ, PLY or DAE file")
    assert ".cpp" not in message  # the place in the source of the reader tells nobody anything
    assert "void" not in message


Q = np.array([0.3, -1.2, 1.4, -1.7, -1.57, 0.0])


def test_what_is_grasped_moves_with_the_hand() -> None:
    arm = pieper.load("ur5e")
    T_tip = arm.fk(Q)
    can = Item("can", Cylinder(0.03, 0.1), T_tip @ at(0.0, 0.0, 0.09), may_touch=("gripper", "table"))
    table = Item("table", Box([1.0, 1.0, 0.02]), at(0.6, 0.0, T_tip[2, 3] - 0.16))
    gripper = Item("gripper", Box([0.08, 0.08, 0.06]), at(0.0, 0.0, 0.03))
    model = CollisionModel(arm, World((can, table)), tool=gripper, margin=0.005)
    assert model.is_free(Q)  # the gripper may touch the can
    held = model.grasp("can", Q)
    assert held.world.names == ("table",)
    moved = Q + np.array([0.5, 0.0, 0.0, 0.0, 0.3, 0.0])
    where = {name: T for name, _, T in held.solids(moved)}["can"]
    np.testing.assert_allclose(where, arm.fk(moved) @ at(0.0, 0.0, 0.09), atol=1e-12)
    back = held.release("can", moved)
    np.testing.assert_allclose(back.world["can"].pose, where, atol=1e-12)
    ball = Item("ball", Sphere(0.02), where @ at(0.0, 0.0, 0.05))
    assert not held.with_world(World((ball,))).is_free(moved)
    assert held.with_world(World((ball,))).distance(moved).first in ("can", "ball")
    with pytest.raises(UnknownNameError, match="no item 'cup' in the grasp"):
        held.release("cup", Q)


def test_allowed_pairs_are_not_looked_at() -> None:
    arm = pieper.load("ur5e")
    model = CollisionModel(arm, post())
    q = [0.0, -1.2, 1.2, 0.0, 0.0, 0.0]
    touching = {pair.first for pair in model.contacts(q)}
    assert touching
    assert CollisionModel(arm, post(), allowed=[(name, "post") for name in touching]).is_free(q)


def test_a_nearest_pair_speaks() -> None:
    model = CollisionModel(pieper.load("ur5e"), post())
    assert " mm inside post" in str(model.distance([0.0, -1.2, 1.2, 0.0, 0.0, 0.0]))
    assert str(Nearest(0.0123, "hand", "post", np.zeros(3), np.zeros(3))) == "hand is 12.3 mm from post"


def test_what_is_malformed_is_refused() -> None:
    arm = pieper.load("ur5e")
    with pytest.raises(WorldError, match=r"margin must be a finite distance of at least 0 \[m\], got -1"):
        CollisionModel(arm, margin=-1.0)
    with pytest.raises(WorldError, match="margin must be"):
        CollisionModel(arm, margin=np.nan)
    with pytest.raises(UnknownNameError, match=r"no name 'forarm_link'.*did you mean 'forearm_link'"):
        CollisionModel(arm, allowed=[("forarm_link", "wrist_1_link")])
    with pytest.raises(WorldError, match="'forearm_link' is the name of two"):
        CollisionModel(arm, World((Item("forearm_link", Sphere(0.1)),)))
    model = CollisionModel(arm)
    with pytest.raises(ArrayError, match="finite"):
        model.is_free([0.0, np.nan, 0.0, 0.0, 0.0, 0.0])
    with pytest.raises(ArrayError, match="shape"):
        model.is_free([0.0, 0.0])
    with pytest.raises(ArrayError, match=r"q must have shape \(6,\), got \(2, 6\)"):
        model.distance(np.zeros((2, 6)))


def test_without_coal_the_message_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    from pieper.errors import MissingExtraError

    monkeypatch.setitem(sys.modules, "coal", None)
    with pytest.raises(MissingExtraError, match=r"coal is not installed.*pip install 'pieper\[plan\]'"):
        CollisionModel(pieper.load("ur5e"))


@pytest.mark.parametrize("name", ["ur5e", "kr210", "youbot"])
def test_a_model_in_another_world_is_the_one_made_there(name: str) -> None:
    arm = pieper.load(name)
    reach = CollisionModel(arm).reach_bound
    can = Item("can in hand", Cylinder(0.02, 0.1), at(0, 0, 0.1), may_touch=("ball",))
    options = {"attached": [can], "tool": [Item("hand", Box([0.05, 0.05, 0.08]), at(0, 0, 0.04))], "margin": 0.02}
    allowed = [(can.name, "floor")]
    first = CollisionModel(arm, cluttered(reach), **options, allowed=allowed)
    other = World(
        tuple(replace(item, T=item.pose @ at(0.1, 0.2, 0.0)) for item in cluttered(reach) if item.name != "floor")
    )
    moved, fresh = first.with_world(other), CollisionModel(arm, other, **options)
    assert moved.self_pairs == fresh.self_pairs
    assert (moved.names, moved.allowed) == (fresh.names, ())
    q = states(arm.chain, 100)
    np.testing.assert_array_equal(moved.bounds(q, np.inf), fresh.bounds(q, np.inf))
    np.testing.assert_array_equal(
        first.is_free(q), CollisionModel(arm, cluttered(reach), **options, allowed=allowed).is_free(q)
    )
    with pytest.raises(WorldError, match="'hand' is the name of two"):
        first.with_world(World((Item("hand", Sphere(0.1)),)))


@pytest.mark.parametrize("name", NAMES)
def test_a_smaller_margin_frees_more_states(name: str) -> None:
    """Which links are looked at must not change when less is asked for; that a Panda's second and fourth link meet at every margin."""
    wide = CollisionModel(chain(name), margin=0.01)
    least = CollisionModel(chain(name), margin=0.0)
    assert least.self_pairs == wide.self_pairs
    widest = wide.with_margin(min(0.03, 0.09 * wide.reach_bound))
    assert widest.with_margin(0.002).self_pairs == widest.self_pairs
    q = states(wide.chain, 100)
    free = [model.is_free(q) for model in (widest, widest.with_margin(0.002), wide, wide.with_margin(0.005), least)]
    assert (free[1] >= free[0]).all()
    assert (free[3] >= free[2]).all()
    assert (free[4] >= free[3]).all()
