"""An arm as a MuJoCo model: a body for every axis, masses, drives, solids to touch things with, and surfaces to look at.

The world of the model is the base frame of the arm, so that MuJoCo's poses are those of `pieper.kinematics.fk`. Bodies sit at the frames
``chain.frame(i)``, joints on the screws. Every axis has a drive: a position servo with a force limit, and gravity compensated, as
industrial drives do it. Axes that one joint moves together (mimic joints) have a drive each and are held together by a constraint.

What descriptions lack is filled in by rules that are stated here:

* Mass and inertia come from the description where they are possible ones, and otherwise from the solids, of `DENSITY`.
* A drive can accelerate its joint at least `FORCE_RESERVE` times as fast as `pieper.motion.limits.JointLimits` lets it, in any of
  `_STANCES` stances; a described effort that is larger holds, one that is smaller is raised: many descriptions hold placeholders.
* The rotor adds `ROTOR` times the greatest inertia about the axis.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pieper.errors import MotionError
from pieper.model import shape
from pieper.model.description import Box, Capsule, Cylinder, Mesh, Sphere
from pieper.model.shape import Drum, Taper
from pieper.motion.limits import JointLimits
from pieper.sim.meshes import bodies_of_description, bodies_of_shape, read_mesh
from pieper.sim.offscreen import import_mujoco
from pieper.sim.stage import THEMES, rgb

if TYPE_CHECKING:
    from collections.abc import Callable

    from pieper.arm import Arm
    from pieper.model.chain import Chain
    from pieper.model.description import Description, Inertial

FloatArray = NDArray[np.float64]

DENSITY = 1500.0
"""Of links without described mass [kg/m^3]: castings of aluminium with drives and some air."""

FORCE_RESERVE = 3.0
"""How many times the inertia force at the acceleration limit a drive has."""

ROTOR = 0.1
"""Inertia of a rotor, as a fraction of the greatest inertia about its axis."""

SERVO_FREQUENCY = 60.0
"""Natural frequency of a drive's position loop, critically damped [rad/s]."""

SOLIDS, SURFACES = 3, 1
"""Groups of the solids that touch and of the surfaces that are seen; MuJoCo's renderers hide group 3."""

_STANCES = 40  # looked at for inertia and for links that always touch
_ALWAYS = 0.2  # share of stances in which two links may touch before they are taken to overlap by make
_LEAST_INERTIA = 0.01  # of a drive, as a fraction of the greatest of the arm of the same kind
_LARGEST_ANGLE = 2.0 * np.pi


@dataclass(frozen=True, eq=False)
class Drives:
    """What `build_arm` chose for the axes, each (m,).

    Attributes
    ----------
    inertia : array
        The greatest about each axis, rotor included [kg m^2 or kg].
    stiffness, damping : arrays
        Of the position servos [N m/rad or N/m, N m s/rad or N s/m].
    effort : array
        Force limits [N m or N].
    """

    inertia: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    effort: FloatArray


def body_name(link: int) -> str:
    """The name of the body that the first `link` axes move."""
    return f"arm/{link}"


def axis_name(axis: int) -> str:
    """The name of the joint and of the drive of an axis, counted from 0."""
    return f"axis/{axis}"


def build_arm(
    arm: Arm, *, color: str = "#f28c28", extend: Callable[[Any, Any], None] | None = None, density: float = DENSITY
) -> tuple[Any, Drives]:
    """A MuJoCo specification with the arm in it.

    Parameters
    ----------
    arm : Arm
    color : str
        Of links that have none.
    extend : callable, optional
        Called with the specification and the body of the last link, to add a gripper or a world before inertias are judged.
    density : float
        Of links without described mass [kg/m^3].

    Returns
    -------
    spec : mujoco.MjSpec
        To be compiled. Bodies are named by `body_name`, joints and drives by `axis_name`, the site ``tip`` is the tip.
    drives : Drives

    Raises
    ------
    MissingExtraError, MissingLibraryError
        MuJoCo is not there.

    Examples
    --------
    >>> import pieper
    >>> spec, drives = build_arm(pieper.load("ur5e"))
    >>> model = spec.compile()
    >>> model.nq, model.nu, model.body("arm/6").name
    (6, 6, 'arm/6')
    """
    mujoco = import_mujoco()
    chain = arm.chain
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.compiler.balanceinertia = True
    spec.compiler.boundmass = 1e-4
    spec.compiler.boundinertia = 1e-8
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10.0
    spec.option.timestep = 0.002
    bodies = _add_bodies(spec, chain)
    _add_solids(spec, arm, bodies, density)
    _add_surfaces(spec, arm, bodies, color)
    tip = np.linalg.inv(chain.frame(len(chain.screws)).home) @ chain.home
    bodies[-1].add_site(name="tip", pos=tip[:3, 3], quat=quaternion(tip[:3, :3]))
    if extend is not None:
        extend(spec, bodies[-1])
    drives = _add_drives(spec, chain)
    return spec, drives


def quaternion(R: FloatArray) -> FloatArray:
    """The quaternion (4,) of a rotation (3, 3) in MuJoCo's order, w x y z."""
    mujoco = import_mujoco()
    found = np.zeros(4)
    mujoco.mju_mat2Quat(found, np.ascontiguousarray(R).ravel())
    return found


def axis_limits(chain: Chain) -> FloatArray:
    """(m, 2) range of every axis, from those of the joints that move it [rad or m]."""
    with np.errstate(invalid="ignore"):
        ends = np.where(chain.coupling[:, :, None] == 0.0, 0.0, chain.coupling[:, :, None] * chain.limits)
    return np.stack([ends.min(axis=2).sum(axis=1), ends.max(axis=2).sum(axis=1)], axis=1)


# --------------------------------------------------------------------------------------------------------------------
# bodies and joints


def _add_bodies(spec: Any, chain: Chain) -> list[Any]:
    mujoco = import_mujoco()
    first = chain.frame(0).home
    at = spec.worldbody.add_body(name=body_name(0), pos=first[:3, 3], quat=quaternion(first[:3, :3]))
    bodies, before = [at], first
    limits = axis_limits(chain)
    for axis, screw in enumerate(chain.screws):
        home = chain.frame(axis + 1).home
        T = np.linalg.inv(before) @ home
        body = bodies[-1].add_body(name=body_name(axis + 1), pos=T[:3, 3], quat=quaternion(T[:3, :3]), gravcomp=1.0)
        v, w = screw[:3], screw[3:]
        turns = bool(w.any())
        point = np.cross(w, v) if turns else home[:3, 3]
        limited = bool(np.isfinite(limits[axis]).all())
        body.add_joint(
            name=axis_name(axis),
            type=mujoco.mjtJoint.mjJNT_HINGE if turns else mujoco.mjtJoint.mjJNT_SLIDE,
            axis=home[:3, :3].T @ (w if turns else v),
            pos=home[:3, :3].T @ (point - home[:3, 3]),
            limited=limited,
            range=limits[axis] if limited else [0.0, 0.0],
        )
        bodies.append(body)
        before = home
    for axis, row in enumerate(chain.coupling):
        moved = np.flatnonzero(row)
        leader = int(np.flatnonzero(chain.coupling[:, moved[0]])[0]) if len(moved) == 1 else axis
        if leader == axis or np.count_nonzero(chain.coupling[leader]) != 1:
            continue
        ratio = row[moved[0]] / chain.coupling[leader, moved[0]]
        spec.add_equality(
            type=mujoco.mjtEq.mjEQ_JOINT,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            name1=axis_name(axis),
            name2=axis_name(leader),
            data=[0.0, ratio, *[0.0] * 10],
        )
    return bodies


# --------------------------------------------------------------------------------------------------------------------
# masses and solids


def _add_solids(spec: Any, arm: Arm, bodies: list[Any], density: float) -> None:
    """Solids to touch things with, and masses: of the description where it has them, else made from the chain."""
    chain, description = arm.chain, arm.description
    masses = (
        [] if description is None else [_described_inertia(description, chain, link) for link in range(len(bodies))]
    )
    described = bool(masses) and all(mass is not None for mass in masses[1:])
    solids = [] if description is None else _described_solids(spec, description, chain)
    if not solids:
        solids = [
            (part.link, part.solid, part.T_link_part) for part in shape.from_chain(chain).parts if part.role != "mark"
        ]
    for link, solid, T in solids:
        kind, size = primitive(solid)
        named = {} if not isinstance(solid, str) else {"meshname": solid}
        bodies[link].add_geom(
            type=kind, size=size, pos=T[:3, 3], quat=quaternion(T[:3, :3]), group=SOLIDS, density=density, contype=1, conaffinity=3,
            rgba=[0.6, 0.3, 0.3, 0.4], **named,
        )  # fmt: skip
    if described:
        for body, inertial in zip(bodies[1:], masses[1:], strict=True):
            mass, center, matrix = inertial
            body.explicitinertial = True
            body.mass = mass
            body.ipos = center
            body.fullinertia = [matrix[0, 0], matrix[1, 1], matrix[2, 2], matrix[0, 1], matrix[0, 2], matrix[1, 2]]


def _described_inertia(description: Description, chain: Chain, link: int) -> Any:
    """Mass [kg], centre of mass (3,) and inertia (3, 3) about it, in the frame of a body; None when not all of it is possible."""
    first = chain.frame(link).home
    known = {entry.name for entry in description.links}
    found: list[tuple[float, FloatArray, FloatArray]] = []
    for frame in chain.frames:
        if frame.after != link or frame.name not in known:
            continue
        inertial = description.link(frame.name).inertial
        if inertial is None or inertial.mass == 0.0:
            continue
        if not is_possible(inertial):
            return None
        T = np.linalg.inv(first) @ frame.home @ inertial.T_link_inertial
        found.append((inertial.mass, T[:3, 3], T[:3, :3] @ inertial.inertia @ T[:3, :3].T))
    if not found:
        return None
    mass = sum(part[0] for part in found)
    center = np.sum([m * c for m, c, _ in found], axis=0) / mass
    matrix = np.zeros((3, 3))
    for m, c, about in found:
        d = c - center
        matrix += about + m * (float(d @ d) * np.eye(3) - np.outer(d, d))
    return mass, center, matrix


def is_possible(inertial: Inertial) -> bool:
    """Whether a rigid body can have this mass and inertia: positive, and no main moment larger than the sum of the others.

    >>> from pieper.model.description import Inertial
    >>> is_possible(Inertial(1.0, np.eye(4), np.diag([1.0, 1.0, 1.0])))
    True
    >>> is_possible(Inertial(1.0, np.eye(4), np.diag([1.0, 1.0, 3.0])))
    False
    """
    matrix = inertial.inertia
    if not (np.isfinite(inertial.mass) and inertial.mass > 0.0 and np.allclose(matrix, matrix.T)):
        return False
    moments = np.linalg.eigvalsh(matrix)
    return bool(moments[0] > 0.0 and moments[2] <= (moments[0] + moments[1]) * (1.0 + 1e-6))


def _described_solids(spec: Any, description: Description, chain: Chain) -> list[tuple[int, Any, FloatArray]]:
    """The collision shapes of the links of a chain; none when a mesh among them cannot be read."""
    known = {entry.name for entry in description.links}
    found: list[tuple[int, Any, FloatArray]] = []
    for frame in chain.frames:
        if frame.name not in known:
            continue
        T_body_link = np.linalg.inv(chain.frame(frame.after).home) @ frame.home
        for collision in description.link(frame.name).collisions:
            solid: Any = collision.geometry
            if isinstance(solid, Mesh):
                solid = _add_mesh(spec, solid, f"solid/{len(found)}")
                if solid is None:
                    return []
            found.append((frame.after, solid, T_body_link @ collision.T_link_shape))
    return found


def _add_mesh(spec: Any, mesh: Mesh, name: str) -> str | None:
    try:
        surface = read_mesh(mesh.path) if mesh.path is not None else None
    except (OSError, ValueError):
        surface = None
    if surface is None:
        return None
    _put_mesh(spec, name, surface.vertices * mesh.scale, surface.faces)
    return name


def _put_mesh(spec: Any, name: str, vertices: FloatArray, faces: Any) -> None:
    mujoco = import_mujoco()
    spec.add_mesh(
        name=name, uservert=np.asarray(vertices, dtype=np.float32).ravel(), userface=np.asarray(faces, dtype=np.int32).ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )  # fmt: skip


def primitive(solid: Any) -> tuple[Any, list[float]]:
    """MuJoCo's kind and sizes of a solid; a taper becomes a capsule of its mean radius, a name a mesh."""
    kind = import_mujoco().mjtGeom
    if isinstance(solid, Box):
        return kind.mjGEOM_BOX, [*(0.5 * solid.size)]
    if isinstance(solid, (Cylinder, Drum)):
        return kind.mjGEOM_CYLINDER, [solid.radius, 0.5 * solid.length, 0.0]
    if isinstance(solid, Capsule):
        return kind.mjGEOM_CAPSULE, [solid.radius, 0.5 * solid.length, 0.0]
    if isinstance(solid, Taper):
        return kind.mjGEOM_CAPSULE, [0.5 * (solid.radius + solid.end_radius), 0.5 * solid.length, 0.0]
    if isinstance(solid, Sphere):
        return kind.mjGEOM_SPHERE, [solid.radius, 0.0, 0.0]
    return kind.mjGEOM_MESH, [0.0, 0.0, 0.0]


def _add_surfaces(spec: Any, arm: Arm, bodies: list[Any], color: str) -> None:
    mujoco = import_mujoco()
    surfaces = None if arm.description is None else bodies_of_description(arm.description, arm.chain, color)
    for number, surface in enumerate(surfaces or bodies_of_shape(arm.chain, color, THEMES["light"])):
        name = f"surface/{number}"
        _put_mesh(spec, name, surface.mesh.vertices, surface.mesh.faces)
        bodies[surface.link].add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, rgba=[*rgb(surface.color), 1.0], contype=0, conaffinity=0, mass=0.0,
            group=SURFACES,
        )  # fmt: skip


# --------------------------------------------------------------------------------------------------------------------
# drives, and links that overlap by make


def _add_drives(spec: Any, chain: Chain) -> Drives:
    mujoco = import_mujoco()
    inertia, overlapping = _looked_at(spec, chain)
    m = len(chain.screws)
    turns = chain.is_revolute
    for kind in (turns, ~turns):
        if kind.any():
            inertia[kind] = np.maximum(inertia[kind], _LEAST_INERTIA * inertia[kind].max())
    rotor = ROTOR * inertia
    total = inertia + rotor
    limits = JointLimits.of(chain)
    acceleration = np.abs(chain.coupling) @ limits.acceleration
    described = np.array(
        [chain.max_effort[np.flatnonzero(row)].min() if row.any() else np.inf for row in chain.coupling]
    )
    needed = FORCE_RESERVE * total * acceleration
    effort = np.where(np.isfinite(described), np.maximum(described, needed), 3.0 * needed)
    drives = Drives(total, total * SERVO_FREQUENCY**2, 2.0 * total * SERVO_FREQUENCY, effort)
    for axis in range(m):
        spec.joint(axis_name(axis)).armature = rotor[axis]
        spec.add_actuator(
            name=axis_name(axis),
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            target=axis_name(axis),
            gaintype=mujoco.mjtGain.mjGAIN_FIXED,
            biastype=mujoco.mjtBias.mjBIAS_AFFINE,
            gainprm=[drives.stiffness[axis], *[0.0] * 9],
            biasprm=[0.0, -drives.stiffness[axis], -drives.damping[axis], *[0.0] * 7],
            forcelimited=True,
            forcerange=[-effort[axis], effort[axis]],
        )
    for one, other in overlapping:
        spec.add_exclude(bodyname1=one, bodyname2=other)
    return drives


def _looked_at(spec: Any, chain: Chain) -> tuple[FloatArray, list[tuple[str, str]]]:
    """(m,) the greatest inertia about every axis, and pairs of links that are neighbours or touch in many stances."""
    mujoco = import_mujoco()
    m = len(chain.screws)
    names = [body_name(link) for link in range(m + 1)]
    neighbours = {(a, b) for a, b in combinations(range(m + 1), 2) if b - a == 1}
    if m == 0:
        return np.zeros(0), []
    model = spec.compile()
    data = mujoco.MjData(model)
    addresses = np.array([int(model.joint(axis_name(axis)).qposadr[0]) for axis in range(m)])
    columns = np.array([int(model.joint(axis_name(axis)).dofadr[0]) for axis in range(m)])
    link_of = {int(model.body(name).id): link for link, name in enumerate(names)}
    lower, upper = np.clip(chain.limits, -_LARGEST_ANGLE, _LARGEST_ANGLE).T
    rng = np.random.default_rng(0)
    greatest = np.zeros(m)
    touched: dict[tuple[int, int], int] = {}
    full = np.zeros((model.nv, model.nv))
    for stance in range(_STANCES):
        q = np.clip(np.zeros(chain.dof), lower, upper) if stance == 0 else rng.uniform(lower, upper)
        data.qpos[addresses] = chain.coupling @ q
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fullM(model, data, full)
        greatest = np.maximum(greatest, full[columns, columns])
        pairs = {
            (min(link_of[a], link_of[b]), max(link_of[a], link_of[b]))
            for a, b in model.geom_bodyid[data.contact.geom]
            if a in link_of and b in link_of and a != b
        }
        for pair in pairs:
            touched[pair] = touched.get(pair, 0) + (_STANCES if stance == 0 else 1)
    if not np.isfinite(greatest).all():
        raise MotionError(f"the inertia of {chain.name!r} is not finite; check the masses in its description")
    always = {pair for pair, count in touched.items() if count > _ALWAYS * _STANCES}
    return greatest, [(names[a], names[b]) for a, b in sorted(neighbours | always)]
