"""The shape of an arm: laws that hold for every robot, and for arms that are not built in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pieper.errors import ArrayError
from pieper.kinematics.fk import fk_frames
from pieper.model import shape
from pieper.model.chain import Chain, Frame
from pieper.model.description import Box, Capsule, Cylinder, Sphere
from pieper.model.dh import from_dh
from pieper.model.shape import Drum, Taper
from pieper.spatial import twist
from tests.degenerate_arms import degenerate_arm
from tests.robots import NAMES, chain

TOUCHING = 1e-9  # [arm lengths] rounding in composed poses, many times over
ROUND = 0.02  # a circle of 48 corners is that much smaller at most: 1 - cos(pi / 48) = 0.2 %, squared and with poles


def at(*position):
    T = np.eye(4)
    T[:3, 3] = position
    return T


def scara():
    frames = [
        ("base", 0, (0, 0, 0)),
        ("one", 1, (0, 0, 0.2)),
        ("two", 2, (0.325, 0, 0.35)),
        ("three", 3, (0.6, 0, 0.3)),
    ]
    frames += [("four", 4, (0.6, 0, 0.2)), ("tool", 4, (0.6, 0, 0.15))]
    screws = [[0, 0, 0, 0, 0, 1], [0, -0.325, 0, 0, 0, 1], [0, 0, 1, 0, 0, 0], [0, -0.6, 0, 0, 0, 1]]
    limits = [[-2, 2], [-2.5, 2.5], [-0.18, 0], [-3, 3]]
    return Chain("scara", screws, at(0.6, 0, 0.15), limits, "abcd", frames=[Frame(n, k, at(*p)) for n, k, p in frames])


def scara_by_screws():
    given = scara()
    return Chain("scara by screws", given.screws, given.home, given.limits, given.joint_names)


def gantry():
    screws = [[1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0], [0, 0, -1, 0, 0, 0]]
    home = at(0.0, 0.0, 1.1)
    frames = [Frame("base", 0, np.eye(4)), *(Frame(f"axis_{k}", k, at(0, 0, 1.4)) for k in (1, 2, 3))]
    frames.append(Frame("tool", 3, home))
    return Chain("gantry", screws, home, [[-1, 1], [-0.6, 0.6], [0, 0.8]], "xyz", frames=frames)


def lift():
    """A column that carries two links, without limits."""
    screws = [[0, 0, 1, 0, 0, 0], [0, -0.3, 0, 0, 0, 1], [0, -0.6, 0, 0, 0, 1]]
    return Chain("lift", screws, at(0.9, 0, 0.2), np.full((3, 2), [-np.inf, np.inf]), "abc")


def stanford():
    screws = [[0, 0, 0, 0, 0, 1], [-0.4, 0, 0, 0, 1, 0], [1, 0, 0, 0, 0, 0], [0, 0.4, 0.15, 1, 0, 0]]
    return Chain("stanford", screws, at(0.5, 0.15, 0.4), [[-3, 3], [-2, 2], [0.1, 0.6], [-3, 3]], "abcd")


def jaco2():
    """JACO2 with a curved wrist: Kinova's parameters D1 .. D6, e2 [m] and the angle of the wrist, 30 deg."""
    d1, d2, d3, d4, d5, d6, e2 = 0.2755, 0.41, 0.2073, 0.0741, 0.0741, 0.16, 0.0098
    half, whole = np.sin(np.pi / 6), np.sin(np.pi / 3)
    d4b, d5b, d6b = d3 + half / whole * d4, half / whole * (d4 + d5), half / whole * d5 + d6
    rows = zip(
        [0, d2, 0, 0, 0, 0],
        [np.pi / 2, np.pi, np.pi / 2, np.pi / 3, np.pi / 3, np.pi],
        [d1, 0, -e2, -d4b, -d5b, -d6b],
        strict=True,
    )
    return from_dh([{"a": a, "alpha": alpha, "d": d, "theta": 0.0} for a, alpha, d in rows], convention="standard")


def point_arm():
    """Three axes and the tip in one point."""
    return Chain("point", np.eye(6)[3:], np.eye(4), np.full((3, 2), [-np.pi, np.pi]), "abc")


def no_joints():
    return Chain("post", [], at(0.0, 0.1, 0.5), [], ())


OTHERS = {make.__name__: make for make in (scara, scara_by_screws, gantry, lift, stanford, jaco2, point_arm, no_joints)}
EVERY = (*NAMES, *OTHERS)


def arm_of(name):
    return OTHERS[name]() if name in OTHERS else chain(name)


def poses(arm, q):
    return fk_frames(arm, q, frames=range(len(arm.screws) + 1))


def random_q(arm, rng, count=8):
    """Joint values within the limits; sliding joints without limits stay where the shape draws their rails."""
    size = 0.25 * shape.from_chain(arm).length
    width = np.where(arm.is_revolute, np.pi, size)
    low, high = np.clip(arm.limits.T, -width, width)
    return rng.uniform(low, high, (count, arm.dof))


def distance_inside(solid, points):
    """(k,) how far points in the frame of a solid are inside it, negative outside: exact enough to tell which."""
    if isinstance(solid, Box):
        return (0.5 * solid.size - np.abs(points)).min(axis=-1)
    radius, z = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
    if isinstance(solid, Sphere):
        return solid.radius - np.linalg.norm(points, axis=-1)
    if isinstance(solid, Drum):
        return np.minimum(solid.radius - solid.rim - radius, 0.5 * solid.length - np.abs(z))
    along = np.clip(z / solid.length + 0.5, 0.0, 1.0)
    return solid.radius + along * (solid.end_radius - solid.radius) - np.hypot(radius, z - (along - 0.5) * solid.length)


def core(part):
    """(k, 4) homogeneous points along the middle of a part, in the frame of its link."""
    size = part.solid.size[2] if isinstance(part.solid, Box) else getattr(part.solid, "length", 0.0)
    points = np.zeros((101, 4))
    points[:, 2], points[:, 3] = np.linspace(-0.5, 0.5, 101) * size, 1.0
    return points @ part.T_link_part.T


@pytest.mark.parametrize("name", EVERY)
def test_every_link_has_parts_of_bounded_size(name):
    arm = arm_of(name)
    form = shape.from_chain(arm)
    assert {part.link for part in form.parts} == set(range(len(arm.screws) + 1))
    assert {"base", "flange", "mark"} <= {part.role for part in form.parts} <= set(shape.ROLES)
    for part in form.parts:
        assert np.isfinite(part.T_link_part).all()
        assert not part.T_link_part.flags.writeable
        sizes = part.solid.size[:2] if isinstance(part.solid, Box) else [part.solid.radius]
        assert all(0.001 * form.length < size < 0.15 * form.length for size in sizes)
        assert 0.0 < getattr(part.solid, "length", 1.0) <= max(1.5 * form.length, 1.0)


@pytest.mark.parametrize("name", EVERY)
def test_links_hold_together_wherever_the_joints_are(name):
    arm = arm_of(name)
    form = shape.from_chain(arm)
    for q in random_q(arm, np.random.default_rng(1)):
        Ts = poses(arm, q)
        for link in range(1, len(arm.screws) + 1):
            inside = [
                distance_inside(there.solid, (points @ np.linalg.inv(Ts[b] @ there.T_link_part).T)[:, :3]).max()
                for a, b in ((link - 1, link), (link, link - 1))
                for here in form.of_link(a)
                for points in [core(here) @ Ts[a].T]
                for there in form.of_link(b)
            ]
            assert max(inside) > -TOUCHING * form.length


@pytest.mark.parametrize("name", EVERY)
def test_parts_of_a_link_hold_together(name):
    form = shape.from_chain(arm_of(name))
    for link in {part.link for part in form.parts}:
        parts = form.of_link(link)
        touching = np.eye(len(parts), dtype=bool)
        for i, here in enumerate(parts):
            for j, there in enumerate(parts):
                points = (core(here) @ np.linalg.inv(there.T_link_part).T)[:, :3]
                if distance_inside(there.solid, points).max() > -TOUCHING * form.length:
                    touching[i, j] = touching[j, i] = True
        assert (np.linalg.matrix_power(touching.astype(float), len(parts)) > 0).all()


@pytest.mark.parametrize("name", EVERY)
def test_parts_move_with_the_axes_before_them(name):
    arm = arm_of(name)
    q = random_q(arm, np.random.default_rng(2), 1)[0]
    home, moved = poses(arm, np.zeros(arm.dof)), poses(arm, q)
    for part in shape.from_chain(arm).parts:
        T = np.eye(4)
        for screw, value in zip(arm.screws[: part.link], arm.coupling @ q, strict=False):
            T = T @ twist.exp(screw * value)
        np.testing.assert_allclose(
            moved[part.link] @ part.T_link_part, T @ home[part.link] @ part.T_link_part, atol=1e-12
        )


@pytest.mark.parametrize("name", [name for name in EVERY if name != "point_arm"])
@pytest.mark.parametrize("factor", [1e-3, 7.0])
def test_a_larger_arm_has_a_larger_shape(name, factor):
    arm = arm_of(name)
    slides = (arm.coupling[~arm.is_revolute] != 0.0).any(axis=0) if arm.dof else np.zeros(0, dtype=bool)

    def scaled(T):
        T = T.copy()
        T[:3, 3] *= factor
        return T

    large = replace(
        arm,
        screws=arm.screws * np.where(arm.is_revolute[:, None], [factor] * 3 + [1.0] * 3, 1.0),
        home=scaled(arm.home),
        limits=np.where(slides[:, None], arm.limits * factor, arm.limits),
        frames=tuple(Frame(f.name, f.after, scaled(f.home)) for f in arm.frames),
    )
    small_form, large_form = shape.from_chain(arm), shape.from_chain(large)
    assert large_form.length == pytest.approx(factor * small_form.length, rel=1e-9)
    for small, other in zip(small_form.parts, large_form.parts, strict=True):
        assert (small.link, small.role) == (other.link, other.role)
        np.testing.assert_allclose(
            shape.as_mesh(other, sections=6).vertices,
            factor * shape.as_mesh(small, sections=6).vertices,
            atol=1e-9 * factor * small_form.length,
        )


@pytest.mark.parametrize("name", EVERY)
def test_the_arm_stays_within_its_length(name):
    arm = arm_of(name)
    form = shape.from_chain(arm)
    foot = next(frame.home for frame in reversed(arm.frames) if frame.after == 0)[:3, 3]
    for Ts in poses(arm, random_q(arm, np.random.default_rng(3))):
        for part in form.parts:
            vertices = shape.as_mesh(part, sections=8).vertices @ Ts[part.link, :3, :3].T + Ts[part.link, :3, 3]
            assert np.linalg.norm(vertices - foot, axis=-1).max() < 1.15 * form.length


@pytest.mark.parametrize("name", EVERY)
def test_the_flange_ends_at_the_tip_or_carries_a_tool_there(name):
    arm = arm_of(name)
    form = shape.from_chain(arm)
    tip = np.linalg.inv(arm.frame(len(arm.screws)).home) @ arm.home[:, 3]
    ends = [part for part in form.of_link(len(arm.screws)) if part.role in ("flange", "tool")]
    points = np.vstack([core(part)[[0, -1]] for part in ends])
    assert np.linalg.norm(points - tip, axis=-1).min() < 1e-9 * form.length


@pytest.mark.parametrize("name", EVERY)
def test_the_mark_points_along_the_tools_x_axis(name):
    arm = arm_of(name)
    (mark,) = (part for part in shape.from_chain(arm).parts if part.role == "mark")
    T_base_mark = arm.frame(len(arm.screws)).home @ mark.T_link_part
    np.testing.assert_allclose(T_base_mark[:3, 2], arm.home[:3, 0], atol=1e-9)


@pytest.mark.parametrize("name", ["mh12", "ur5e", "iiwa14", "puma560", "franka_panda"])
def test_a_housing_lies_on_every_turning_axis(name):
    arm = chain({"mh12": "yaskawa_mh12", "iiwa14": "kuka_iiwa14"}.get(name, name))
    form = shape.from_chain(arm)
    for axis, screw in enumerate(arm.screws):
        direction, point = screw[3:], np.cross(screw[3:], screw[:3])
        found = False
        for part in form.parts:
            T = arm.frame(part.link).home @ part.T_link_part
            along = abs(float(T[:3, 2] @ direction))
            off = float(np.linalg.norm(np.cross(T[:3, 3] - point, direction)))
            found |= (
                isinstance(part.solid, Drum) and part.link == axis + 1 and along > 0.999 and off < 1e-3 * form.length
            )
        assert found, f"no housing on axis {axis + 1}"


@given(st.data())
@settings(max_examples=100)
def test_an_arm_that_no_one_would_build_is_drawn_all_the_same(data):
    """Axes that coincide, are skew, or nearly parallel: parts stay finite, near the arm, and hold together at home."""
    arm = degenerate_arm(
        lambda k: data.draw(st.integers(0, k - 1)), lambda: data.draw(st.floats(-1.0, 1.0)), data.draw(st.integers(1, 7)),
        slides=data.draw(st.booleans()),
    )  # fmt: skip
    form = shape.from_chain(arm)
    assert {part.link for part in form.parts} == set(range(len(arm.screws) + 1))
    homes = [arm.frame(link).home for link in range(len(arm.screws) + 1)]
    for part in form.parts:
        mesh = shape.as_mesh(part, sections=6)
        assert np.isfinite(mesh.vertices).all()
        points = mesh.vertices @ homes[part.link][:3, :3].T + homes[part.link][:3, 3]
        assert np.linalg.norm(points, axis=-1).max() <= 1.2 * form.length
    for link in range(1, len(arm.screws) + 1):
        inside = [
            distance_inside(there.solid, (points @ np.linalg.inv(homes[b] @ there.T_link_part).T)[:, :3]).max()
            for a, b in ((link - 1, link), (link, link - 1))
            for here in form.of_link(a)
            for points in [core(here) @ homes[a].T]
            for there in form.of_link(b)
        ]
        assert max(inside) > -1e-6 * form.length


def test_axes_that_one_joint_moves_are_drawn_each():
    """A telescope: two slides that follow one joint, the second twice as far."""
    screws = [[0, 0, 1, 0, 0, 0], [0, 0, 1, 0, 0, 0], [0, 0, 0, 0, 0, 1]]
    coupling = [[1.0, 0.0], [2.0, 0.0], [0.0, 1.0]]
    arm = Chain("telescope", screws, at(0.0, 0.0, 1.0), [[0.0, 0.4], [-3.0, 3.0]], "ab", coupling=coupling)
    form = shape.from_chain(arm)
    assert {part.link for part in form.parts} == {0, 1, 2, 3}
    assert form.length == pytest.approx(1.0 + 0.4 + 0.8)


def test_links_side_by_side_do_not_meet():
    """The upper arm and the forearm of a UR5e are beside each other, so that it can fold."""
    arm = chain("ur5e")
    form = shape.from_chain(arm)
    bars = [next(p for p in form.of_link(link) if isinstance(p.solid, Taper)) for link in (2, 3)]
    level = [float((arm.frame(p.link).home @ p.T_link_part)[1, 3]) for p in bars]
    assert abs(level[0] - level[1]) == pytest.approx(0.1333, abs=1e-4)
    assert bars[0].solid.radius + bars[1].solid.radius < 0.1333


def test_a_tool_of_ones_own_is_drawn_from_the_flange_to_its_tip():
    arm = chain("ur5e").with_tool(at(0.0, 0.05, 0.2))
    tools = [part for part in shape.from_chain(arm).parts if part.role == "tool"]
    assert len(tools) == 2
    flange = arm.frame("tool0").home[:3, 3]
    ends = np.array([arm.frame(6).home @ point for point in core(tools[0])[[0, -1]]])[:, :3]
    np.testing.assert_allclose(ends, [flange, arm.home[:3, 3]], atol=1e-9)


def test_an_arm_mounted_elsewhere_stands_there():
    mounted = chain("ur5e").with_base(at(3.0, 0.0, 1.0))
    plain, moved = shape.from_chain(chain("ur5e")), shape.from_chain(mounted)
    assert moved.length == pytest.approx(plain.length)
    plates = [arm.frame(0).home @ form.parts[0].T_link_part for arm, form in ((chain("ur5e"), plain), (mounted, moved))]
    np.testing.assert_allclose(plates[1][:3, 3] - plates[0][:3, 3], [3.0, 0.0, 1.0], atol=1e-12)


# --------------------------------------------------------------------------------------------------------------------
# triangles


def volume(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def assert_closed(mesh):
    edges = np.vstack([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
    directed = {tuple(edge) for edge in edges.tolist()}
    assert len(directed) == len(edges)
    assert directed == {(b, a) for a, b in directed}
    assert set(np.unique(mesh.faces)) == set(range(len(mesh.vertices)))


SIZE = st.floats(0.01, 10.0)
SOLIDS = st.one_of(
    st.builds(lambda *size: Box(np.array(size)), SIZE, SIZE, SIZE),
    st.builds(Cylinder, SIZE, SIZE),
    st.builds(Capsule, SIZE, SIZE),
    st.builds(Sphere, SIZE),
    st.builds(Taper, SIZE, SIZE, SIZE),
    st.builds(lambda r, length, f: Drum(r, length, f * min(r, 0.5 * length)), SIZE, SIZE, st.floats(0.05, 0.9)),
)


@given(SOLIDS, st.integers(3, 40))
def test_surfaces_are_closed_and_turned_outwards(solid, sections):
    mesh = shape.as_mesh(solid, sections=sections)
    assert_closed(mesh)
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    large = np.linalg.norm(normals, axis=-1) > 1e-9 * np.abs(mesh.vertices).max() ** 2
    heights = np.einsum("fj,fkj->fk", normals[large], mesh.vertices[None] - a[large][:, None])
    scale = np.linalg.norm(normals[large], axis=-1) * np.abs(mesh.vertices).max()
    assert (heights.max(axis=-1) <= 1e-9 * scale).all()  # every solid is convex: nothing lies in front of a face


def exact_volume(solid):
    match solid:
        case Box():
            return float(solid.size.prod())
        case Cylinder():
            return np.pi * solid.radius**2 * solid.length
        case Capsule():
            return np.pi * solid.radius**2 * (solid.length + 4.0 / 3.0 * solid.radius)
        case Sphere():
            return 4.0 / 3.0 * np.pi * solid.radius**3
    raise TypeError(solid)


@given(SOLIDS.filter(lambda solid: not isinstance(solid, (Taper, Drum))))
@settings(max_examples=30)
def test_the_volume_is_that_of_the_solid(solid):
    found = volume(shape.as_mesh(solid, sections=48))
    assert (1.0 - ROUND) * exact_volume(solid) < found <= (1.0 + 1e-9) * exact_volume(solid)


@pytest.mark.parametrize(("name"), ["yaskawa_mh12", "gantry"])
def test_the_meshes_of_an_arm_are_closed_and_merge(name):
    parts = shape.from_chain(arm_of(name)).parts
    meshes = [shape.as_mesh(part, sections=12) for part in parts]
    whole = shape.merge(meshes)
    assert_closed(whole)
    assert volume(whole) == pytest.approx(sum(map(volume, meshes)), rel=1e-9)
    assert shape.merge([]).vertices.shape == (0, 3)


def test_what_is_no_solid_is_refused():
    with pytest.raises(ArrayError, match="sections must be at least 3, the corners of a triangle, got 2"):
        shape.as_mesh(Sphere(1.0), sections=2)
    with pytest.raises(ArrayError, match="solid must be a Box, Cylinder, Capsule, Sphere, Taper or Drum, got str"):
        shape.as_mesh("ball")
