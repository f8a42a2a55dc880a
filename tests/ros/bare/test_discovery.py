import struct
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, bounded_str, sequence, uint8
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from pieper.ros import messages
from pieper.ros.qos import DEFAULT, LATCHED
from tests.ros.bare.peers import cdr, endpoints, until

STRING = "std_msgs/msg/String"


@dataclass
class Gid(IdlStruct, typename="rmw_dds_common::msg::dds_::Gid_"):
    data: array[uint8, 16]


@dataclass
class NodeEntitiesInfo(IdlStruct, typename="rmw_dds_common::msg::dds_::NodeEntitiesInfo_"):
    node_namespace: bounded_str[256]
    node_name: bounded_str[256]
    reader_gid_seq: sequence[Gid]
    writer_gid_seq: sequence[Gid]


@dataclass
class ParticipantEntitiesInfo(IdlStruct, typename="rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_"):
    gid: Gid
    node_entities_info_seq: sequence[NodeEntitiesInfo]


def graph_of(domain):
    """Read ``ros_discovery_info`` with nothing but cyclonedds, as a late subscriber; the newest of each participant."""
    qos = Qos(
        Policy.Reliability.Reliable(0),
        Policy.Durability.TransientLocal,
        Policy.History.KeepLast(100),
        Policy.DataRepresentation(use_cdrv0_representation=True),
    )
    participant = DomainParticipant(domain)
    reader = DataReader(participant, Topic(participant, "ros_discovery_info", ParticipantEntitiesInfo), qos)
    found = {}

    def read():
        for sample in reader.take(100):
            found[bytes(sample.gid.data)] = sample.node_entities_info_seq
        return found

    return read


def test_the_graph_shows_node_and_endpoints(join, domain):
    wire = join("inverse", "/cell2")
    wire.open_writer("/a", STRING, DEFAULT)
    closed = wire.open_writer("/b", STRING, DEFAULT)
    wire.open_reader("/c", STRING, DEFAULT, lambda data: None)
    wire.open_server("/d", "std_srvs/srv/SetBool", lambda data, respond: None)
    wire.open_caller("/e", "std_srvs/srv/SetBool")
    closed.close()
    other = join("forward")
    read = graph_of(domain)
    assert until(lambda: len(read()) == 2, wire, other)
    by_name = {nodes[0].node_name: (gid, nodes[0]) for gid, nodes in read().items()}
    gid, node = by_name["inverse"]
    assert (node.node_name, node.node_namespace) == ("inverse", "/cell2")
    assert by_name["forward"][1].node_namespace == "/"
    for what, listed, topics in (
        ("Publication", node.writer_gid_seq, {"rt/a", "rr/dReply", "rq/eRequest"}),
        ("Subscription", node.reader_gid_seq, {"rt/c", "rq/dRequest", "rr/eReply"}),
    ):
        there = {found.key.bytes: found for found in endpoints(domain, what)}
        assert {there[bytes(one.data)].topic_name for one in listed} == topics
        assert {there[bytes(one.data)].participant_key.bytes for one in listed} == {gid}


def test_a_closed_node_leaves_the_graph_of_dds(join, domain):
    wire, stays = join("inverse"), join("stays")
    wire.open_writer("/a", STRING, DEFAULT)
    wire.close()
    assert until(lambda: not any(f.topic_name == "rt/a" for f in endpoints(domain, "Publication")), stays)


def test_endpoints_tell_the_hash_of_their_type_and_participants_their_enclave(join, domain):
    from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsParticipant

    wire = join()
    wire.open_writer("/a", STRING, DEFAULT)
    wire.open_reader("/a", STRING, DEFAULT, lambda data: None)
    own = f"typehash={messages.type_hash(STRING)};".encode()
    info = f"typehash={messages.type_hash('rmw_dds_common/msg/ParticipantEntitiesInfo')};".encode()
    for what, expected in (("Publication", {own, info}), ("Subscription", {own})):
        found = endpoints(domain, what)
        assert {bytes(f.qos[Policy.Userdata].data) for f in found if Policy.Userdata in f.qos} == expected
    plain = DomainParticipant(domain)
    told = [f.qos[Policy.Userdata] for f in BuiltinDataReader(plain, BuiltinTopicDcpsParticipant).take(10)]
    assert b"enclave=/;" in [bytes(policy.data) for policy in told if policy]


def test_the_bytes_of_the_graph(join, domain):
    """As rmw_dds_common defines them, read by hand."""
    heard = []
    wire = join("arm", "/cell")
    spy = join("spy")
    from pieper.ros.bare.discovery import TYPE
    from pieper.ros.bare.topic import TopicReader
    from pieper.ros.bare.type_support import describe

    spy._enter(TopicReader("ros_discovery_info", describe(TYPE), LATCHED, "", lambda data, w: heard.append(data)))
    writer = wire.open_writer("/a", STRING, DEFAULT)

    def newest():
        return [data for data in heard if b"arm\0" in data and writer.writer_guids[0] in data]

    assert until(newest, wire, spy)
    data = newest()[-1][4:]
    count, length = struct.unpack_from("<2I", data, 16)
    assert (count, length, data[24:30]) == (1, 6, b"/cell\0")
    assert struct.unpack_from("<I", data, 32) == (4,)
    assert data[36:40] == b"arm\0"
    assert struct.unpack_from("<I", data, 40) == (0,)  # readers
    assert struct.unpack_from("<I", data, 44) == (1,)  # writers
    assert data[48:64] == writer.writer_guids[0]
    assert data[:12] == data[48:60]  # a writer's GUID begins as its participant's


def test_after_a_rebuild_everything_is_there_again(join):
    """The handles are the same, the participant is new, and what was latched is latched again."""
    wire, other, heard, answers = join("arm"), join("other"), [], []
    writer = wire.open_writer("/description", STRING, LATCHED)
    writer.write(cdr(STRING, data="<robot/>"))
    reader = wire.open_reader("/target", STRING, DEFAULT, heard.append)
    wire.open_server(
        "/enable", "std_srvs/srv/SetBool", lambda data, respond: respond(cdr("std_srvs/srv/SetBool_Response"))
    )
    before = [*writer.writer_guids, *reader.reader_guids]
    wire.rebuild()
    assert not set(before) & {*writer.writer_guids, *reader.reader_guids}
    late = []
    other.open_reader("/description", STRING, LATCHED, late.append)
    sender = other.open_writer("/target", STRING, DEFAULT)
    caller = other.open_caller("/enable", "std_srvs/srv/SetBool")
    assert until(lambda: late and caller.ready and sender.matched == reader.matched == 1, wire, other)
    assert [messages.decode(STRING, data).data for data in late] == ["<robot/>"]
    sender.write(cdr(STRING, data="go"))
    caller.send(cdr("std_srvs/srv/SetBool_Request"), answers.append)
    assert until(lambda: heard and answers, wire, other)
    reader.close()
    assert until(lambda: sender.matched == 0, wire, other)
