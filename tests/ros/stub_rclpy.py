"""Something to try the rclpy wire on where ROS 2 cannot be installed.

It has the calls of rclpy that :mod:`pieper.ros.rcl` uses, with their signatures as documented for Jazzy, and moves messages inside
this process. It shows that the wire uses them consistently; that rclpy itself behaves so, only a ROS installation can show, where
the contract tests run on it.
"""

from __future__ import annotations

import sys
import time
import types
from collections import deque
from contextlib import contextmanager
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from typing import ClassVar

from pieper.ros import messages


class Context:
    def __init__(self):
        self.alive = False

    def ok(self):
        return self.alive


class QoSProfile:
    def __init__(self, *, history, depth, reliability, durability):
        self.history, self.depth, self.reliability, self.durability = history, depth, reliability, durability


class Duration:
    def __init__(self, *, seconds=0, nanoseconds=0):
        self.nanoseconds = seconds * 10**9 + nanoseconds


class _Policy:
    def __init__(self, *names):
        for rank, name in enumerate(names):
            setattr(self, name, rank)


class Future:
    def __init__(self):
        self.callbacks, self.value, self.done, self.given_up = [], None, False, False

    def add_done_callback(self, callback):
        self.callbacks.append(callback)

    def set_result(self, value):
        if self.given_up:
            return
        self.value, self.done = value, True
        for callback in self.callbacks:
            callback(self)

    def result(self):
        return self.value

    def exception(self):
        return None

    def cancelled(self):
        return False


class _End:
    """A publisher, subscription, service or client."""

    def __init__(self, node, kind, name, qos=None, callback=None, srv_type=None):
        self.node, self.kind, self.name, self.qos, self.callback, self.srv_type = (
            node,
            kind,
            name,
            qos,
            callback,
            srv_type,
        )
        self.kept: deque = deque(maxlen=qos.depth if qos else 100)
        self.inbox: deque = deque(maxlen=qos.depth if qos else 100)

    def peers(self, kind):
        return [end for end in Node.ends if (end.kind, end.name) == (kind, self.name) and self.fits(end)]

    def fits(self, other):
        if self.qos is None:
            return True
        publisher, subscription = (self, other) if self.kind == "publisher" else (other, self)
        return (
            publisher.qos.reliability >= subscription.qos.reliability
            and publisher.qos.durability >= subscription.qos.durability
        )

    def publish(self, data):
        assert isinstance(data, bytes)
        self.kept.append(data)
        for subscription in self.peers("subscription"):
            subscription.inbox.append(data)

    def get_subscription_count(self):
        return len(self.peers("subscription"))

    def send_response(self, response, header):
        future, response_class = header
        assert isinstance(response, response_class)
        future.set_result(response)

    def call_async(self, request):
        assert isinstance(request, self.srv_type.Request)
        future = Future()
        for service in self.peers("service")[:1]:
            service.inbox.append((request, (future, self.srv_type.Response)))
        return future

    def remove_pending_request(self, future):
        future.given_up = True

    def service_is_ready(self):
        return bool(self.peers("service"))


class Node:
    ends: ClassVar[list] = []

    def _add(self, end):
        self.ends.append(end)
        return end

    def create_publisher(self, msg_type, topic, qos_profile):
        return self._add(_End(self, "publisher", topic, qos_profile))

    def create_subscription(self, msg_type, topic, callback, qos_profile, *, raw=False):
        assert raw
        end = self._add(_End(self, "subscription", topic, qos_profile, callback))
        if qos_profile.durability:
            for publisher in end.peers("publisher"):
                end.inbox.extend(publisher.kept)
        return end

    def create_service(self, srv_type, srv_name, callback, *, qos_profile):
        return self._add(_End(self, "service", srv_name, qos_profile, callback, srv_type))

    def create_client(self, srv_type, srv_name, *, qos_profile):
        return self._add(_End(self, "client", srv_name, qos_profile, None, srv_type))

    def count_publishers(self, topic_name):
        end = next(e for e in self.ends if (e.kind, e.name, e.node) == ("subscription", topic_name, self))
        return len(end.peers("publisher"))

    def _destroy(self, end):
        self.ends.remove(end)

    destroy_publisher = destroy_subscription = destroy_service = destroy_client = _destroy

    def destroy_node(self):
        self.ends[:] = [end for end in self.ends if end.node is not self]


class SingleThreadedExecutor:
    def __init__(self, *, context=None):
        self.nodes: list = []

    def add_node(self, node):
        self.nodes.append(node)

    def wake(self):
        pass

    def shutdown(self, timeout_sec=None):
        self.nodes.clear()

    def spin_once(self, timeout_sec=None):
        deadline = time.monotonic() + timeout_sec
        while True:
            for end in [end for end in Node.ends if end.node in self.nodes and end.inbox and end.callback]:
                item = end.inbox.popleft()
                if end.kind == "subscription":
                    end.callback(item)
                else:
                    request, header = item
                    end.send_response(end.callback(request, end.srv_type.Response()), header)
                return
            if time.monotonic() >= deadline:
                return
            time.sleep(0.0005)


def _init(*, args=None, context=None, domain_id=None):
    context.alive = True


def _shutdown(*, context=None):
    context.alive = False


def _create_node(node_name, *, context, namespace, use_global_arguments, enable_rosout, start_parameter_services):
    assert context.ok()
    assert not use_global_arguments
    assert not enable_rosout
    assert not start_parameter_services
    return Node()


class _Interfaces(MetaPathFinder, Loader):
    """Message modules such as ``geometry_msgs.msg``, made of the types that pieper.ros.messages knows."""

    def find_spec(self, fullname, path=None, target=None):
        package = fullname.partition(".")[0]
        known = package.endswith(("_msgs", "_interfaces", "_srvs"))
        return ModuleSpec(fullname, self, is_package="." not in fullname) if known else None

    def create_module(self, spec):
        package, _, kind = spec.name.partition(".")
        module = types.ModuleType(spec.name)
        module.__getattr__ = lambda name: self.find_class(package, kind, name)
        return module

    def exec_module(self, module):
        pass

    @staticmethod
    def find_class(package, kind, name):
        if name.startswith("__"):
            raise AttributeError(name)
        if kind == "srv":
            return service_class(f"{package}/srv/{name}")
        if kind == "action":
            inner = {
                "SendGoalService": service_class(f"{package}/action/{name}_SendGoal"),
                "GetResultService": service_class(f"{package}/action/{name}_GetResult"),
                "FeedbackMessage": message_class(f"{package}/action/{name}_FeedbackMessage"),
            }
            return type(name, (), {"Impl": type(f"{name}_Impl", (), inner)})
        try:
            return message_class(f"{package}/{kind}/{name}")
        except Exception as error:
            raise AttributeError(name) from error


def message_class(type_name):
    return messages._store_with(type_name).types[type_name]


def service_class(type_name):
    request, response = (message_class(f"{type_name}_{part}") for part in ("Request", "Response"))
    return type(type_name.rpartition("/")[2], (), {"Request": request, "Response": staticmethod_class(response)})


def staticmethod_class(response):
    """A response class that can be made without arguments, as rclpy's can, and that its instances are instances of."""

    class Meta(type):
        def __call__(cls):
            return messages.make(response.__msgtype__)

        def __instancecheck__(cls, instance):
            return isinstance(instance, response)

    return Meta(response.__name__, (), {"type_name": response.__msgtype__})


def _serialize(message):
    return messages.encode(message.__msgtype__, message)


def _deserialize(data, message_class):
    name = getattr(message_class, "type_name", None) or message_class.__msgtype__
    return messages.decode(name, data)


@contextmanager
def installed():
    """For as long as this lasts, ``import rclpy`` finds this."""
    modules = {
        "rclpy": {"init": _init, "shutdown": _shutdown, "create_node": _create_node},
        "rclpy.context": {"Context": Context},
        "rclpy.executors": {"SingleThreadedExecutor": SingleThreadedExecutor},
        "rclpy.serialization": {"serialize_message": _serialize, "deserialize_message": _deserialize},
        "rclpy.duration": {"Duration": Duration},
        "rclpy.qos": {
            "QoSProfile": QoSProfile,
            "HistoryPolicy": _Policy("KEEP_LAST"),
            "ReliabilityPolicy": _Policy("BEST_EFFORT", "RELIABLE"),
            "DurabilityPolicy": _Policy("VOLATILE", "TRANSIENT_LOCAL"),
        },
    }
    finder = _Interfaces()
    before = set(sys.modules)
    for name, members in modules.items():
        module = types.ModuleType(name)
        module.__dict__.update(members)
        module.__path__ = []
        sys.modules[name] = module
    sys.meta_path.append(finder)
    try:
        yield
    finally:
        sys.meta_path.remove(finder)
        Node.ends.clear()
        for name in set(sys.modules) - before:
            if isinstance(getattr(sys.modules[name].__spec__, "loader", None), _Interfaces) or name.startswith("rclpy"):
                del sys.modules[name]
        for name in modules:
            sys.modules.pop(name, None)
