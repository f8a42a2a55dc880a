"""What has which package? Every "yes" is a name that is imported from the installed package; every "no" that none was found.

A feature that a package seems to have by the names it defines, but that is credited with none here, is printed: look at it and decide.
Names are those of functions, classes and modules, in Python files and in what compiled modules offer.

    python benchmarks/features.py
"""

import contextlib
import importlib
import importlib.util
import inspect
import io
import pathlib
import pkgutil
import re
import warnings
from importlib import metadata

import results

PEERS = {  # as a column of the table: distribution, module
    "Pinocchio": ("pin", "pinocchio"),
    "EAIK": ("EAIK", "eaik"),
    "ssik": ("ssik", "ssik"),
    "Robotics Toolbox": ("roboticstoolbox-python", "roboticstoolbox"),
    "ikpy": ("ikpy", "ikpy"),
    "kinpy": ("kinpy", "kinpy"),
    "py-opw": ("py-opw-kinematics", "py_opw_kinematics"),
    "TRAC-IK": ("pytracik", "pytracik"),
    "ur-analytic-ik": ("ur-analytic-ik", "ur_analytic_ik"),
}
RTB = "roboticstoolbox:"
FEATURES: dict[str, tuple[str, dict[str, str]]] = {  # what: (names that hint at it, the names that prove it)
    "every solution, closed forms of 6 joints": (
        r"analytic_?ik|closed_?form|all_solutions|subproblem",
        {
            "pieper": "pieper.ik.solve:solve",
            "EAIK": "eaik.IK_DH:DhRobot",
            "ssik": "ssik:Manipulator.solve",
            "Robotics Toolbox": RTB + "DHRobot.analytic_ik",
            "py-opw": "py_opw_kinematics:Robot.inverse",
            "ur-analytic-ik": "ur_analytic_ik:ur5e.inverse_kinematics",
        },
    ),
    "every solution, 6 joints without a closed form": (
        r"general_?6r|raghavan",
        {
            "pieper": "pieper.ik.general_6r:solve_general_6r",
            "ssik": "ssik:Manipulator.solve",
            "Robotics Toolbox": "roboticstoolbox.robot.symbolic_ik_rr:General6RIK",
        },
    ),
    "7 joints, many answers": (
        r"self_motion|redundan|seven|7r",
        {"pieper": "pieper.ik.redundancy:self_motion", "ssik": "ssik:Manipulator.self_motion"},
    ),
    "iteration to one answer": (
        r"^ik(ine)?_(lm|nr|gn)|^inverse_kinematics$|^cart_to_jnt$",
        {
            "pieper": "pieper.ik.numeric:solve_numeric",
            "Robotics Toolbox": RTB + "Robot.ik_LM",
            "ikpy": "ikpy.chain:Chain.inverse_kinematics",
            "kinpy": "kinpy:chain.SerialChain.inverse_kinematics",
            "TRAC-IK": "pytracik:TRAC_IK",
        },
    ),
    "Jacobian": (
        r"^jacob(ian|0|e)?$|compute_?joint_?jacobian",
        {
            "pieper": "pieper.arm:Arm.jacobian",
            "Pinocchio": "pinocchio:computeFrameJacobian",
            "Robotics Toolbox": RTB + "Robot.jacob0",
            "kinpy": "kinpy:chain.SerialChain.jacobian",
        },
    ),
    "URDF": (
        r"urdf",
        {
            "pieper": "pieper.model.urdf:from_urdf",
            "Pinocchio": "pinocchio:buildModelFromUrdf",
            "EAIK": "eaik.IK_URDF:UrdfRobot",
            "ssik": "ssik:Manipulator.from_urdf",
            "Robotics Toolbox": RTB + "Robot.URDF",
            "ikpy": "ikpy.chain:Chain.from_urdf_file",
            "kinpy": "kinpy:build_chain_from_urdf",
            "TRAC-IK": "pytracik:TRAC_IK",
        },
    ),
    "xacro": (
        r"xacro",
        {
            "pieper": "pieper.model.xacro:expand",
            "ssik": "ssik._urdf:process_xacro",
            "Robotics Toolbox": "roboticstoolbox.models.URDF.URDFRobot:_expand_xacro",
        },
    ),
    "MuJoCo's MJCF": (
        r"mjcf",
        {
            "Pinocchio": "pinocchio:buildModelFromMJCF",
            "ssik": "ssik:Manipulator.from_mjcf",
            "ikpy": "ikpy.chain:Chain.from_mjcf_file",
            "kinpy": "kinpy:build_chain_from_mjcf",
        },
    ),
    "dynamics": (
        r"^(rnea|rne|crba|aba|inverse_dynamics|mass_matrix)$",
        {"Pinocchio": "pinocchio:rnea", "Robotics Toolbox": RTB + "Robot.rne"},
    ),
    "derivatives of dynamics, floating bases": (
        r"rneaderivatives|freeflyer$",
        {"Pinocchio": "pinocchio:computeRNEADerivatives"},
    ),
    "mobile robots, filters, maps": (
        r"ekf|particlefilter|occgrid",
        {"Robotics Toolbox": RTB + "EKF"},
    ),
    "collisions": (
        r"collision|collid",
        {
            "pieper": "pieper.motion.collision:CollisionModel",
            "Pinocchio": "pinocchio:computeCollisions",
            "Robotics Toolbox": RTB + "Robot.iscollided",
        },
    ),
    "ways around obstacles, for arms": (r"^ompl|rrt|planner", {"pieper": "pieper.motion.planning:plan"}),
    "timed trajectories": (
        r"[jmc]traj$|trapezoidal|traject",
        {"pieper": "pieper.motion.timing:time_path", "Robotics Toolbox": RTB + "jtraj"},
    ),
    "a picture of the arm": (
        r"visuali[sz]er$|^plot$|^teleop",
        {
            "pieper": "pieper.sim.picture:Picture",
            "Pinocchio": "pinocchio.visualize:MeshcatVisualizer",
            "ssik": "ssik.teleop",
            "Robotics Toolbox": RTB + "Robot.plot",
            "ikpy": "ikpy.chain:Chain.plot",
            "kinpy": "kinpy.visualizer",
        },
    ),
    "C++ headers": (
        r"^get_include$",
        {
            "Pinocchio": "file:libpinocchio:pinocchio/algorithm/aba.hpp",
            "ssik": "file:ssik:ssik_cpp/chart.hpp",
            "ur-analytic-ik": "file:ur-analytic-ik:inverse_kinematics.hh",
        },
    ),
    "writes source code for an arm": (
        r"codegen|^generate",
        {"ssik": "ssik.codegen", "Robotics Toolbox": "roboticstoolbox.robot.symbolic_ik_rr:AnalyticIK.generate"},
    ),
    "a JAX backend": (r"jax", {"ikpy": "ikpy.jax_backend"}),
    "contact physics, pick and place": (r"pick_?and|gripper|simulat", {"pieper": "pieper.tasks.pick:PickAndPlace"}),
    "a camera: markers, hand-eye": (
        r"hand_?eye|aruco|charuco|camera",
        {"pieper": "pieper.perception.hand_eye:calibrate_hand_eye"},
    ),
    "ROS 2 nodes": (r"rclpy|ros2|ros_?node|^ros$", {"pieper": "pieper.ros.nodes"}),
}


LOOKED_AT = {
    ("Jacobian", "ssik"): "a local function of one solver",
    ("collisions", "kinpy"): "a shape read from a file",
    ("ways around obstacles, for arms", "Robotics Toolbox"): "for vehicles in the plane",
    ("timed trajectories", "ikpy"): "a picture of one",
    ("contact physics, pick and place", "Robotics Toolbox"): "a part of the model of a robot",
    ("a camera: markers, hand-eye", "Pinocchio"): "the camera of the viewer",
    ("ROS 2 nodes", "Robotics Toolbox"): "for ROS 1",
}
"""Names that hint at something which is not there."""


def named(path: str) -> object:
    """What ``module:name.name`` means; a ``module`` alone, and a ``file:distribution:name``, is only found."""
    module, _, names = path.partition(":")
    if module == "file":
        distribution, _, name = names.partition(":")
        return next(file for file in metadata.files(distribution) or () if str(file).endswith(name))
    if not names:
        if (spec := importlib.util.find_spec(module)) is None:
            raise ModuleNotFoundError(module)
        return spec
    found: object = importlib.import_module(module)
    for name in filter(None, names.split(".")):
        found = getattr(found, name)
    return found


def names_of(module: str) -> set[str]:
    """Names that a package defines, without those of tests and of the robots that it brings along."""
    package = importlib.import_module(module)
    files = [pathlib.Path(package.__file__)]
    if hasattr(package, "__path__"):
        files = [file for place in package.__path__ for file in pathlib.Path(place).rglob("*.py")]
    own = [file for file in files if file.suffix == ".py" and not {"prebuilt", "models", "tests"} & set(file.parts)]
    found = {file.stem for file in own}
    for file in own:
        found |= set(re.findall(r"^\s*(?:def|class) (\w+)", file.read_text(errors="replace"), re.MULTILINE))
    modules = [package]
    if hasattr(package, "__path__"):
        for entry in pkgutil.iter_modules(package.__path__):
            with contextlib.suppress(Exception):
                modules.append(importlib.import_module(f"{module}.{entry.name}"))
    for one in modules:
        if not str(getattr(one, "__file__", "")).endswith(".py"):
            found |= set(dir(one))
            found |= {name for kind in vars(one).values() if inspect.isclass(kind) for name in dir(kind)}
    return {name for name in found if not name.startswith("__")}


def robots() -> dict[str, int]:
    """How many robots each brings along."""
    import roboticstoolbox as rtb
    import ssik
    import ur_analytic_ik

    from pieper.model import catalog

    classes = {
        name.lower()
        for kind in (rtb.models.DH, rtb.models.URDF, rtb.models.ETS)
        for name, entry in vars(kind).items()
        if inspect.isclass(entry)
    }
    return {
        "pieper": len(catalog.names()),
        "Robotics Toolbox": len(classes),
        "ssik": len(ssik.list_arms()),
        "ur-analytic-ik": sum(hasattr(getattr(ur_analytic_ik, name), "inverse_kinematics") for name in dir(ur_analytic_ik)),
    }  # fmt: skip


def main() -> None:
    warnings.simplefilter("ignore")
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        known = {peer: names_of(module) for peer, (_, module) in PEERS.items()}
        count = robots()
        for _, proofs in FEATURES.values():
            for path in proofs.values():
                named(path)
    rows = []
    for words, (pattern, proofs) in FEATURES.items():
        for peer, names in known.items():
            hints = sorted(name for name in names if re.search(pattern, name, re.IGNORECASE))
            if hints and peer not in proofs and (words, peer) not in LOOKED_AT:
                print(f"{words}: {peer} has {', '.join(hints[:8])}")
        rows.append({"feature": words, "looked_for": pattern, "by": proofs})
    path = results.save(
        "features",
        method="every yes is a name that was imported from the package, every no that none like it was found among its names",
        packages=[distribution for distribution, _ in PEERS.values()],
        robots=count,
        rows=rows,
    )
    print(path)


if __name__ == "__main__":
    main()
