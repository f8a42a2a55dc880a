"""Edges that are called free are free all along; edges that are called blocked are blocked where it is said."""

from __future__ import annotations

import numpy as np
import pytest

from pieper.errors import MotionError
from pieper.model import shape
from pieper.model.chain import Chain
from tests.motion.worlds import cluttered, post, states
from tests.robots import NAMES, chain

pytest.importorskip("coal")

from pieper.motion.collision import CollisionModel
from pieper.motion.edges import EdgeCheck

AS_COAL = 2e-5  # [m]
DENSE = 200  # states of an edge that are looked at one by one


@pytest.mark.parametrize("name", NAMES)
def test_free_is_free_all_along_and_blocked_is_blocked(name: str) -> None:
    model = CollisionModel(chain(name), cluttered(shape.from_chain(chain(name)).length / 1.4), margin=0.01)
    edges = EdgeCheck(model)
    q = states(chain(name), 300, seed=3)
    q = q[model.is_free(q)][:16]
    random = np.random.default_rng(4)
    goals = q + random.normal(size=q.shape) * random.choice([0.05, 0.5, 2.0], size=(len(q), 1))
    s = np.linspace(0.0, 1.0, DENSE)[:, None]
    for a, b in zip(q, goals, strict=True):
        result = edges.check(a, b)
        if result.free:
            assert model.bounds(a + s * (b - a), 0.1).min() >= edges.kept - AS_COAL
            assert edges.check(b, a).free
            assert edges.screen(a[None], b[None])[0]
        else:
            assert not model.is_free(a + result.blocked_at * (b - a))
        assert edges.kept == pytest.approx(0.005)


def test_a_thin_wall_is_not_jumped_over() -> None:
    """An obstacle thinner than any step, in the middle of a fast edge."""
    from pieper.model.description import Box
    from pieper.motion.world import Item, World
    from tests.motion.worlds import at

    wall = World((Item("sheet", Box([0.6, 1e-4, 0.6]), at(0.7, 0.0, 0.3)),))
    for margin, step in ((0.002, None), (0.001, 0.0005), (0.02, 0.04)):
        edges = EdgeCheck(CollisionModel(chain("ur5e"), wall, margin=margin), step=step)
        a = np.array([-1.6, -0.6, 0.8, -0.4, 0.0, 0.0])
        b = np.array([1.6, -0.6, 0.8, -0.4, 0.0, 0.0])
        assert not edges.check(a, b).free
        assert edges.check(a, a + np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])).free


def test_an_edge_without_length() -> None:
    edges = EdgeCheck(CollisionModel(chain("ur5e"), post()))
    free, blocked = np.array([2.2, -1.2, 1.2, -1.6, -1.6, 0.0]), np.array([0.0, -1.2, 1.2, 0.0, 0.0, 0.0])
    assert edges.check(free, free).free
    assert edges.check(blocked, blocked) == (False, 0.0)


def test_stop_ends_a_check() -> None:
    edges = EdgeCheck(CollisionModel(chain("ur5e"), post()))
    a, b = np.array([2.2, -1.2, 1.2, -1.6, -1.6, 0.0]), np.array([2.6, -1.2, 1.2, -1.6, -1.6, 0.0])
    assert edges.check(a, b).free
    assert not edges.check(a, b, stop=lambda: True).free


def test_steps_that_could_miss_something_are_refused() -> None:
    model = CollisionModel(chain("ur5e"), margin=0.01)
    with pytest.raises(MotionError, match=r"step must be at most twice the margin of 0.01 m.*got 0.05 m"):
        EdgeCheck(model, step=0.05)
    for step in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(MotionError, match=r"step must be a positive distance \[m\]"):
            EdgeCheck(model, step=step)
    slide = Chain(
        "rail", [[1.0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 1.0]], np.eye(4), [[-np.inf, np.inf], [-1, 1]], ("x", "t")
    )
    turn_first = Chain(
        "boom", [[0, 0, 0, 0, 0, 1.0], [1.0, 0, 0, 0, 0, 0]], np.eye(4), [[-1, 1], [-np.inf, np.inf]], ("t", "x")
    )
    EdgeCheck(CollisionModel(slide))  # everything moves as far as the joint: known without limits
    with pytest.raises(MotionError, match="'boom' has a joint that slides without limits"):
        EdgeCheck(CollisionModel(turn_first))
