"""What does one forward kinematics or one Jacobian cost when called from Python?

The arm is the UR5e, the joint values are in a NumPy array, the answer is an array of doubles unless the name says
otherwise. Each statement is timed in a loop, the statements take turns.

    python benchmarks/single_call.py [--rounds 41]
"""

import argparse
import warnings

import paired

# isort: split
import arms
import numpy as np
import results

REUSED = ("Pinocchio, to its SE3", "Pinocchio, all frames")
Statements = dict[str, tuple[str, dict[str, object]]]


def pinocchio_statements(arm: arms.Arm, q: np.ndarray) -> tuple[Statements, Statements]:
    """Pinocchio's shortest documented ways, its model and data made beforehand."""
    import pinocchio

    model = pinocchio.buildModelFromXML(arm.urdf())
    names = {
        "pin": pinocchio,
        "model": model,
        "data": model.createData(),
        "tip": model.getFrameId(arm.tip),
        "frame": pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED,
        "q": q,
    }
    update = "pin.forwardKinematics(model, data, q); pin.updateFramePlacement(model, data, tip)"
    forward = {
        "Pinocchio, to its SE3": (update, names),
        "Pinocchio, to an array": (update + ".homogeneous", names),
        "Pinocchio, all frames": ("pin.framesForwardKinematics(model, data, q)", names),
    }
    jacobian = {"Pinocchio": ("pin.computeFrameJacobian(model, data, q, tip, frame)", names)}
    return forward, jacobian


def other_statements(arm: arms.Arm, q: np.ndarray) -> tuple[Statements, Statements]:
    """Robotics Toolbox, TRAC-IK's KDL, ikpy and kinpy."""
    import ikpy.chain
    import kinpy
    import pytracik
    import roboticstoolbox

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        ets = roboticstoolbox.Robot.URDF(str(arm.urdf_file())).ets(start=arm.base, end=arm.tip)
        chain = ikpy.chain.Chain.from_urdf_file(str(arm.urdf_file()), base_elements=[arm.base])
    padded = np.zeros(len(chain.links))
    padded[[link.joint_type != "fixed" for link in chain.links]] = q
    solver = pytracik.TRAC_IK(arm.base, arm.tip, arm.urdf(), 0.005, 1e-9, pytracik.SolveType.Speed)
    serial = kinpy.build_serial_chain_from_urdf(arm.urdf(), arm.tip, arm.base)
    forward = {
        "Robotics Toolbox": ("ets.eval(q)", {"ets": ets, "q": q}),
        "TRAC-IK (KDL)": ("pytracik.fk(solver, q)", {"pytracik": pytracik, "solver": solver, "q": q}),
        "ikpy": ("chain.forward_kinematics(q)", {"chain": chain, "q": padded}),
        "kinpy, to its Transform": ("serial.forward_kinematics(q)", {"serial": serial, "q": q}),
    }
    jacobian = {
        "Robotics Toolbox": ("ets.jacob0(q)", {"ets": ets, "q": q}),
        "kinpy": ("serial.jacobian(q)", {"serial": serial, "q": q}),
    }
    return forward, jacobian


def our_statements(q: np.ndarray) -> tuple[Statements, Statements]:
    import pieper

    arm = pieper.load("ur5e")
    names = {"arm": arm, "q": q, "T": np.empty((4, 4)), "J": np.empty((6, 6))}
    forward = {"pieper": ("arm.fk(q)", names), "pieper, output reused": ("arm.fk(q, out=T)", names)}
    jacobian = {"pieper": ("arm.jacobian(q)", names), "pieper, output reused": ("arm.jacobian(q, out=J)", names)}
    return forward, jacobian


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=41)
    parser.add_argument("--peers-only", action="store_true", help="leave pieper out")
    options = parser.parse_args()
    paired.pin_to_one_core()

    arm = arms.load("ur5e")
    q = arm.sample(1)[0]
    sources = [pinocchio_statements(arm, q), other_statements(arm, q)]
    if not options.peers_only:
        sources.insert(0, our_statements(q))

    figures: dict[str, object] = {}
    for index, question in enumerate(("forward_kinematics", "jacobian")):
        statements = {name: item for source in sources for name, item in source[index].items()}
        seconds = paired.calls_in_turn(statements, rounds=options.rounds)
        rows = [
            {
                "name": name,
                "statement": statements[name][0],
                "nanoseconds": paired.quartiles([value * 1e9 for value in values]),
            }
            for name, values in seconds.items()
        ]
        rows.sort(key=lambda row: row["nanoseconds"]["median"])
        ratios = {}
        for name, values in seconds.items() if "pieper" in seconds else ():
            if not name.startswith("pieper"):
                # Pinocchio writes its SE3 into its own data: that is an output reused. An array it makes anew.
                ours = "pieper, output reused" if name in REUSED else "pieper"
                ratios[f"{name} / {ours}"] = paired.ratio(values, seconds[ours])
        figures[question] = {"rows": results.rounded(rows), "ratios": results.rounded(ratios)}

        print(question)
        for row in rows:
            print(f"  {row['name']:30} {row['nanoseconds']['median']:12.0f} ns   {row['statement']}")
        for name, value in ratios.items():
            print(f"  {name:40} {value['median']:8.2f}")

    results.save(
        "single_call",
        method=f"UR5e, one configuration, one thread, processor time, {options.rounds} rounds in turn, medians",
        packages=["pin", "roboticstoolbox-python", "pytracik", "ikpy", "kinpy"],
        **figures,
    )


if __name__ == "__main__":
    main()
