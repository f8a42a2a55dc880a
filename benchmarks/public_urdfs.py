"""Is forward kinematics equal to Pinocchio's on robot descriptions that other people wrote?

Every URDF file in the installed packages of requirements-urdfs.txt (and in those of the peers) is read where it lies, by
`pieper.load` and by Pinocchio; nothing is copied. Compared is every chain from the root to a leaf with at least three
moving joints, for joint values within the limits and beyond them, mimic joints and sliding joints included. Below a
floating or planar joint the chain starts at the child of that joint.

    python benchmarks/public_urdfs.py [--configurations 64] [--packages example-robot-data ...]

Distances are compared relative to the size of the robot where that is more than a metre: a double has sixteen digits.
"""

import argparse
import collections
import hashlib
import pathlib
import re
import sys
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from importlib import metadata

import paired  # noqa: F401  (one thread for linear algebra)

# isort: split
import arms
import numpy as np
import pinocchio
import results

import pieper
from pieper.errors import PieperWarning
from pieper.model.urdf import from_urdf

PACKAGES = (
    "airo-models",
    "dexmate-urdf",
    "example-robot-data",
    "icub-models",
    "jvrc-description",
    "pybullet",
    "rtb-data",
)
LEAST_JOINTS = 3
TOLERANCE = 1e-12
_STRAIGHT = (("multiplier", "1"), ("offset", "0"))
MOVING = ("revolute", "continuous", "prismatic")


def files(package: str) -> Iterator[tuple[str, pathlib.Path]]:
    """The URDF files that a package brought: their path in it, and where they are."""
    for item in metadata.files(package) or ():
        if item.suffix.lower() == ".urdf" and "random_urdfs" not in item.parts:  # those are 1000 single objects
            path = pathlib.Path(item.locate()).resolve()
            if path.is_file():
                yield "/".join(part for part in item.parts if part != ".."), path


def tree(path: pathlib.Path) -> ET.Element:
    """The XML of a URDF, read without the package under test; the colons of prefixes that may not be declared go."""
    text = path.read_text(encoding="utf-8", errors="replace").strip()
    return ET.fromstring(re.sub(r"([<\s]|</)([A-Za-z_][\w.-]*):(?=[A-Za-z_])", r"\1\2_", text).encode())


def chains(robot: ET.Element) -> list[tuple[str, str]]:
    """Base and tip of every path from the root to a leaf with enough moving joints."""
    above = {}
    for joint in robot.findall("joint"):
        above[joint.find("child").get("link")] = (joint.find("parent").get("link"), joint.get("type"))
    parents = {parent for parent, _ in above.values()}
    found = []
    for leaf in (link.get("name") for link in robot.findall("link") if link.get("name") not in parents):
        link, count = leaf, 0
        while link in above and above[link][1] in (*MOVING, "fixed"):
            count += above[link][1] in MOVING
            link = above[link][0]
        if count >= LEAST_JOINTS:
            found.append((link, leaf))
    return found


class Peer:
    """Pinocchio on one file.

    It cannot build mimic joints that follow a joint of another branch; then they are joints of their own here, and are
    given the values that the file asks for.
    """

    def __init__(self, path: pathlib.Path, robot: ET.Element) -> None:
        self.followers: dict[str, list[tuple[str, float, float]]] = collections.defaultdict(list)
        try:
            self.model = pinocchio.buildModelFromUrdf(str(path), mimic=True)
            self.mimic = "built by Pinocchio"
        except ValueError as fault:
            if "mimic" not in str(fault):
                raise
            self.model = pinocchio.buildModelFromUrdf(str(path))
            self.mimic = "values given"
            for joint in robot.findall("joint"):
                mimic = joint.find("mimic")
                if mimic is not None:
                    factor, offset = (float(mimic.get(key, default)) for key, default in _STRAIGHT)
                    self.followers[mimic.get("joint")].append((joint.get("name"), factor, offset))
        self.data = self.model.createData()

    def forward(self, names: tuple[str, ...], q: np.ndarray, base: str, tip: str) -> np.ndarray:
        """Poses of the tip in the base frame for rows of values of the named joints; the others rest at zero."""
        first, last = (self.model.getFrameId(name, pinocchio.FrameType.BODY) for name in (base, tip))
        T = np.empty((len(q), 4, 4))
        for i, row in enumerate(q):
            configuration = pinocchio.neutral(self.model)
            for name, value in zip(names, row, strict=True):
                self.move(configuration, name, value)
            for name in self.followers.keys() - set(names):
                if not any(name == follower for each in self.followers.values() for follower, _, _ in each):
                    self.move(configuration, name, 0.0)
            pinocchio.framesForwardKinematics(self.model, self.data, configuration)
            T[i] = self.data.oMf[first].actInv(self.data.oMf[last]).homogeneous
        return T

    def move(self, configuration: np.ndarray, name: str, value: float) -> None:
        """Set a joint, and those that follow it where Pinocchio does not."""
        joint = self.model.joints[self.model.getJointId(name)]
        values = [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
        configuration[joint.idx_q : joint.idx_q + joint.nq] = values
        for follower, factor, offset in self.followers.get(name, ()):
            self.move(configuration, follower, factor * value + offset)


def sample(limits: np.ndarray, count: int) -> np.ndarray:
    """Joint values up to half the range beyond the limits on either side, and zero."""
    lower, upper = np.where(np.isfinite(limits), limits, [-np.pi, np.pi]).T
    margin = 0.5 * (upper - lower)
    q = np.random.default_rng(0).uniform(lower - margin, upper + margin, (count, len(limits)))
    q[0] = 0.0
    return q


def compare(arm: pieper.Arm, peer: Peer, count: int) -> float:
    """The largest difference of an element; positions relative to the size of the arm where that is above 1 m."""
    q = sample(arm.limits, count)
    expected = peer.forward(arm.joint_names, q, arm.base, arm.tip)
    size = max(1.0, float(np.abs(expected[:, :3, 3]).max()))
    difference = np.abs(arm.fk(q) - expected)
    return float(max(difference[:, :3, :3].max(), difference[:, :3, 3].max() / size))


def answer(read: Callable[[], object]) -> tuple[object, str | None]:
    """What a reader returns, or its words when it refuses."""
    try:
        return read(), None
    except Exception as fault:  # noqa: BLE001  (whatever a reader raises is its answer)
        return None, str(fault).strip() or type(fault).__name__


def examine(path: pathlib.Path, count: int) -> tuple[list[dict], dict[str, str | None], str | None]:
    """What was compared in one file, the words of each reader that refuses it, and who moved the mimic joints."""
    description, ours = answer(lambda: from_urdf(path))
    robot, _ = answer(lambda: tree(path))
    ends, _ = answer(lambda: chains(robot))
    peer, theirs = answer(lambda: Peer(path, robot))
    refusals = {
        who: said and said.replace(str(path), path.name) for who, said in (("pieper", ours), ("pinocchio", theirs))
    }
    if description is None or peer is None:
        return [], refusals, None
    rows = []
    for base, tip in ends:
        arm = pieper.load(path, base=base, tip=tip)
        joints = [step.joint for step in description.path(base, tip) if step.joint.moves]
        kinds = collections.Counter("mimic" if joint.mimic is not None else joint.type for joint in joints)
        axes = ", ".join(f"{number} {kind}" for kind, number in kinds.items())
        rows.append({"base": base, "tip": tip, "axes": axes, "difference": compare(arm, peer, count)})
    return rows, refusals, peer.mimic


def built_in(count: int) -> dict[str, float]:
    """The built-in arms, written as URDF without the package under test, against Pinocchio: largest differences."""
    found = {}
    for name in arms.names(dof=range(1, 20)):
        path = arms.load(name).urdf_file()
        found[name] = compare(pieper.load(name), Peer(path, tree(path)), count)
    return found


def line(row: dict) -> str:
    """A chain in one line of the data."""
    return f"{row['base']} -> {row['tip']}: {row['axes']}: {row['difference']:.1e}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--configurations", type=int, default=64, help="per chain")
    parser.add_argument("--packages", nargs="*", default=PACKAGES)
    options = parser.parse_args()
    warnings.simplefilter("ignore", PieperWarning)  # meshes that are not there

    own = built_in(options.configurations)
    print(f"{len(own)} built-in arms: largest difference {max(own.values()):.1e}")
    compared, refused, small, seen = [], [], collections.Counter(), set()
    for package in options.packages:
        try:
            version = metadata.version(package)
        except metadata.PackageNotFoundError:
            print(f"{package} is not installed", file=sys.stderr)
            continue
        for name, path in sorted(files(package)):
            where = {"package": package, "version": version, "path": name}
            digest = hashlib.sha256(path.read_bytes()).hexdigest()
            if digest in seen:
                continue
            seen.add(digest)
            rows, refusals, mimic = examine(path, options.configurations)
            if any(refusals.values()):
                refused.append({**where, **{reader: words or "reads it" for reader, words in refusals.items()}})
                print(f"REFUSED   {name}: {refused[-1]['pieper']}   [Pinocchio: {refused[-1]['pinocchio']}]")
            elif not rows:
                small[package] += 1
            else:
                worst = max(row["difference"] for row in rows)
                mimics = {"mimic_joints": mimic} if any("mimic" in row["axes"] for row in rows) else {}
                compared.append({**where, **mimics, "difference": worst, "chains": rows})
                verdict = "equal" if worst <= TOLERANCE else "DIFFERENT"
                print(f"{verdict:9} {name}: {len(rows)} chains, {worst:.1e}", flush=True)

    total = sum(len(item["chains"]) for item in compared)
    equal = sum(item["difference"] <= TOLERANCE for item in compared)
    print(
        f"{equal} of {len(compared)} files equal to {TOLERANCE:g} ({total} chains); {len(refused)} refused by pieper or "
        f"Pinocchio, {sum(small.values())} without a chain of {LEAST_JOINTS} joints"
    )
    results.save(
        "public_urdfs",
        method=f"forward kinematics of every root-to-leaf chain with at least {LEAST_JOINTS} moving joints against "
        f"Pinocchio, {options.configurations} configurations each, up to half the range beyond the limits; largest "
        "difference of an element, positions relative to the reach where that is above 1 m; files with equal bytes once",
        packages=["pin", *options.packages],
        tolerance=TOLERANCE,
        files_compared=len(compared),
        files_equal=equal,
        chains_compared=total,
        files_without_a_chain=sum(small.values()),
        compared=[{**item, "chains": [line(row) for row in item["chains"]]} for item in results.rounded(compared, 2)],
        refused=refused,
        built_in=results.rounded(own, 2),
    )
    return int(equal < len(compared) or max(own.values()) > TOLERANCE)


if __name__ == "__main__":
    sys.exit(main())
