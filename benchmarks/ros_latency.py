"""How long does a ROS node of pieper take from question to answer, on bare DDS over loopback?

Three questions, each against an echo node on the same bus in the same run, which takes the same kind of message and
answers at once with one of the same kind, so that what is left is the node's own work:

* joint states in, pose out (``pieper ros forward``), at a steady rate, for some time: how much later than the echo, and
  is any lost?
* a target in, first joint state out (``pieper ros inverse``, ``method:=solve``);
* ``calculate_ik`` of 1000 poses in one call (``pieper ros ik_server``).

Node and echo are asked in turns of a few seconds. The clock is the monotonic one of the asking process, from before the
message is built until its answer is decoded: twice the way over DDS, and building and reading on both sides. All queues hold 1000 messages (the forward node's default is the reports' 10, which at
1 kHz is a stall of 10 ms).

    python benchmarks/ros_latency.py [--seconds 60] [--rate 1000] [--arm mh12]
"""

import argparse
import contextlib
import gc
import subprocess
import sys
import time

import numpy as np
import results

import pieper
from pieper.ros import Bus, messages, open_bus
from pieper.ros.qos import QoS
from pieper.spatial import rotation

DOMAIN = 77
TURN = 5.0  # seconds
DEEP = QoS(depth=1000)

ECHO = """
import sys
from pieper.ros import open_bus
from pieper.ros.qos import QoS
deep = QoS(depth=1000)
bus = open_bus("echo", arguments=["--ros-args", "-r", "__ns:=/echo"], backend="bare", domain=int(sys.argv[1]))
pose = bus.publisher("pose", "geometry_msgs/msg/PoseStamped", qos=deep)
states = bus.publisher("joint_states", "sensor_msgs/msg/JointState", qos=deep)
names = sys.argv[2].split(",")
zeros = [0.0] * len(names)
bus.subscribe("question", "sensor_msgs/msg/JointState", lambda state: pose.send(header=state.header, pose={}), qos=deep)
bus.subscribe("target", "geometry_msgs/msg/Point", lambda point: states.send(name=names, position=zeros), qos=deep)
point = {"positions": zeros}
bus.serve("calculate_ik", "pieper_interfaces/srv/CalculateIK", lambda request: {"points": [point] * len(request.poses)})
bus.spin()
"""


@contextlib.contextmanager
def child(*command: str):
    """A process that lives as long as the block."""
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.terminate()
        process.wait(10)


def node(name: str, arm: str, *arguments: str):
    command = [sys.executable, "-m", "pieper", "ros", name, arm, "--backend", "bare", "--domain", str(DOMAIN)]
    return child(*command, *arguments)


class Steady:
    """Asks at a steady rate with numbered messages, and notes when each answer came."""

    def __init__(self, bus: Bus, names: tuple[str, ...], question: str, answer: str) -> None:
        self.bus, self.names = bus, list(names)
        self.sent: list[int] = []
        self.warm = 0  # how many of the first do not count
        self.back: dict[int, int] = {}
        self.publisher = bus.publisher(question, "sensor_msgs/msg/JointState", qos=DEEP)
        self.subscription = bus.subscribe(answer, "geometry_msgs/msg/PoseStamped", self.note, qos=DEEP)

    def note(self, pose) -> None:
        self.back[pose.header.stamp.sec] = time.monotonic_ns()

    def ask(self, q: np.ndarray) -> None:
        number = len(self.sent)
        self.sent.append(time.monotonic_ns())
        self.publisher.send(header={"stamp": {"sec": number}}, name=self.names, position=q)

    def run(self, seconds: float, rate: float, joints: np.ndarray) -> None:
        period = round(1e9 / rate)
        due = time.monotonic_ns()
        end = due + round(seconds * 1e9)
        while due < end:
            while (left := due - time.monotonic_ns()) > 0:
                self.bus.spin_once(left * 1e-9)
            self.ask(joints[len(self.sent) % len(joints)])
            due += period
        self.bus.spin_until(lambda: len(self.back) == len(self.sent), timeout=2.0)

    def figures(self) -> dict[str, float]:
        counted = range(self.warm, len(self.sent))
        times = np.array([self.back[i] - self.sent[i] for i in counted if i in self.back]) * 1e-6
        return {
            "messages": len(counted),
            "lost": len(counted) - len(times),
            "median_ms": float(np.median(times)),
            "p99_ms": float(np.percentile(times, 99)),
            "p999_ms": float(np.percentile(times, 99.9)),
            "largest_ms": float(times.max()),
        }


def joint_states(bus: Bus, arm: pieper.Arm, seconds: float, rate: float) -> dict[str, dict[str, float]]:
    joints = np.random.default_rng(0).uniform(*arm.chain.limits.T, (1000, arm.chain.dof))
    asked = {
        "echo": Steady(bus, arm.chain.joint_names, "/echo/question", "/echo/pose"),
        "forward": Steady(bus, arm.chain.joint_names, "/forward/joint_states", "/forward/pose"),
    }
    for one in asked.values():
        if not bus.spin_until(lambda one=one: one.publisher.subscribers and one.subscription.publishers, timeout=20.0):
            raise SystemExit(f"nobody at {one.publisher.topic}")
    for one in asked.values():
        one.run(0.5, rate, joints)  # warm up
        one.warm = len(one.sent)
    for _ in range(round(seconds / TURN)):
        for one in asked.values():
            one.run(TURN, rate, joints)
    return {name: one.figures() for name, one in asked.items()}


def targets(bus: Bus, arm: pieper.Arm, count: int) -> dict[str, dict[str, float]]:
    rng = np.random.default_rng(1)
    found = {}
    for name in ("echo", "inverse"):
        back: list[int] = []
        publisher = bus.publisher(f"/{name}/target", "geometry_msgs/msg/Point", qos=DEEP)
        heard = bus.subscribe(
            f"/{name}/joint_states",
            "sensor_msgs/msg/JointState",
            lambda _, back=back: back.append(time.monotonic_ns()),
            qos=DEEP,
        )
        if not bus.spin_until(lambda p=publisher, h=heard: p.subscribers and h.publishers, timeout=20.0):
            raise SystemExit(f"nobody at /{name}/target")
        times = []
        for _ in range(count):
            bus.spin_until(lambda: False, timeout=0.05 if name == "echo" else 0.6)  # let the last motion end
            x, y, z = arm.fk(rng.uniform(*arm.chain.limits.T))[:3, 3]
            back.clear()
            start = time.monotonic_ns()
            publisher.send(x=x, y=y, z=z)
            if bus.spin_until(lambda back=back: bool(back), timeout=2.0):
                times.append((back[0] - start) * 1e-6)
        found[name] = {
            "asked": count,
            "answered": len(times),
            "median_ms": float(np.median(times)),
            "p99_ms": float(np.percentile(times, 99)),
        }
    return found


def many_poses(bus: Bus, arm: pieper.Arm, calls: int, count: int = 1000) -> dict[str, dict[str, float]]:
    q = np.random.default_rng(2).uniform(*arm.chain.limits.T, (count, arm.chain.dof))
    poses = []
    for T in arm.fk(q):
        x, y, z, w = rotation.as_quaternion(T[:3, :3])
        position = dict(zip("xyz", T[:3, 3], strict=True))
        poses.append({"position": position, "orientation": {"x": x, "y": y, "z": z, "w": w}})
    clients = {
        name: bus.client(f"/{name}/calculate_ik", "pieper_interfaces/srv/CalculateIK") for name in ("echo", "ik")
    }
    times: dict[str, list[float]] = {name: [] for name in clients}
    for _ in range(calls):
        for name, client in clients.items():
            bus.call(client, 20.0, poses=[])
            request = messages.make("pieper_interfaces/srv/CalculateIK_Request", poses=poses)
            start = time.monotonic_ns()
            answer = bus.call(client, 20.0, request)
            times[name].append((time.monotonic_ns() - start) * 1e-6)
            assert len(answer.points) == count
            if name == "ik":
                assert sum(len(point.positions) == arm.chain.dof for point in answer.points) == count
    return {name: {"poses": count, "median_ms": float(np.median(found)), "p90_ms": float(np.percentile(found, 90))}
            for name, found in times.items()}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0, help="of joint states to each node")
    parser.add_argument("--rate", type=float, default=1000.0)
    parser.add_argument("--arm", default="mh12")
    options = parser.parse_args()
    arm = pieper.load(options.arm)
    figures = {}
    with (
        open_bus("asker", backend="bare", domain=DOMAIN) as bus,
        child(sys.executable, "-c", ECHO, str(DOMAIN), ",".join(arm.chain.joint_names)),
    ):
        gc.disable()
        with node("forward", options.arm, "queue:=1000", "--ros-args", "-r", "__ns:=/forward"):
            figures["joint_states"] = joint_states(bus, arm, options.seconds, options.rate)
        with node("inverse", options.arm, "--ros-args", "-r", "__ns:=/inverse"):
            figures["target"] = targets(bus, arm, 100)
        with node("ik_server", options.arm, "--ros-args", "-r", "__ns:=/ik"):
            figures["calculate_ik"] = many_poses(bus, arm, 15)
    for question, rows in figures.items():
        (_, echo), (_, ours) = rows.items()
        ours["ratio_to_echo"] = ours["median_ms"] / echo["median_ms"]
        ours["added_median_ms"] = ours["median_ms"] - echo["median_ms"]
        print(question, results.rounded(rows, 3))
    results.save(
        "ros_latency",
        method=f"{options.arm}, {options.rate:g} joint states a second for {options.seconds:g} s, bare DDS over loopback, "
        "three processes on this machine; monotonic clock of the asking process",
        packages=["cyclonedds", "rosbags"],
        **results.rounded(figures),
    )


if __name__ == "__main__":
    main()
