"""A Pinocchio model straight from the numbers of a built-in robot, past every line of our own kinematics."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pieper.model import catalog


class PinocchioArm:
    """Forward kinematics and Jacobian of a built-in robot by Pinocchio; joints in the order of ``q``."""

    def __init__(self, name: str, *, nominal: bool = False) -> None:
        record = catalog.record(name)
        model = pin.Model()
        at = {record["joints"][0]["parent"]: (0, pin.SE3.Identity())}
        for joint in record["joints"]:
            rpy = joint.get("rpy_nominal", joint["rpy"]) if nominal else joint["rpy"]
            parent, T_joint_link = at[joint["parent"]]
            T = T_joint_link * pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(joint["xyz"]))
            if joint["type"] == "fixed":
                at[joint["child"]] = (parent, T)
                continue
            axis = np.array(joint["axis"], dtype=float)
            slides = joint["type"] == "prismatic"
            kind = pin.JointModelPrismaticUnaligned(axis) if slides else pin.JointModelRevoluteUnaligned(axis)
            at[joint["child"]] = (model.addJoint(parent, kind, T, joint["name"]), pin.SE3.Identity())
        parent, T = at[record["tip"]]
        self.frame = model.addFrame(pin.Frame("tip", parent, 0, T, pin.FrameType.OP_FRAME))
        self.model, self.data = model, model.createData()

    def fk(self, q: np.ndarray) -> np.ndarray:
        """(n,) -> (4, 4)."""
        pin.framesForwardKinematics(self.model, self.data, q)
        return self.data.oMf[self.frame].homogeneous.copy()

    def jacobian(self, q: np.ndarray, frame: pin.ReferenceFrame = pin.LOCAL_WORLD_ALIGNED) -> np.ndarray:
        """(n,) -> (6, n)."""
        return pin.computeFrameJacobian(self.model, self.data, q, self.frame, frame).copy()

    def jacobian_rate(self, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
        """(n,), (n,) -> (6, n)."""
        pin.computeJointJacobiansTimeVariation(self.model, self.data, q, dq)
        pin.updateFramePlacements(self.model, self.data)
        return pin.getFrameJacobianTimeVariation(self.model, self.data, self.frame, pin.LOCAL_WORLD_ALIGNED).copy()
