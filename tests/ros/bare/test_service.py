import re

import pytest

from pieper.ros import messages
from pieper.ros.bare import service
from pieper.ros.bare.topic import TopicReader, TopicWriter
from pieper.ros.bare.type_support import describe
from tests.ros.bare.peers import cdr, endpoints, process, until, written

SET_BOOL = "std_srvs/srv/SetBool"

SERVER = """
import sys
from pieper.ros import messages
from pieper.ros.bare import DdsWire

def answer(data, respond):
    request = messages.decode("std_srvs/srv/SetBool_Request", data)
    response = messages.make("std_srvs/srv/SetBool_Response", success=request.data, message="done")
    respond(messages.encode("std_srvs/srv/SetBool_Response", response))

wire = DdsWire("server", domain=int(sys.argv[1]))
wire.open_server("/enable", "std_srvs/srv/SetBool", answer)
while True:
    wire.wait(1.0)
"""


def request(flag):
    return cdr(f"{SET_BOOL}_Request", data=flag)


def response(data):
    return messages.decode(f"{SET_BOOL}_Response", data)


def echo(data, respond):
    """Answer with what was asked."""
    respond(cdr(f"{SET_BOOL}_Response", success=messages.decode(f"{SET_BOOL}_Request", data).data))


def test_a_thousand_calls_of_another_process_one_by_one_and_at_once(join, domain):
    wire, heard = join(), []
    caller = wire.open_caller("/enable", SET_BOOL)
    with process(SERVER, domain):
        assert until(lambda: caller.ready, wire)
        for i in range(1000):
            caller.send(request(i % 2 == 0), heard.append)
            assert until(lambda i=i: len(heard) > i, wire)
        assert [response(data).success for data in heard] == [i % 2 == 0 for i in range(1000)]
        heard.clear()
        for i in range(1000):
            caller.send(request(i % 3 == 0), heard.append)
        assert until(lambda: len(heard) == 1000, wire)
        assert [response(data).success for data in heard] == [i % 3 == 0 for i in range(1000)]
        assert {response(data).message for data in heard} == {"done"}


def test_a_server_that_ends_is_no_longer_ready(join, domain):
    wire = join()
    caller = wire.open_caller("/enable", SET_BOOL)
    assert not caller.ready
    with process(SERVER, domain) as server:
        assert until(lambda: caller.ready, wire)
        server.terminate()
        server.wait()
        other = join("other")
        other.open_server("/enable", SET_BOOL, echo)  # the caller finds another one
        heard = []
        assert until(lambda: caller.ready, wire, other)
        caller.send(request(True), heard.append)
        assert until(lambda: heard, wire, other)


@pytest.mark.parametrize(
    ("name", "type_name", "topic", "dds_name"),
    [
        ("/cell2/enable", SET_BOOL, "cell2/enable", "std_srvs::srv::dds_::SetBool"),
        (
            "/follow/_action/send_goal",
            "control_msgs/action/FollowJointTrajectory_SendGoal",
            "follow/_action/send_goal",
            "control_msgs::action::dds_::FollowJointTrajectory_SendGoal",
        ),
    ],
)
def test_names_on_the_wire_are_those_of_ros(join, domain, name, type_name, topic, dds_name):
    server, caller = join("server"), join("caller")
    server.open_server(name, type_name, echo)
    caller.open_caller(name, type_name)
    found = written(domain)
    assert found[f"rq/{topic}Request"] == f"{dds_name}_Request_"
    assert found[f"rr/{topic}Reply"] == f"{dds_name}_Response_"


def test_both_ends_tell_who_they_are_and_the_hash_of_the_service(join, domain):
    from cyclonedds.qos import Policy

    wire = join()
    wire.open_server("/enable", SET_BOOL, echo)
    wire.open_caller("/enable", SET_BOOL)
    wire.open_caller("/enable", SET_BOOL)
    told = {}
    for what in ("Publication", "Subscription"):
        for found in endpoints(domain, what):
            if found.topic_name in ("rq/enableRequest", "rr/enableReply"):
                text = bytes(found.qos[Policy.Userdata].data).decode()
                assert text.endswith(f";typehash={messages.type_hash(SET_BOOL)};")
                assert re.match(r"(serviceid|clientid)=([0-9a-f]{2}\.){15}[0-9a-f]{2};", text)
                told.setdefault(text, []).append(found.topic_name)
    assert len(told) == 3  # each identity is its own, and is told by a reader and a writer
    assert all(sorted(topics) == ["rq/enableRequest", "rr/enableReply"] for topics in told.values())


def test_the_request_carries_sixteen_bytes_that_come_back(join):
    server, caller = join("server"), join("caller")
    seen = []
    server.open_server("/enable", SET_BOOL, echo)
    end = caller.open_caller("/enable", SET_BOOL)
    for topic, part in (("rq/enableRequest", "Request"), ("rr/enableReply", "Response")):
        kind = describe(f"{SET_BOOL}_{part}", with_header=True)
        spy = TopicReader(topic, kind, service.QUEUE, "", lambda data, writer: seen.append(data))
        server._enter(spy)
    assert until(lambda: end.ready and server.wait(0.001) is None and end.writer.matched == 2, server, caller)
    end.send(request(True), lambda data: None)
    end.send(request(False), lambda data: None)
    assert until(lambda: len(seen) == 4, server, caller)
    identities = {data[4:12] for data in seen}
    assert len(identities) == 1
    numbers = sorted(int.from_bytes(data[12:20], "little") for data in seen)
    assert numbers == [1, 1, 2, 2]
    asked = next(data for data in seen if len(data) == 24 and data[12] == 1)
    assert asked[:4] + asked[20:21] == request(True)[:5]


class Client:
    """A client whose reader of responses is not there yet, as it is while it is being discovered."""

    def __init__(self, wire):
        told = "clientid=01.02;"
        kind = describe(f"{SET_BOOL}_Request", with_header=True)
        self.writer = wire._enter(TopicWriter("rq/enableRequest", kind, service.QUEUE, told))
        self.wire, self.told, self.heard = wire, told, []

    def send(self):
        body = request(True)
        self.writer.write(body[:4] + bytes(range(16)) + body[4:])

    def listen(self):
        kind = describe(f"{SET_BOOL}_Response", with_header=True)
        take = lambda data, writer: self.heard.append(data)  # noqa: E731
        self.wire._enter(TopicReader("rr/enableReply", kind, service.QUEUE, self.told, take))


def test_half_of_one_server_and_half_of_another_are_none(join):
    """As it is while one has died and the next one is being discovered."""
    wire, other = join("caller"), join("servers")
    caller = wire.open_caller("/enable", SET_BOOL)
    asked, answers = (describe(f"{SET_BOOL}_{part}", with_header=True) for part in ("Request", "Response"))
    other._enter(TopicReader("rq/enableRequest", asked, service.QUEUE, "serviceid=01;", lambda data, writer: None))
    other._enter(TopicWriter("rr/enableReply", answers, service.QUEUE, "serviceid=02;"))
    assert until(lambda: caller.writer.matched and caller.reader.matched, wire, other)
    assert not caller.ready
    other._enter(TopicWriter("rr/enableReply", answers, service.QUEUE, "serviceid=01;"))
    assert until(lambda: caller.ready, wire, other)


def test_a_response_waits_until_its_client_can_hear_it(join):
    server, other = join("server"), join("client")
    end = server.open_server("/enable", SET_BOOL, echo)
    client = Client(other)
    assert until(lambda: client.writer.matched, server, other)
    client.send()
    assert until(lambda: end.waiting, server)
    server.wait(0.05)
    assert end.waiting
    client.listen()
    assert until(lambda: client.heard, server, other)
    assert not end.waiting
    assert client.heard[0][4:20] == bytes(range(16))


def test_a_response_does_not_wait_for_ever(join, monkeypatch):
    monkeypatch.setattr(service, "PATIENCE", 0.05)
    server, other = join("server"), join("client")
    end = server.open_server("/enable", SET_BOOL, echo)
    client = Client(other)
    assert until(lambda: client.writer.matched, server, other)
    client.send()
    assert until(lambda: end.waiting, server)
    assert until(lambda: not end.waiting, server)


def test_a_caller_that_left_does_no_harm(join):
    server, first, second = join("server"), join("first"), join("second")
    held = []
    server.open_server("/enable", SET_BOOL, lambda data, respond: held.append((data, respond)))
    gone, stays = first.open_caller("/enable", SET_BOOL), second.open_caller("/enable", SET_BOOL)
    assert until(lambda: gone.ready and stays.ready, server, first, second)
    heard = []
    gone.send(request(True), heard.append)
    stays.send(request(False), heard.append)
    assert until(lambda: len(held) == 2, server, first, second)
    first.close()
    server.wait(0.05)
    for data, respond in held:
        echo(data, respond)
    assert until(lambda: heard, server, second)
    assert [response(data).success for data in heard] == [False]


def test_the_oldest_requests_without_an_answer_are_given_up(join):
    caller = join().open_caller("/enable", SET_BOOL)
    for _ in range(1500):
        caller.send(request(True), lambda data: None)
    assert len(caller._pending) == 1000
    assert next(iter(caller._pending)) == 501
