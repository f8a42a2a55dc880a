"""Shelves to plan in: the nine slots before a KR210, and random ones before a UR5e; and a check of states by MuJoCo alone."""

import itertools
from typing import NamedTuple

import numpy as np

import pieper
from pieper.model.description import Box, Capsule, Cylinder, Sphere
from pieper.motion.collision import CollisionModel
from pieper.motion.world import Item, World
from pieper.spatial import rotation

MARGIN = 0.01  # [m]


class Query(NamedTuple):
    """From where to where in which world; `goal` is a pose (4, 4)."""

    name: str
    arm: str
    model: CollisionModel
    q_start: np.ndarray
    goal: np.ndarray


def at(x, y, z, rpy=(0.0, 0.0, 0.0)):
    """A pose."""
    T = np.eye(4)
    T[:3, :3] = rotation.from_rpy(rpy)
    T[:3, 3] = x, y, z
    return T


def shelf(front, depth, sides, boards, thickness, *, T=None):
    """Boards at heights, walls at sides and a back, seen along x; front, depth, thickness in metres."""
    T = np.eye(4) if T is None else T
    left, right = max(sides), min(sides)
    low, high = min(boards), max(boards)
    middle = front + 0.5 * depth
    items = [
        Item(f"board_{i}", Box([depth, left - right + thickness, thickness]), T @ at(middle, 0.5 * (left + right), z))
        for i, z in enumerate(boards)
    ]
    items += [
        Item(f"wall_{i}", Box([depth, thickness, high - low]), T @ at(middle, y, 0.5 * (low + high)))
        for i, y in enumerate(sides)
    ]
    back = at(front + depth, 0.5 * (left + right), 0.5 * (low + high))
    return [*items, Item("back", Box([thickness, left - right + thickness, high - low]), T @ back)]


# --------------------------------------------------------------------------------------------------------------------
# the KR210 before nine slots


SLOTS = [(2.6, y, z) for z in (0.911, 1.681, 2.445) for y in (0.9, 0.0, -0.9)]
CAN = Cylinder(0.06, 0.36)


def kr210_world(without=None):
    """Floor, shelf with a can in each of its nine slots, and the bin."""
    boards = [z - 0.2 for _, _, z in SLOTS[::3]] + [SLOTS[-1][2] + 0.55]
    items = shelf(2.35, 0.5, (-1.35, -0.45, 0.45, 1.35), boards, 0.02)
    items += [Item(f"can_{k + 1}", CAN, at(x, y, z)) for k, (x, y, z) in enumerate(SLOTS) if k != without]
    items.append(Item("floor", Box([8.0, 8.0, 0.02]), at(0.0, 0.0, -0.02)))
    for name, x, y, size in (
        ("bin_left", -0.5, 2.5, [0.02, 1.0, 0.8]), ("bin_right", 0.5, 2.5, [0.02, 1.0, 0.8]),
        ("bin_near", 0.0, 2.0, [1.0, 0.02, 0.8]), ("bin_far", 0.0, 3.0, [1.0, 0.02, 0.8]),
    ):  # fmt: skip
        items.append(Item(name, Box(size), at(x, y, 0.4)))
    return World(items)


def kr210_gripper():
    """Two fingers about the x axis of the tip, which is between their ends, 0.2 m before the can."""
    return [
        Item("palm", Box([0.1, 0.26, 0.1]), at(-0.1, 0.0, 0.0)),
        Item("finger_left", Box([0.26, 0.03, 0.06]), at(0.08, 0.105, 0.0)),
        Item("finger_right", Box([0.26, 0.03, 0.06]), at(0.08, -0.105, 0.0)),
    ]


def kr210_queries():
    """The 18 poses of the nine slots: before the can from rest, at the can from before it; and from each slot to the next but three."""
    arm = pieper.load("kr210")
    home = np.zeros(6)
    queries = []
    for k, (_, y, z) in enumerate(SLOTS):
        model = CollisionModel(arm, kr210_world(without=k), tool=kr210_gripper(), margin=MARGIN)
        for kind, x in (("pre_grasp", 2.2), ("reach", 2.4)):
            queries.append(Query(f"slot {k + 1} {kind}", "kr210", model, home, at(x, y, z - 0.1)))
    return queries


# --------------------------------------------------------------------------------------------------------------------
# a UR5e before random shelves


def ur5e_query(seed):
    """From a pose in one bay of a random shelf to one in another; None when either cannot be taken at all."""
    random = np.random.default_rng(seed)
    arm = pieper.load("ur5e")
    columns, rows = random.integers(2, 4), random.integers(2, 4)
    wide, high, depth = random.uniform(0.26, 0.36), random.uniform(0.26, 0.34), random.uniform(0.22, 0.34)
    bottom, front = random.uniform(0.05, 0.25), random.uniform(0.42, 0.55)
    sides = [(i - 0.5 * columns) * wide for i in range(columns + 1)]
    boards = [bottom + i * high for i in range(rows + 1)]
    T = at(0.0, 0.0, 0.0, (0.0, 0.0, random.uniform(-np.pi, np.pi)))
    items = shelf(front, depth, sides, boards, 0.02, T=T)
    items.append(Item("floor", Box([3.0, 3.0, 0.02]), at(0.0, 0.0, -0.03)))
    model = CollisionModel(
        arm, World(items), tool=Item("gripper", Box([0.08, 0.05, 0.1]), at(0.0, 0.0, 0.05)), margin=MARGIN
    )
    bays = [(i, j) for i in range(columns) for j in range(rows)]
    first, second = random.permutation(len(bays))[:2]
    poses = []
    for i, j in (bays[first], bays[second]):
        x = front + random.uniform(-0.02, 0.06)
        y = 0.5 * (sides[i] + sides[i + 1]) + random.uniform(-0.03, 0.03)
        z = 0.5 * (boards[j] + boards[j + 1]) + random.uniform(-0.03, 0.03)
        poses.append(T @ at(x, y, z, (0.0, 0.5 * np.pi, random.uniform(-0.3, 0.3))))
    starts = [q for q in arm.ik(poses[0]).q if np.isfinite(q).all() and model.is_free(q)]
    ends = [q for q in arm.ik(poses[1]).q if np.isfinite(q).all() and model.is_free(q)]
    if not starts or not ends:
        return None
    return Query(f"shelf {seed}", "ur5e", model, starts[int(random.integers(len(starts)))], poses[1])


def ur5e_queries(count):
    """That many shelves, from the seeds 0, 1, ... that give a start and a goal."""
    queries, seed = [], 0
    while len(queries) < count:
        query = ur5e_query(seed)
        if query is not None:
            queries.append(query)
        seed += 1
    return queries, seed


# --------------------------------------------------------------------------------------------------------------------
# the judge


class Judge:
    """States checked by MuJoCo: its kinematics, made from the screws, and its geometry."""

    def __init__(self, model):
        import mujoco

        self._mujoco = mujoco
        chain = model.chain
        spec = self._spec = mujoco.MjSpec()
        spec.option.timestep = 0.01
        body, bodies = spec.worldbody, [spec.worldbody]
        for i, screw in enumerate(chain.screws):
            v, w = screw[:3], screw[3:]
            body = body.add_body(name=f"link {i + 1}", mass=1.0, inertia=[1.0, 1.0, 1.0], ipos=[0.0, 0.0, 0.0])
            if w.any():
                body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=w, pos=np.cross(w, v))
            else:
                body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=v)
            bodies.append(body)
        names = {}
        for number, (each, (name, solid, T)) in enumerate(
            zip(model._moving_solids, model.solids(np.zeros(chain.dof)), strict=True)
        ):
            key = f"{number} {name}"
            names[number] = key
            self._add(bodies[each.body], key, solid, T, moves=each.body > 0)
        for item in model.world:
            self._add(spec.worldbody, item.name, item.solid, item.pose, moves=None)
        for p, o in zip(model._self_first, model._self_second, strict=True):
            pair = spec.add_pair()
            pair.geomname1, pair.geomname2 = names[int(p)], names[int(o)]
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.coupling = chain.coupling

    def _add(self, body, name, solid, T, *, moves):
        mujoco = self._mujoco
        kinds = mujoco.mjtGeom
        mesh = {}
        if isinstance(solid, Box):  # as a mesh: the collider for capsules and boxes misses one that a capsule pierces
            corners = 0.5 * solid.size * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
            self._spec.add_mesh(name=name, uservert=corners.astype(np.float32).ravel())
            kind, size, mesh = kinds.mjGEOM_MESH, [0.0, 0.0, 0.0], {"meshname": name}
        elif isinstance(solid, Capsule):
            kind, size = kinds.mjGEOM_CAPSULE, [solid.radius, 0.5 * solid.length, 0.0]
        elif isinstance(solid, Cylinder):
            kind, size = kinds.mjGEOM_CYLINDER, [solid.radius, 0.5 * solid.length, 0.0]
        elif isinstance(solid, Sphere):
            kind, size = kinds.mjGEOM_SPHERE, [solid.radius, 0.0, 0.0]
        else:
            raise TypeError(type(solid).__name__)
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(T[:3, :3]).ravel())
        # bit 1: moving solids, which meet bit 2: the world; self pairs are listed one by one
        masks = {None: (2, 1), True: (1, 2), False: (0, 0)}[moves]
        body.add_geom(
            name=name,
            type=kind,
            size=size,
            **mesh,
            pos=T[:3, 3],
            quat=quaternion,
            contype=masks[0],
            conaffinity=masks[1],
        )

    def touches(self, q):
        """What overlaps at joint values (n,), as names."""
        self.data.qpos[:] = self.coupling @ q
        self._mujoco.mj_kinematics(self.model, self.data)
        self._mujoco.mj_collision(self.model, self.data)
        return [
            tuple(self.model.geom(int(g)).name for g in contact.geom)
            for contact in self.data.contact
            if contact.dist < 0.0
        ]


def dense(path, model, spacing):
    """States along a path (k, n) between which no point moves by more than `spacing` [m]."""
    rows = [path[:1]]
    for a, b in itertools.pairwise(path):
        count = int(np.ceil(float(model.displacement(b - a).max()) / spacing))
        rows.append(a + (np.arange(1, count + 1) / count)[:, None] * (b - a))
    return np.vstack(rows)
