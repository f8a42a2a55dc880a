"""Ghosts in a scene: they show where the arm would be, behind what is in front of them, and change nothing."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pieper
from pieper.errors import ArrayError
from pieper.model.description import Box
from pieper.sim.ghost import Ghost, laid_over
from pieper.sim.offscreen import Pixels
from pieper.sim.physics import MujocoSimulator
from pieper.sim.scene import Scene, SceneCamera, SceneObject, at
from pieper.sim.scene_view import SceneView

SIZE = (160, 120)
NOTICED = 12  # of 255: more than rounding changes a pixel
Q, OTHER = np.array([0.0, -1.5, 1.5, -1.5, -1.5, 0.0]), np.array([1.2, -1.0, 1.0, -1.5, -1.5, 0.0])


@pytest.fixture(scope="module")
def robot():
    wall = SceneObject("wall", Box(np.array([0.05, 3.0, 3.0])), at(1.6, 0.0, 0.0))
    cameras = (
        SceneCamera.looking("front", [3.0, -1.0, 1.5], [0.0, 0.0, 0.4]),
        SceneCamera.looking("back", [-2.5, -1.0, 1.5], [0.0, 0.0, 0.4]),
    )
    return MujocoSimulator(pieper.load("ur5e"), q=Q, scene=Scene((wall,), cameras))


def changed(one, other):
    """(h, w) which pixels differ."""
    return np.abs(one.astype(int) - other.astype(int)).max(axis=-1) > NOTICED


@pytest.mark.usefixtures("can_draw")
def test_a_ghost_shows_where_the_arm_would_be(robot):
    with SceneView(robot, "back", size=SIZE) as view:
        alone = view.image()
        there = view.depth(robot.positions(OTHER)) < view.depth()
        seen = changed(alone, view.image(ghosts=[Ghost(OTHER, "#00ff00", 0.5)]))
        assert seen.sum() > 100
        assert not (seen & ~there).any()
        solid = view.image(ghosts=[Ghost(OTHER, "#00ff00", 1.0)])[seen].astype(int)
        assert (solid[:, 1] >= solid[:, 0]).all()  # in its colour, whatever the light
        assert (solid[:, 1] >= solid[:, 2]).all()
        assert np.array_equal(view.image(ghosts=[Ghost(OTHER, opacity=0.0)]), alone)
        assert not changed(view.image(ghosts=[Ghost(Q, "#00ff00", 0.5)]), alone).any()  # within the arm itself


@pytest.mark.usefixtures("can_draw")
def test_a_ghost_behind_a_wall_is_not_seen_and_nothing_is_disturbed(robot):
    positions, groups = np.array(robot.data.qpos), np.array(robot.model.geom_group)
    with SceneView(robot, "front", size=SIZE) as view:
        alone = view.image()
        assert np.array_equal(view.image(ghosts=[Ghost(OTHER, "#00ff00")]), alone)
        assert np.array_equal(view.image(), alone)
    assert np.array_equal(robot.data.qpos, positions)
    assert np.array_equal(robot.model.geom_group, groups)


@pytest.mark.usefixtures("can_draw")
@pytest.mark.parametrize(
    ("ghost", "words"),
    [
        (Ghost(np.zeros(5)), r"the joint values of a ghost must have shape \(\.\.\., 6\), got \(5,\)"),
        (Ghost(np.zeros((2, 6))), r"the joint values of a ghost must have shape \(6,\), got \(2, 6\)"),
        (Ghost(Q, opacity=1.5), "the opacity of a ghost must be from 0 to 1, got 1.5"),
        (Ghost(Q, "green"), "a colour must be written #rrggbb, got 'green'"),
    ],
)
def test_what_is_no_ghost_is_refused(robot, ghost, words):
    with SceneView(robot, "back", size=SIZE) as view, pytest.raises(ArrayError, match=words):
        view.image(ghosts=[ghost])


@given(st.integers(0, 2**32 - 1), st.integers(1, 5))
def test_the_order_of_ghosts_does_not_matter(seed, count):
    rng = np.random.default_rng(seed)
    colors = rng.uniform(0.0, 255.0, (4, 5, 3)).astype(np.float32)
    depth = rng.uniform(0.0, 1.0, (4, 5)).astype(np.float32)
    ghosts = [
        (float(rng.uniform()), Pixels(rng.integers(0, 256, (4, 5, 3), dtype=np.uint8), rng.uniform(size=(4, 5)).astype(np.float32)))
        for _ in range(count)
    ]  # fmt: skip
    laid = laid_over(colors, depth, ghosts)
    assert np.allclose(laid_over(colors, depth, ghosts[::-1]), laid)
    nearest = np.min([ghost.depth for _, ghost in ghosts], axis=0)
    assert np.array_equal(laid[nearest > depth], colors[nearest > depth])
