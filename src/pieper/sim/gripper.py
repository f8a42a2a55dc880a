"""A gripper with two parallel fingers: what it is like, how it is put on an arm, and what it is doing.

The mount has its z axis ahead, towards what is gripped, and its y axis from finger to finger. The fingers are geared together, so that
the middle between them stays where it is, and driven with a limited force. As with a real one, all that is known about the grip comes
from the width and the speed of the fingers.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pieper.errors import ArrayError
from pieper.model.description import Box, Cylinder
from pieper.sim.mujoco_arm import primitive, quaternion
from pieper.sim.offscreen import import_mujoco
from pieper.sim.scene import at, friction_vector, pose
from pieper.sim.stage import rgb

FloatArray = NDArray[np.float64]

_AT_REST = 2e-3  # [m/s] slower fingers rest
_SETTLING = 0.08  # [s] for which they have to
_FINGERS = ("finger/left", "finger/right")
_SAG = 1e-3  # [m] of the drive under full force


class GripperState(Enum):
    """What a gripper is doing."""

    OPENING = "opening"
    OPEN = "open"
    CLOSING = "closing"
    HOLDING = "holding"
    EMPTY = "closed-empty"


@dataclass(frozen=True, eq=False)
class ParallelGripper:
    """A gripper with two parallel fingers.

    Attributes
    ----------
    stroke : float
        The largest width between the pads [m].
    force : float
        With which each pad presses at most [N].
    reach : float
        From the mount to the middle of the pads, along z [m].
    T_tip_mount : (4, 4) array
        The mount in the frame of the arm's tip.
    pad : (3,) array
        Thickness, width (along x of the mount) and length (along z) of a pad [m].
    speed : float
        Of each finger [m/s].
    mass : float
        All of it [kg].
    color : str

    Raises
    ------
    ArrayError
        A size, force or speed that is not positive and finite, or a reach shorter than the pads.

    Examples
    --------
    >>> hand = ParallelGripper(stroke=0.1, force=40.0, reach=0.15)
    >>> hand.T_tip_grasp[:3, 3]
    array([0.  , 0.  , 0.15])
    >>> ParallelGripper(stroke=0.1, force=0.0, reach=0.15)
    Traceback (most recent call last):
        ...
    pieper.errors.ArrayError: force of a gripper must be above 0 and finite, got 0.0
    """

    stroke: float
    force: float
    reach: float
    T_tip_mount: FloatArray = field(default_factory=lambda: np.eye(4))
    pad: FloatArray = field(default_factory=lambda: np.array([0.012, 0.03, 0.05]))
    speed: float = 0.15
    mass: float = 1.0
    color: str = "#4a4f57"

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_tip_mount", pose(self.T_tip_mount, "T_tip_mount"))
        pad = np.array(self.pad, dtype=np.float64)
        for name in ("stroke", "force", "reach", "speed", "mass"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise ArrayError(f"{name} of a gripper must be above 0 and finite, got {value}")
        if pad.shape != (3,) or not (np.isfinite(pad) & (pad > 0.0)).all():
            raise ArrayError(f"pad must be thickness, width and length [m], above 0 and finite, got {pad.tolist()}")
        if self.reach <= pad[2]:
            raise ArrayError(f"reach {self.reach} m must be longer than the pads, {pad[2]} m")
        pad.setflags(write=False)
        object.__setattr__(self, "pad", pad)
        rgb(self.color)

    @property
    def T_tip_grasp(self) -> FloatArray:
        """(4, 4) the frame in the middle between the pads, in the frame of the tip; oriented as the mount."""
        T = np.array(self.T_tip_mount)
        T[:3, 3] += T[:3, 2] * self.reach
        return T

    @property
    def narrowest(self) -> float:
        """Fingers closer than this hold nothing [m]."""
        return 0.02 * self.stroke + 2.0 * _SAG

    def solids(self, width: float | None = None) -> dict[str, tuple[Box | Cylinder, FloatArray]]:
        """What the gripper is made of, with the pads `width` [m] apart, the stroke by default: solids and their poses (4, 4) in the mount.

        >>> sorted(ParallelGripper(stroke=0.1, force=40.0, reach=0.15).solids())
        ['finger/left/bar', 'finger/left/pad', 'finger/right/bar', 'finger/right/pad', 'palm/neck', 'palm/plate']
        """
        thick, wide, long = map(float, self.pad)
        behind = self.reach - 0.5 * long  # where the pads begin
        plate = 0.35 * behind
        neck, half = behind - plate, 0.5 * (self.stroke if width is None else width)
        start, end = neck + 0.6 * plate, self.reach + 0.5 * long
        found: dict[str, tuple[Box | Cylinder, FloatArray]] = {
            "palm/neck": (Cylinder(0.6 * wide, neck), at(0.0, 0.0, 0.5 * neck)),
            "palm/plate": (
                Box(np.array([1.4 * wide, self.stroke + 4.0 * thick, 0.6 * plate])),
                at(0.0, 0.0, neck + 0.3 * plate),
            ),
        }
        for name, side in zip(_FINGERS, (1.0, -1.0), strict=True):
            found[f"{name}/bar"] = (
                Box(np.array([0.8 * wide, thick, end - start])),
                at(0.0, side * (half + 1.5 * thick), 0.5 * (start + end)),
            )
            found[f"{name}/pad"] = (Box(self.pad[[1, 0, 2]]), at(0.0, side * (half + 0.5 * thick), self.reach))
        return found


def add_gripper(spec: Any, body: Any, gripper: ParallelGripper, T_body_tip: FloatArray) -> None:
    """Put a gripper on a body of a MuJoCo specification; its joints, geoms and drive begin with ``finger/`` and ``palm/``.

    Parameters
    ----------
    spec : mujoco.MjSpec
        Is added to.
    body : mujoco.MjsBody
        Of the hand.
    gripper : ParallelGripper
    T_body_tip : (4, 4) array
        The tip of the arm in the frame of the body [m, -].
    """
    mujoco = import_mujoco()
    T = T_body_tip @ gripper.T_tip_mount
    opening, paint, steel, rubber = 0.5 * gripper.stroke, rgb(gripper.color), (0.75, 0.77, 0.80), (0.15, 0.15, 0.17)
    hand = body.add_body(name="palm", pos=T[:3, 3], quat=quaternion(T[:3, :3]), gravcomp=1.0)
    fingers = {}
    for name, side in zip(_FINGERS, (1.0, -1.0), strict=True):
        fingers[name] = hand.add_body(name=name, gravcomp=1.0)
        fingers[name].add_joint(
            name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0.0, side, 0.0], limited=True, range=[0.0, opening], armature=0.2 * gripper.mass,
        )  # fmt: skip
    looks: dict[str, tuple[float, Any]] = {
        "neck": (0.2, (0.6, 0.63, 0.67)),
        "plate": (0.4, paint),
        "bar": (0.15, steel),
        "pad": (0.05, rubber),
    }
    grip = {"condim": 4, "friction": friction_vector(1.0), "solref": [0.004, 1.0]}
    for name, (solid, T_mount_solid) in gripper.solids(0.0).items():
        owner, _, part = name.rpartition("/")
        share, color = looks[part]
        kind, size = primitive(solid)
        fingers.get(owner, hand).add_geom(
            name=name, type=kind, pos=T_mount_solid[:3, 3], size=size, mass=share * gripper.mass, rgba=[*color, 1.0], group=0, contype=1,
            conaffinity=3, **(grip if part == "pad" else {}),
        )  # fmt: skip
    spec.add_equality(
        type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT, name1=_FINGERS[1], name2=_FINGERS[0], data=[0.0, 1.0, *[0.0] * 10],
        solref=[0.004, 1.0],
    )  # fmt: skip
    # The gear shares the force of the drive between the pads.
    stiffness = 2.0 * gripper.force / _SAG
    moving = 2.0 * (0.2 + 0.2) * gripper.mass
    spec.add_actuator(
        name="finger", trntype=mujoco.mjtTrn.mjTRN_JOINT, target=_FINGERS[0], gaintype=mujoco.mjtGain.mjGAIN_FIXED,
        biastype=mujoco.mjtBias.mjBIAS_AFFINE, gainprm=[stiffness, *[0.0] * 9],
        biasprm=[0.0, -stiffness, -2.0 * np.sqrt(stiffness * moving), *[0.0] * 7],
        forcelimited=True, forcerange=[-2.0 * gripper.force, 2.0 * gripper.force],
    )  # fmt: skip
    for one in ("palm", *_FINGERS):
        spec.add_exclude(bodyname1=body.name, bodyname2=one)
    spec.add_exclude(bodyname1=_FINGERS[0], bodyname2=_FINGERS[1])


class GripperDrive:
    """The gripper of a simulated arm: open it, close it, and see what it is doing.

    Attributes
    ----------
    gripper : ParallelGripper
    state : GripperState
    """

    def __init__(self, gripper: ParallelGripper, model: Any, data: Any) -> None:
        self.gripper = gripper
        self.state = GripperState.OPEN
        self._model, self._data = model, data
        joint = model.joint(_FINGERS[0])
        self._q, self._dq = int(joint.qposadr[0]), int(joint.dofadr[0])
        self._drive = int(model.actuator("finger").id)
        self._pads = [int(model.geom(f"{name}/pad").id) for name in _FINGERS]
        self._opening = self._command = 0.5 * gripper.stroke
        self._resting, self._gripped = 0.0, 0.0
        for name in _FINGERS:
            data.qpos[int(model.joint(name).qposadr[0])] = self._opening
        data.ctrl[self._drive] = self._opening

    @property
    def width(self) -> float:
        """Between the pads [m]."""
        return 2.0 * float(self._data.qpos[self._q])

    @property
    def touching(self) -> frozenset[str]:
        """Names of the things that both pads touch."""
        seen = [set[str](), set[str]()]
        for a, b in self._data.contact.geom:
            for pad, things in zip(self._pads, seen, strict=True):
                other = b if a == pad else a if b == pad else None
                if other is not None:
                    name = self._model.geom(int(other)).name
                    if name.startswith("thing/"):
                        things.add(name.removeprefix("thing/"))
        return frozenset(seen[0] & seen[1])

    def open(self) -> None:
        """Open to the full stroke, from now on."""
        self._command = 0.5 * self.gripper.stroke
        self.state, self._resting = GripperState.OPENING, 0.0

    def close(self) -> None:
        """Close until something is held or nothing is between the fingers, from now on."""
        self._command = 0.0
        self.state, self._resting = GripperState.CLOSING, 0.0

    def tick(self, dt: float) -> None:
        """What happens in `dt` seconds [s]: the drive moves on, and the state follows the fingers."""
        most = self.gripper.speed * dt
        self._opening += float(np.clip(self._command - self._opening, -most, most))
        self._data.ctrl[self._drive] = self._opening
        still = abs(float(self._data.qvel[self._dq])) < _AT_REST
        self._resting = self._resting + dt if still else 0.0
        if self.state is GripperState.OPENING:
            if self._resting >= _SETTLING and self.width > 0.97 * self.gripper.stroke:
                self.state = GripperState.OPEN
        elif self.state is GripperState.CLOSING:
            if (
                self._resting >= _SETTLING and 2.0 * self._opening < self.width - _SAG
            ):  # the drive presses, or has arrived
                self._settle()
            elif self._resting >= _SETTLING and self._opening == 0.0:
                self._settle()
        elif self.state is GripperState.HOLDING:
            if self.width < self.gripper.narrowest:
                self.state = GripperState.EMPTY
            elif abs(self.width - self._gripped) > 0.04 * self.gripper.stroke:  # it slips, or turns
                self.state, self._resting = GripperState.CLOSING, 0.0

    def _settle(self) -> None:
        self._gripped = self.width
        self.state = GripperState.EMPTY if self.width < self.gripper.narrowest else GripperState.HOLDING
