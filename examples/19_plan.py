"""A motion around obstacles: from joint values to a pose, and what is said when there is none."""

import numpy as np

import pieper
from pieper.errors import MissingExtraError
from pieper.model.description import Box, Cylinder
from pieper.motion.collision import CollisionModel
from pieper.motion.planning import plan
from pieper.motion.world import Item, World
from pieper.spatial import rotation


def at(x: float, y: float, z: float) -> np.ndarray:
    """A place without a turn."""
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T


ur5e = pieper.load("ur5e")
world = World(
    (
        Item("post", Box(np.array([0.12, 0.12, 0.9])), at(0.5, 0.0, 0.45)),
        Item("can", Cylinder(0.05, 0.2), at(0.4, -0.35, 0.1)),
    )
)
q_start = np.array([1.2, -1.2, 1.2, -1.6, -1.6, 0.0])
T_goal = at(0.4, -0.35, 0.3)
T_goal[:3, :3] = rotation.from_rpy([np.pi, 0.0, 0.0])

try:
    model = CollisionModel(ur5e, world, margin=0.01)
    print(f"at the start {model.distance(q_start)}")
    path = plan(model, q_start, T_goal)
    print(f"{path}; {len(path.goals)} free answers to go to, at least {1e3 * path.kept:.0f} mm kept all along")
    move, resting = path.trajectory(model, max_velocity=1.0), path.trajectory(ur5e.chain, max_velocity=1.0)
    print(
        f"{move.duration:.2f} s at 1 rad/s and less, {resting.duration:.2f} s with a rest at each of its {len(path.q)} points"
    )
    for q in path.q:
        print("  ", q.round(3), "rad")

    into_the_post = plan(model, q_start, at(0.5, 0.0, 0.4))
    print(into_the_post)
    held = model.grasp("can", path.q[-1])
    back = plan(held, path.q[-1], q_start)
    print(f"back with the can: {back}")
except MissingExtraError as reason:
    print(f"not planned: {reason}")
