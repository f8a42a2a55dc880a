"""What a node may rely on, whichever network it is on: the same assertions over every backend."""

from __future__ import annotations

import os
import sys
import threading
import time

import numpy as np
import pytest

from pieper.errors import RosError
from pieper.ros import Reply
from pieper.ros.qos import DEFAULT, LATCHED, SENSOR, QoS

POINT = "geometry_msgs/msg/Point"
JOINT_STATE = "sensor_msgs/msg/JointState"
STRING = "std_msgs/msg/String"
SET_BOOL = "std_srvs/srv/SetBool"
TRIGGER = "std_srvs/srv/Trigger"


def heard_on(bus, topic, type_name, **options):
    heard: list = []
    return heard, bus.subscribe(topic, type_name, heard.append, **options)


def test_a_message_arrives_with_all_its_fields(network):
    sender, listener = network.join("sender"), network.join("listener")
    heard, _ = heard_on(listener, "joint_states", JOINT_STATE)
    publisher = sender.publisher("joint_states", JOINT_STATE)
    assert network.until(lambda: publisher.subscribers == 1)
    stamp = sender.stamp()
    publisher.send(header={"stamp": stamp, "frame_id": "base"}, name=["a", "é"], position=[0.1, -2.0])
    assert network.until(lambda: heard)
    message = heard[0]
    assert list(message.name) == ["a", "é"]
    assert np.asarray(message.position).tolist() == [0.1, -2.0]
    assert np.asarray(message.velocity).tolist() == []
    assert message.header.frame_id == "base"
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (stamp["sec"], stamp["nanosec"])


def test_messages_arrive_in_order_and_each_once(network):
    sender, listener = network.join("sender"), network.join("listener")
    heard, _ = heard_on(listener, "target", POINT, qos=QoS(depth=200))
    publisher = sender.publisher("target", POINT, qos=QoS(depth=200))
    assert network.until(lambda: publisher.subscribers)
    for i in range(150):
        publisher.send(x=float(i))
    assert network.until(lambda: len(heard) == 150)
    network.rest(0.1)
    assert [point.x for point in heard] == list(range(150))


def test_a_slow_listener_keeps_the_newest_samples_up_to_its_depth(network):
    sender, listener = network.join("sender"), network.join("listener")
    heard, _ = heard_on(listener, "target", POINT, qos=QoS(depth=3))
    publisher = sender.publisher("target", POINT, qos=QoS(depth=3))
    assert network.until(lambda: publisher.subscribers)
    for i in range(20):
        publisher.send(x=float(i))
    network.rest(0.2) if network.backend != "fake" else None
    assert network.until(lambda: heard and heard[-1].x == 19.0)
    if network.backend == "fake":  # elsewhere the listener may have worked between two samples
        assert [point.x for point in heard] == [17.0, 18.0, 19.0]


def test_a_node_hears_itself(network):
    bus = network.join("both")
    heard, _ = heard_on(bus, "echo", STRING)
    publisher = bus.publisher("echo", STRING)
    assert network.until(lambda: publisher.subscribers)
    publisher.send(data="to myself")
    assert network.until(lambda: heard)
    assert heard[0].data == "to myself"


def test_a_late_subscriber_gets_the_latched_sample(network):
    sender = network.join("sender")
    publisher = sender.publisher("robot_description", STRING, qos=LATCHED)
    publisher.send(data="old")
    publisher.send(data="<robot/>")
    network.rest(0.05)
    late = network.join("late")
    heard, _ = heard_on(late, "robot_description", STRING, qos=LATCHED)
    volatile, _ = heard_on(late, "robot_description", STRING, qos=DEFAULT)
    assert network.until(lambda: heard)
    network.rest(0.2)
    assert [message.data for message in heard] == ["<robot/>"]
    assert volatile == []


@pytest.mark.parametrize(
    ("offered", "wanted", "fits"),
    [
        (DEFAULT, DEFAULT, True),
        (DEFAULT, SENSOR, True),
        (SENSOR, SENSOR, True),
        (SENSOR, DEFAULT, False),
        (DEFAULT, LATCHED, False),
        (LATCHED, DEFAULT, True),
    ],
)
def test_quality_of_service_has_to_fit(network, offered, wanted, fits):
    sender, listener = network.join("sender"), network.join("listener")
    heard, subscription = heard_on(listener, "target", POINT, qos=wanted)
    publisher = sender.publisher("target", POINT, qos=offered)
    if fits:
        assert network.until(lambda: publisher.subscribers == 1 and subscription.publishers == 1)
    else:
        network.rest(0.3)
        assert (publisher.subscribers, subscription.publishers) == (0, 0)
    publisher.send(x=1.0)
    network.rest(0.1) if not fits else network.until(lambda: heard)
    assert len(heard) == fits


def test_a_closed_publisher_is_gone(network):
    sender, listener = network.join("sender"), network.join("listener")
    _, subscription = heard_on(listener, "target", POINT)
    publisher = sender.publisher("target", POINT)
    assert network.until(lambda: subscription.publishers == 1)
    publisher.close()
    assert network.until(lambda: subscription.publishers == 0)


def test_names_are_resolved_and_remapped(network):
    listener = network.join("listener")
    heard, _ = heard_on(listener, "/cell2/goal", POINT)
    sender = network.join("sender", "--ros-args", "-r", "__ns:=/cell2", "-r", "target:=goal", "-r", "__node:=arm")
    assert (sender.node, sender.namespace) == ("arm", "/cell2")
    publisher = sender.publisher("target", POINT)
    assert publisher.topic == "/cell2/goal"
    assert sender.publisher("~/state", POINT).topic == "/cell2/arm/state"
    assert network.until(lambda: publisher.subscribers)
    publisher.send(z=2.0)
    assert network.until(lambda: heard)


@pytest.mark.parametrize("name", ["", "/", "two words", "double//slash", "9lives", "ends/", "~x"])
def test_a_bad_name_is_refused(network, name):
    bus = network.join("node")
    with pytest.raises(RosError, match="name"):
        bus.publisher(name, POINT)


def test_unknown_types_and_fields_are_refused_with_what_is_there(network):
    bus = network.join("node")
    with pytest.raises(RosError, match="did you mean 'geometry_msgs/msg/Point'"):
        bus.publisher("target", "geometry_msgs/msg/Pint")
    publisher = bus.publisher("target", POINT)
    with pytest.raises(RosError, match="no field 'r'; its fields are: x, y, z"):
        publisher.send(r=1.0)
    with pytest.raises(RosError, match=r"geometry_msgs/msg/Point\.x must be a number, got 'far'"):
        publisher.send(x="far")


# Services


def test_a_service_is_answered(network):
    server, caller = network.join("server"), network.join("caller")
    server.serve("enable", SET_BOOL, lambda request: {"success": request.data, "message": f"enabled: {request.data}"})
    client = caller.client("enable", SET_BOOL)
    assert network.until(lambda: client.ready)
    answers: list = []
    client.send(answers.append, data=True)
    client.send(answers.append, data=False)
    assert network.until(lambda: len(answers) == 2)
    assert [(a.success, a.message) for a in answers] == [(True, "enabled: True"), (False, "enabled: False")]


def test_two_callers_get_their_own_answers(network):
    server = network.join("server")
    server.serve("enable", SET_BOOL, lambda request: {"success": request.data})
    answers: dict = {True: [], False: []}
    clients = {flag: network.join(f"caller_{flag}").client("enable", SET_BOOL) for flag in (True, False)}
    assert network.until(lambda: all(client.ready for client in clients.values()))
    for _ in range(20):
        for flag, client in clients.items():
            client.send(answers[flag].append, data=flag)
    assert network.until(lambda: all(len(found) == 20 for found in answers.values()))
    assert all(answer.success is flag for flag, found in answers.items() for answer in found)


def test_a_server_that_raises_still_answers_and_goes_on(network):
    server, caller = network.join("server"), network.join("caller")

    def callback(request):
        raise RuntimeError("wrench in the works") if request.data else RosError("refused")

    server.serve("enable", SET_BOOL, callback)
    client = caller.client("enable", SET_BOOL)
    assert network.until(lambda: client.ready)
    answers: list = []
    client.send(answers.append, data=True)
    client.send(answers.append, data=False)
    assert network.until(lambda: len(answers) == 2)
    assert not any(answer.success for answer in answers)
    assert [str(error) for error in server.errors] == ["wrench in the works", "refused"]
    server.errors.clear()


def test_a_service_answers_later_and_in_any_order(network):
    server, caller = network.join("server"), network.join("caller")
    replies, heard = [], []

    def callback(request):
        replies.append(Reply())
        return replies[-1]

    server.serve("enable", SET_BOOL, callback)
    client = caller.client("enable", SET_BOOL)
    assert network.until(lambda: client.ready)
    client.send(lambda response: heard.append(("first", response.message)), data=True)
    client.send(lambda response: heard.append(("second", response.message)), data=False)
    assert network.until(lambda: len(replies) == 2)
    network.rest()
    assert heard == []
    replies[1].send(success=True, message="b")
    assert network.until(lambda: len(heard) == 1)
    replies[0].send(success=True, message="a")
    assert network.until(lambda: len(heard) == 2)
    assert heard == [("second", "b"), ("first", "a")]
    with pytest.raises(RosError, match="answered before"):
        replies[0].send()


def test_a_flood_on_a_topic_does_not_keep_a_service_waiting(network):
    if network.backend == "rclpy stub":
        pytest.skip("in which order rclpy calls back, its stand-in does not tell")
    busy, caller = network.join("busy"), network.join("caller")
    flood = busy.publisher("target", POINT)
    answered_at: list = []
    heard: list = []

    def callback(point):
        heard.append(point)
        if len(heard) < 300:
            flood.send()
            flood.send()
            time.sleep(0.002)  # before the next look there is one more

    busy.subscribe("target", POINT, callback)
    busy.serve("stop", TRIGGER, lambda request: answered_at.append(len(heard)) or {})
    client = caller.client("stop", TRIGGER)
    assert network.until(lambda: client.ready and flood.subscribers)
    flood.send()
    client.send(lambda response: None)
    for turn in range(100):
        busy.spin_once(0.001 + 1e-6 * turn)  # as with timers: each wait is another
    assert answered_at


def test_an_answer_after_the_service_has_closed_is_dropped(network):
    server, caller = network.join("server"), network.join("caller")
    reply, asked, heard = Reply(), [], []

    def callback(request):
        asked.append(request)
        return reply

    service = server.serve("enable", SET_BOOL, callback)
    client = caller.client("enable", SET_BOOL)
    assert network.until(lambda: client.ready)
    client.send(heard.append, data=True)
    assert network.until(lambda: bool(asked))
    service.close()
    reply.send(success=True)
    network.rest()
    assert heard == []


def test_a_call_without_a_server_ends_with_a_sentence(network):
    caller = network.join("caller")
    with pytest.raises(TimeoutError, match=r"no server for /enable \(std_srvs/srv/SetBool\) within 0.2 s"):
        caller.call(caller.client("enable", SET_BOOL), 0.2, data=True)


# Timers, time, log


def test_a_timer_keeps_its_period_and_can_be_cancelled(network):
    bus = network.join("node")
    times: list = []
    timer = bus.timer(0.02, lambda: times.append(bus.now()))
    assert network.until(lambda: len(times) == 5)
    assert times[-1] - times[0] >= 3 * 20_000_000  # never early; late is what a loaded machine does
    timer.cancel()
    network.rest(0.1)
    assert len(times) == 5


@pytest.mark.parametrize("period", [0.0, -1.0, float("nan"), float("inf")])
def test_a_timer_without_a_period_is_refused(network, period):
    with pytest.raises(RosError, match="period of a timer"):
        network.join("node").timer(period, lambda: None)


def test_simulated_time_drives_the_clock_and_the_timers(network):
    bus = network.join("node", "--ros-args", "-p", "use_sim_time:=true")
    simulator = network.join("simulator")
    clock = simulator.publisher("/clock", "rosgraph_msgs/msg/Clock")
    ticks: list = []
    bus.timer(1.0, lambda: ticks.append(bus.stamp()))
    assert network.until(lambda: clock.subscribers)
    network.rest(0.1)
    assert (bus.now(), ticks) == (0, [])
    for second in (100, 101):
        clock.send(clock={"sec": second, "nanosec": 5})
        assert network.until(lambda second=second: bus.now() == second * 10**9 + 5)
        network.rest(0.05)
    assert ticks[-1] == {"sec": 101, "nanosec": 5}


def test_the_log_is_heard_on_rosout(network):
    bus, listener = network.join("arm", "--ros-args", "-r", "__ns:=/cell"), network.join("listener")
    heard, subscription = heard_on(listener, "/rosout", "rcl_interfaces/msg/Log", qos=QoS(depth=100))
    assert network.until(lambda: subscription.publishers >= 2)
    bus.log("warn", "joint 3 is out of its limits")
    bus.log("debug", "not at this level")
    assert network.until(lambda: any("joint 3" in line.msg for line in heard))
    line = next(line for line in heard if "joint 3" in line.msg)
    assert (line.level, line.name) == (30, "cell.arm")
    assert not any("not at this level" in line.msg for line in heard)
    with pytest.raises(RosError, match="no log level 'loud'"):
        bus.log("loud", "")


def test_a_callback_that_raises_is_logged_and_the_node_goes_on(network):
    sender, listener = network.join("sender"), network.join("listener")
    heard: list = []

    def callback(point):
        heard.append(point)
        if point.x == 0.0:
            raise RosError("not a target")

    listener.subscribe("target", POINT, callback)
    publisher = sender.publisher("target", POINT)
    assert network.until(lambda: publisher.subscribers)
    publisher.send(x=0.0)
    publisher.send(x=1.0)
    assert network.until(lambda: len(heard) == 2)
    assert [str(error) for error in listener.errors] == ["not a target"]
    listener.errors.clear()


def test_a_node_goes_on_when_nobody_reads_its_log(network, monkeypatch):
    bus, listener = network.join("arm"), network.join("listener")
    heard, subscription = heard_on(listener, "/rosout", "rcl_interfaces/msg/Log", qos=QoS(depth=100))
    assert network.until(lambda: subscription.publishers >= 2)
    read_end, write_end = os.pipe()
    os.close(read_end)
    with monkeypatch.context() as patch, os.fdopen(write_end, "w", buffering=1, errors="backslashreplace") as broken:
        patch.setattr(sys, "stderr", broken)
        bus.log("info", "still here")
        os.dup2(os.open(os.devnull, os.O_WRONLY), write_end)  # so that what is left in the buffer finds its way
    bus.log("info", "a name \udcff that is not UTF-8")
    assert network.until(lambda: any("not UTF-8" in line.msg for line in heard))
    assert any(line.msg == "still here" for line in heard)


# Parameters


def test_a_parameter_takes_its_value_from_the_command_line_and_from_others(network):
    def check(value):
        if value <= 0:
            raise ValueError("rate must be positive")

    node = network.join("arm", "--ros-args", "-p", "rate:=20")
    rate = node.parameter("rate", 50.0, description="samples per second", check=check)
    node.parameter("arm", "mh12", read_only=True)
    assert rate.value == 20.0
    assert isinstance(rate.value, float)
    other = network.join("other")
    events, _ = heard_on(other, "/parameter_events", "rcl_interfaces/msg/ParameterEvent")
    setter = other.client("/arm/set_parameters", "rcl_interfaces/srv/SetParameters")
    getter = other.client("/arm/get_parameters", "rcl_interfaces/srv/GetParameters")
    lister = other.client("/arm/list_parameters", "rcl_interfaces/srv/ListParameters")
    describer = other.client("/arm/describe_parameters", "rcl_interfaces/srv/DescribeParameters")
    assert network.until(lambda: all(c.ready for c in (setter, getter, lister, describer)))
    network.rest(0.1)
    answers: list = []
    setter.send(
        answers.append,
        parameters=[
            {"name": "rate", "value": {"type": 3, "double_value": 100.0}},
            {"name": "rate", "value": {"type": 3, "double_value": -1.0}},
            {"name": "rate", "value": {"type": 4, "string_value": "fast"}},
            {"name": "arm", "value": {"type": 4, "string_value": "ur5e"}},
            {"name": "speed", "value": {"type": 1, "bool_value": True}},
        ],
    )
    assert network.until(lambda: answers)
    assert [result.successful for result in answers[0].results] == [True, False, False, False, False]
    reasons = [result.reason for result in answers[0].results]
    assert reasons[1] == "rate must be positive"
    assert "type float, got 'fast'" in reasons[2]
    assert "read-only" in reasons[3]
    assert "no parameter 'speed'; parameters are: arm, rate, use_sim_time" in reasons[4]
    assert rate.value == 100.0
    assert network.until(lambda: events)
    assert events[0].changed_parameters[0].value.double_value == 100.0
    getter.send(answers.append, names=["rate", "nothing"])
    lister.send(answers.append)
    describer.send(answers.append, names=["rate"])
    assert network.until(lambda: len(answers) == 4)
    by_kind = {type(answer).__name__.partition("__srv__")[2].partition("_")[0]: answer for answer in answers}
    assert [value.type for value in by_kind["GetParameters"].values] == [3, 0]
    assert by_kind["ListParameters"].result.names == ["arm", "rate", "use_sim_time"]
    assert by_kind["DescribeParameters"].descriptors[0].description == "samples per second"


def test_parameters_are_set_all_or_none(network):
    node, other = network.join("arm"), network.join("other")
    first, second = node.parameter("first", 1), node.parameter("second", [1.0, 2.0])
    setter = other.client("/arm/set_parameters_atomically", "rcl_interfaces/srv/SetParametersAtomically")
    assert network.until(lambda: setter.ready)
    answers: list = []
    good = {"name": "first", "value": {"type": 2, "integer_value": 5}}
    setter.send(answers.append, parameters=[good, {"name": "second", "value": {"type": 2, "integer_value": 5}}])
    setter.send(
        answers.append, parameters=[good, {"name": "second", "value": {"type": 8, "double_array_value": [3.0]}}]
    )
    assert network.until(lambda: len(answers) == 2)
    assert [answer.result.successful for answer in answers] == [False, True]
    assert (first.value, second.value) == (5, [3.0])


def test_a_parameter_of_the_wrong_type_is_refused_at_the_start(network):
    node = network.join("arm", "--ros-args", "-p", "rate:=fast")
    with pytest.raises(RosError, match="parameter 'rate' is of type float, got 'fast'"):
        node.parameter("rate", 50.0)
    node.parameter("other", 1)
    with pytest.raises(RosError, match="declared twice"):
        node.parameter("other", 2)


# Life


def test_the_domain_of_a_node_is_its_own(network, monkeypatch):
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    network.join("node")
    assert "ROS_DOMAIN_ID" not in os.environ


def test_a_stopped_bus_ends_its_spin_and_closing_twice_does_no_harm(network):
    bus = network.join("node")
    bus.timer(0.01, bus.stop)
    bus.spin()
    assert not bus.ok
    bus.close()
    bus.close()


def test_what_was_closed_says_and_does_nothing(network):
    one, other = network.join("one"), network.join("other")
    publisher, (heard, subscription) = one.publisher("target", POINT), heard_on(other, "target", POINT)
    service, client = other.serve("home", TRIGGER, lambda request: {}), one.client("home", TRIGGER)
    assert network.until(lambda: publisher.subscribers and subscription.publishers and client.ready)
    for end in (publisher, subscription, client, service, service, client, subscription, publisher):
        end.close()
    answers: list = []
    publisher.send(x=1.0)
    client.send(answers.append)
    network.rest(0.1)
    assert (publisher.subscribers, subscription.publishers, client.ready) == (0, 0, False)
    assert (heard, answers) == ([], [])


def test_a_node_that_has_left_says_and_does_nothing(network):
    one, other = network.join("one"), network.join("other")
    publisher, (_, subscription) = one.publisher("target", POINT), heard_on(one, "target", POINT)
    client, timer = one.client("home", TRIGGER), one.timer(0.01, lambda: None)
    other.serve("home", TRIGGER, lambda request: {})
    assert network.until(lambda: publisher.subscribers and client.ready)
    one.close()
    publisher.send(x=1.0)
    client.send(lambda response: None)
    one.log("info", "not on the network any more")
    assert (publisher.subscribers, subscription.publishers, client.ready) == (0, 0, False)
    for end in (publisher, subscription, client):
        end.close()
    timer.cancel()
    one.stop()
    one.spin()
    for make in (
        lambda: one.publisher("again", POINT),
        lambda: one.subscribe("again", POINT, print),
        lambda: one.serve("again", TRIGGER, print),
        lambda: one.client("again", TRIGGER),
    ):
        with pytest.raises(RosError, match="the node has left the network"):
            make()


@pytest.mark.parametrize("what", ["itself", "its node"])
def test_a_callback_closes_its_own_subscription_or_node(network, what):
    sender, listener = network.join("sender"), network.join("listener")
    heard: list = []

    def callback(point):
        heard.append(point.x)
        (subscription if what == "itself" else listener).close()

    subscription = listener.subscribe("target", POINT, callback)
    publisher = sender.publisher("target", POINT)
    assert network.until(lambda: publisher.subscribers)
    for x in (1.0, 2.0, 3.0):
        publisher.send(x=x)
    assert network.until(lambda: heard)
    network.rest(0.1)
    assert heard == [1.0]


@pytest.mark.parametrize("what", ["itself", "its node"])
def test_a_service_closes_itself_or_its_node(network, what):
    server, caller = network.join("server"), network.join("caller")
    asked: list = []

    def callback(request):
        asked.append(request)
        (service if what == "itself" else server).close()
        return {}

    service, client = server.serve("home", TRIGGER, callback), caller.client("home", TRIGGER)
    assert network.until(lambda: client.ready)
    for _ in range(2):
        client.send(lambda response: None)
    assert network.until(lambda: asked)
    network.rest(0.1)
    assert len(asked) == 1


@pytest.mark.parametrize("what", ["itself", "its node"])
def test_an_answer_closes_its_client_or_node(network, what):
    server, caller = network.join("server"), network.join("caller")
    server.serve("home", TRIGGER, lambda request: {})
    client = caller.client("home", TRIGGER)
    assert network.until(lambda: client.ready)
    answers: list = []

    def callback(response):
        answers.append(response)
        (client if what == "itself" else caller).close()

    for _ in range(2):
        client.send(callback)
    assert network.until(lambda: answers)
    network.rest(0.1)
    assert len(answers) == 1


def test_a_callback_makes_all_that_a_node_can_have(network):
    one, other = network.join("one"), network.join("other")
    heard: list = []

    def callback(point):
        other.subscribe("more", POINT, lambda point: heard.append(point.x))
        other.serve("home", TRIGGER, lambda request: {"message": "at home"})
        timer = other.timer(0.01, lambda: (heard.append("tick"), timer.cancel()))

    other.subscribe("target", POINT, callback)
    publisher, more, client = one.publisher("target", POINT), one.publisher("more", POINT), one.client("home", TRIGGER)
    assert network.until(lambda: publisher.subscribers)
    publisher.send()
    assert network.until(lambda: more.subscribers and client.ready)
    more.send(x=3.0)
    client.send(lambda response: client.send(lambda again: heard.append(again.message)))
    assert network.until(lambda: len(heard) == 3)
    network.rest(0.1)
    assert sorted(map(str, heard)) == ["3.0", "at home", "tick"]


def test_timers_cancel_themselves_and_each_other(network):
    bus = network.join("node")
    called: list = []

    def callback(name):
        called.append(name)
        for timer in timers:
            timer.cancel()

    timers = [bus.timer(0.01, lambda name=name: callback(name)) for name in ("first", "second")]
    network.rest(0.1)
    assert called == ["first"]


def test_an_answer_after_the_node_has_left_is_dropped(network):
    server, caller = network.join("server"), network.join("caller")
    reply, asked, answers = Reply(), [], []
    server.serve("home", TRIGGER, lambda request: asked.append(request) or reply)
    client = caller.client("home", TRIGGER)
    assert network.until(lambda: client.ready)
    client.send(answers.append)
    assert network.until(lambda: asked)
    server.close()
    reply.send(success=True)
    network.rest(0.1)
    assert answers == []


def test_of_more_than_a_thousand_requests_without_an_answer_the_oldest_is_given_up(network):
    if network.backend == "fake":
        pytest.skip("a fake caller keeps nothing of its requests")
    server, caller = network.join("server"), network.join("caller")
    replies, answered = [], []
    server.serve("home", TRIGGER, lambda request: replies.append(Reply()) or replies[-1])
    client = caller.client("home", TRIGGER)
    assert network.until(lambda: client.ready)
    for i in range(1001):
        client.send(lambda response, i=i: answered.append(i))
        if i % 50 == 0:
            assert network.until(lambda i=i: len(replies) == i + 1)
    assert network.until(lambda: len(replies) == 1001)
    replies[0].send()
    replies[1000].send()
    assert network.until(lambda: answered)
    network.rest(0.1)
    assert answered == [1000]


def test_a_bus_is_stopped_from_another_thread(network):
    bus = network.join("node")
    stopping = threading.Thread(target=bus.stop)
    bus.timer(0.01, lambda: None if stopping.ident else stopping.start())
    bus.spin()
    stopping.join()
    assert not bus.ok


def test_a_clock_that_never_comes_is_said_once():
    from pieper.ros.fake import FakeNetwork

    bus = FakeNetwork().bus("arm", ["--ros-args", "-p", "use_sim_time:=true"])
    bus.timer(0.1, lambda: None)
    bus.spin_until(lambda: False, timeout=2.0)
    assert not bus.lines
    bus.spin_until(lambda: False, timeout=5.0)
    (line,) = bus.lines
    assert line.startswith("use_sim_time is true and nothing has come on /clock: time stands still")
