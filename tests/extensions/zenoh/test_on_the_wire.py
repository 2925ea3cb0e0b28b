"""Messages of the graph, received by a bare Zenoh session, and its reaction to what others put
there."""

from __future__ import annotations

import struct
from typing import Any

import anyio
import anyio.to_thread
import pytest
import zenoh
from zenoh.ext import CacheConfig, HistoryConfig, declare_advanced_publisher, declare_advanced_subscriber

from rwt.extensions.zenoh import ZenohGraph
from rwt.extensions.zenoh.rmw.tokens import gid_of
from rwt_graph import TypeConflict
from rwt_graph.api import Sample
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_participant.errors import ServiceFailed
from rwt_participant.messages import Message
from rwt_participant.qos import LATCHED, Durability, QoS
from tests.waiting import PATIENCE, until
from tests.zenoh_links import session_of

pytestmark = pytest.mark.anyio

STRING = "std_msgs::msg::dds_::String_"
STRING_HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
TRIGGER = "std_srvs::srv::dds_::Trigger_"
TRIGGER_HASH = Registry().service("std_srvs/Trigger").rihs01
GO = f"0/go/{TRIGGER}/{TRIGGER_HASH}"
CHATTER = f"0/chatter/{STRING}/{STRING_HASH}"
#: "hi" in CDR: little-endian, the length with the final zero, the text.
HI = bytes.fromhex("0001000003000000686900")


def tokens(peer: zenoh.Session) -> list[str]:
    """Every liveliness token that is alive, as another program sees it."""
    return sorted(str(reply.ok.key_expr) for reply in peer.liveliness().get("@ros2_lv/**") if reply.ok)


def payload(graph: ZenohGraph, data: str) -> Payload:
    return Payload.from_value(graph.registry.message("std_msgs/String"), {"data": data})


def declare(peer: zenoh.Session, kind: str, name: str, type: str, type_hash: str) -> zenoh.LivelinessToken:
    """A token of another program, whose node is `/them`."""
    what = f"{name.replace('/', '%')}/{type}/{type_hash}/::,10:,:,:,,"
    return peer.liveliness().declare_token(f"@ros2_lv/0/{peer.zid()}/0/1/{kind}/%/%/them/{what}")


def offer(peer: zenoh.Session, type_hash: str = TRIGGER_HASH) -> zenoh.LivelinessToken:
    """A token of the service `/go` of another program."""
    return declare(peer, "SS", "/go", TRIGGER, type_hash)


async def seen(peer: zenoh.Session, *parts: str) -> str:
    """The one token with all of these parts, once it is there."""
    found: list[str] = []

    def look() -> bool:
        found[:] = [key for key in tokens(peer) if all(part in key for part in parts)]
        return bool(found)

    await until(look, f"no token with {parts}")
    (key,) = found
    return key


async def test_the_tokens_of_a_node_and_its_endpoints(graph: ZenohGraph, peer: zenoh.Session) -> None:
    trigger = graph.registry.service("std_srvs/Trigger")
    node = graph.participant("/robot1/talker")
    string = graph.registry.message("std_msgs/String")
    node.advertise("/chatter", string)
    node.subscribe("/robot1/in", lambda _: None, string, LATCHED)
    node.advertise_service("/go", trigger, lambda _: None)
    await seen(peer, "/SS/")
    prefix = f"@ros2_lv/0/{session_of(graph).zid()}/0"
    assert tokens(peer) == [
        f"{prefix}/0/NN/%/%robot1/talker",
        f"{prefix}/1/MP/%/%robot1/talker/%chatter/{STRING}/{STRING_HASH}/::,10:,:,:,,",
        f"{prefix}/2/MS/%/%robot1/talker/%robot1%in/{STRING}/{STRING_HASH}/:1:,1:,:,:,,",
        f"{prefix}/3/SS/%/%robot1/talker/%go/{TRIGGER}/{TRIGGER_HASH}/::,10:,:,:,,",
    ]
    node.close()
    await until(lambda: not tokens(peer))


async def test_the_bytes_of_a_sample(graph: ZenohGraph, peer: zenoh.Session) -> None:
    heard: list[zenoh.Sample] = []
    subscriber = peer.declare_subscriber(CHATTER, heard.append)
    publisher = graph.participant("/talker").advertise("/chatter", graph.registry.message("std_msgs/String"))
    token = await seen(peer, "/MP/")
    before = graph.clock.time_ns()
    while not heard:
        publisher.publish(payload(graph, "hi"))
        await anyio.sleep(0.005)
    publisher.publish(payload(graph, "hi"))
    await until(lambda: len(heard) >= 2)
    first, second = heard[:2]
    assert first.payload.to_bytes() == HI
    attachments = [sample.attachment.to_bytes() for sample in (first, second) if sample.attachment]
    numbers, stamps, sizes, gids = zip(*(struct.unpack("<qqB16s", each) for each in attachments), strict=True)
    assert numbers == (1, 2)
    assert before <= stamps[0] <= stamps[1] <= graph.clock.time_ns()
    assert sizes == (16, 16)
    assert set(gids) == {gid_of(token)}
    del subscriber


async def test_nobody_elsewhere_no_encoding(
    graph: ZenohGraph, peer: zenoh.Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    publisher = graph.participant("/talker").advertise("/chatter", graph.registry.message("std_msgs/String"))
    await seen(peer, "/MP/")

    def cdr(_self: Payload) -> bytes:
        raise AssertionError("a message was encoded that nobody takes")

    monkeypatch.setattr(Payload, "cdr", cdr)
    publisher.publish(payload(graph, "hi"))


async def test_samples_of_others_are_passed_on_undecoded(graph: ZenohGraph, peer: zenoh.Session) -> None:
    heard: list[Sample] = []
    string = graph.registry.message("std_msgs/String")
    graph.participant("/ear").subscribe("/chatter", heard.append, string)
    await seen(peer, "/MS/")
    stamp, gid = 1_700_000_000_000_000_000, bytes(range(16))
    peer.put(CHATTER, HI, attachment=struct.pack("<qqB16s", 1, stamp, 16, gid))
    peer.put(CHATTER, HI)
    peer.put(CHATTER, HI, attachment=b"{a map of before 2025}")
    peer.put(CHATTER, b"no CDR at all")
    await until(lambda: len(heard) == 4)
    assert (heard[0].topic, heard[0].stamp_ns, heard[0].node) == ("/chatter", stamp, "")
    assert [sample.payload.cdr() for sample in heard] == [HI, HI, HI, b"no CDR at all"]
    message: Message = heard[0].payload.value()
    assert message.data == "hi"
    with pytest.raises(ValueError, match=r"CDR"):
        heard[3].payload.value()


async def test_a_latched_publisher_is_an_advanced_one(graph: ZenohGraph, peer: zenoh.Session) -> None:
    """Its cache has what was published, before it was joined too, and only the depth of it."""
    qos = QoS(depth=2, durability=Durability.TRANSIENT_LOCAL)
    publisher = graph.participant("/a").advertise("/chatter", graph.registry.message("std_msgs/String"), qos)
    for word in ("1", "2", "3"):
        publisher.publish(payload(graph, word))
    await seen(peer, "/MP/")
    heard: list[bytes] = []
    subscriber = declare_advanced_subscriber(
        peer,
        CHATTER,
        lambda sample: heard.append(sample.payload.to_bytes()[8:9]),
        history=HistoryConfig(detect_late_publishers=True, max_samples=10),
        subscriber_detection=True,
    )
    await until(lambda: len(heard) == 2)
    publisher.publish(payload(graph, "4"))
    await until(lambda: len(heard) == 3)
    assert heard == [b"2", b"3", b"4"]
    del subscriber


async def test_a_late_subscriber_is_given_what_an_advanced_publisher_kept(
    graph: ZenohGraph, peer: zenoh.Session
) -> None:
    token = f"@ros2_lv/0/{peer.zid()}/0/1/MP/%/%/them/%chatter/{STRING}/{STRING_HASH}/:1:,1:,:,:,,"
    alive = peer.liveliness().declare_token(token)
    publisher = declare_advanced_publisher(peer, CHATTER, cache=CacheConfig(1), publisher_detection=True)
    attached = [struct.pack("<qqB16s", number, 5, 16, gid_of(token)) for number in (1, 2)]
    publisher.put(HI, attachment=attached[0])
    await until(lambda: graph.topic("/chatter") is not None)
    first: list[Sample] = []
    second: list[Sample] = []
    volatile: list[Sample] = []
    node = graph.participant("/ear")
    subscription = node.subscribe("/chatter", first.append)
    node.subscribe("/chatter", volatile.append, None, QoS())
    await until(lambda: len(first) == 1)
    node.subscribe("/chatter", second.append)
    assert [(sample.node, sample.stamp_ns) for sample in first + second] == [("/them", 5), ("/them", 5)]
    assert list(subscription.history()) == first
    publisher.put(HI, attachment=attached[1])
    await until(lambda: len(first) == len(second) == 2 and len(volatile) == 1)
    alive.undeclare()
    await until(lambda: subscription.history() == ())


async def test_a_service_is_a_complete_queryable(graph: ZenohGraph, peer: zenoh.Session) -> None:
    trigger = graph.registry.service("std_srvs/Trigger")
    response = Payload.from_value(trigger.response, {"success": True, "message": "hi"})
    node = graph.participant("/p")
    node.advertise_service("/go", trigger, lambda call: call.reply(response))
    await seen(peer, "/SS/")
    gid = bytes(range(16))
    request = struct.pack("<qqB16s", 9, 1, 16, gid)
    replies = await ask(peer, GO, bytes.fromhex("0001000000"), request)
    (reply,) = replies
    assert reply.ok is not None
    assert reply.ok.payload.to_bytes() == bytes.fromhex("000100000100000003000000686900")
    assert reply.ok.attachment is not None
    number, stamp, size, echoed = struct.unpack("<qqB16s", reply.ok.attachment.to_bytes())
    assert (number, size, echoed) == (9, 16, gid)
    assert stamp > 1


@pytest.mark.parametrize(
    ("body", "attached"), [(b"", 33), (b"\x00\x01\x00", 33), (bytes.fromhex("0001000000"), 0)]
)
async def test_a_request_that_is_none_is_refused(
    graph: ZenohGraph, peer: zenoh.Session, body: bytes, attached: int
) -> None:
    trigger = graph.registry.service("std_srvs/Trigger")
    graph.participant("/p").advertise_service("/go", trigger, lambda _: None)
    await seen(peer, "/SS/")
    (reply,) = await ask(peer, GO, body, struct.pack("<qqB16s", 1, 1, 16, bytes(16))[:attached])
    assert reply.err is not None
    assert reply.err.payload.to_bytes() == b"the request to /go is not a std_srvs/srv/Trigger_Request"


async def ask(peer: zenoh.Session, key: str, body: bytes, attached: bytes) -> list[zenoh.Reply]:
    """Ask as rmw_zenoh does, and wait for all answers."""
    target = zenoh.QueryTarget.ALL_COMPLETE
    answers = peer.get(key, target=target, payload=body, attachment=attached, timeout=PATIENCE)
    return await anyio.to_thread.run_sync(list, answers)


async def test_a_call_is_a_query_to_all(graph: ZenohGraph, peer: zenoh.Session) -> None:
    """And an error reply of a program that is not this project's is the provider's failure."""
    asked: list[Any] = []

    def serve(query: zenoh.Query) -> None:
        assert query.attachment is not None
        assert query.payload is not None
        asked.append((query.payload.to_bytes(), struct.unpack("<qqB16s", query.attachment.to_bytes())))
        query.reply_err(b"not today")
        query.drop()

    queryable = peer.declare_queryable(GO, serve, complete=True)
    alive = offer(peer)
    await until(lambda: graph.service("/go") is not None)
    node = graph.node("caller")
    for _ in range(2):
        with pytest.raises(ServiceFailed, match=r"^not today$"):
            await node.call("/go", timeout=PATIENCE)
    client = await seen(peer, "/SC/", "/caller/", "%go")
    assert [body for body, _ in asked] == [bytes.fromhex("0001000000")] * 2
    assert [(number, size, gid) for _, (number, _, size, gid) in asked] == [
        (1, 16, gid_of(client)),
        (2, 16, gid_of(client)),
    ]
    alive.undeclare()
    del queryable


async def test_a_request_waits_for_a_provider_that_is_known_but_not_there_yet(
    graph: ZenohGraph, peer: zenoh.Session
) -> None:
    trigger = graph.registry.service("std_srvs/Trigger")
    alive = offer(peer)
    await until(lambda: graph.service("/go") is not None)
    answers: list[object] = []
    node, request = graph.participant("/caller"), Payload.from_value(trigger.request, {})
    cancelled = node.call_service("/go", request, answers.append)
    node.call_service("/go", request, answers.append)
    cancelled.cancel()
    asked: list[int] = []

    def serve(query: zenoh.Query) -> None:
        assert query.attachment is not None
        asked.append(struct.unpack("<q", query.attachment.to_bytes()[:8])[0])
        query.reply(GO, bytes.fromhex("00010000010000000100000000"))
        query.drop()

    queryable = peer.declare_queryable(GO, serve, complete=True)
    await until(lambda: bool(answers))
    (answer,) = answers
    assert isinstance(answer, Payload)
    assert asked == [1]
    alive.undeclare()
    del queryable


async def test_a_request_to_a_provider_that_never_comes_ends_with_it(
    graph: ZenohGraph, peer: zenoh.Session
) -> None:
    trigger = graph.registry.service("std_srvs/Trigger")
    alive = offer(peer)
    await until(lambda: graph.service("/go") is not None)
    answers: list[object] = []
    request = Payload.from_value(trigger.request, {})
    graph.participant("/caller").call_service("/go", request, answers.append)
    alive.undeclare()
    await until(lambda: [str(answer) for answer in answers] == ["Service /go was unadvertised"])


async def test_an_action_is_three_services_and_two_topics(graph: ZenohGraph, peer: zenoh.Session) -> None:
    """With the type hashes that ROS 2's own packages carry."""
    fibonacci = graph.registry.action("example_interfaces/Fibonacci")
    graph.participant("/p").advertise_action("/fib", fibonacci, lambda goal: goal.accept())
    await seen(peer, "/SS/", "send_goal")
    found = {tuple(key.split("/")[i] for i in (5, 9, 10, 11)) for key in tokens(peer) if "_action%" in key}
    package = "example_interfaces::action::dds_::Fibonacci"
    assert found == {
        ("SS", "%fib%_action%send_goal", f"{package}_SendGoal_", SEND_GOAL),
        ("SS", "%fib%_action%get_result", f"{package}_GetResult_", GET_RESULT),
        ("SS", "%fib%_action%cancel_goal", "action_msgs::srv::dds_::CancelGoal_", CANCEL_GOAL),
        ("MP", "%fib%_action%feedback", f"{package}_FeedbackMessage_", FEEDBACK),
        ("MP", "%fib%_action%status", "action_msgs::msg::dds_::GoalStatusArray_", STATUS),
        ("MP", "%fib%_action%reasons", STRING, STRING_HASH),
    }


SEND_GOAL = "RIHS01_d1a57fb2a4afe8c21e34fb10db206f16ce6729b28531141472df92277c55b557"
GET_RESULT = "RIHS01_1b0de0d5d29dc955d92f546706568428632771db13ec84c15ec1c1a59f424a57"
FEEDBACK = "RIHS01_c1de71afd52e49a89c53d8262366884185bc0a02f78ce051c4e46b0a7fe59bb2"
CANCEL_GOAL = "RIHS01_573d8b0a534451d7bc2ac8c5ffde8ac14b8593b7001175d0cd6516dcbeb8689a"
STATUS = "RIHS01_6c1684b00f177d37438febe6e709fc4e2b0d4248dca4854946f9ed8b30cda83e"


async def test_types_that_are_not_known_or_defined_otherwise(
    graph: ZenohGraph, peer: zenoh.Session, caplog: pytest.LogCaptureFixture
) -> None:
    """List them, exchange no messages, and log it once."""
    alive = [
        declare(peer, "MP", "/unknown", "my_msgs::msg::dds_::Odd_", "RIHS01_0"),
        declare(peer, "MS", "/unknown", "my_msgs::msg::dds_::Odd_", "RIHS01_0"),
        declare(peer, "MP", "/newer", STRING, "RIHS01_1"),
        declare(peer, "SS", "/odd", "my_msgs::srv::dds_::Odd_", "RIHS01_2"),
        declare(peer, "MP", "/humble", STRING, "TypeHashNotSupported"),
        declare(peer, "MP", "/strange", "no type", "RIHS01_3"),
    ]
    await until(lambda: graph.topic("/strange") is not None)
    for name, type in (
        ("/unknown", "my_msgs/msg/Odd"),
        ("/newer", "std_msgs/msg/String"),
        ("/humble", "std_msgs/msg/String"),
        ("/strange", "no type"),
    ):
        info = graph.topic(name)
        assert info is not None
        assert info.type is None
        assert [end.type for end in info.publishers] == [type]
    assert graph.service("/odd") is None
    warnings = [record.getMessage() for record in caplog.records if record.levelname == "WARNING"]
    assert sorted(warning.partition(" of ")[0] for warning in warnings) == ["/humble", "/newer", "/unknown"]
    del alive


async def test_a_service_of_another_definition_is_not_called(graph: ZenohGraph, peer: zenoh.Session) -> None:
    alive = offer(peer, "RIHS01_1")
    await until(lambda: graph.service("/go") is not None)
    with pytest.raises(Exception, match="Service /go defines std_srvs/srv/Trigger otherwise"):
        await graph.node("caller").call("/go")
    alive.undeclare()


async def test_a_type_that_only_subscribers_elsewhere_have(graph: ZenohGraph, peer: zenoh.Session) -> None:
    """Refuses another, is listed, and is not taken over: its holder may have it from us."""
    alive = declare(peer, "MS", "/chatter", STRING, STRING_HASH)
    await until(lambda: graph.topic("/chatter") is not None)
    node = graph.participant("/n")
    with pytest.raises(TypeConflict, match="already established with type std_msgs/msg/String"):
        node.advertise("/chatter", graph.registry.message("std_msgs/Int32"))
    subscription = node.subscribe("/chatter", lambda _: None)
    assert subscription.type is None
    info = graph.topic("/chatter")
    assert info is not None
    assert info.type is graph.registry.message("std_msgs/String")
    alive.undeclare()
    await until(lambda: (info := graph.topic("/chatter")) is not None and info.type is None)


async def test_tokens_that_are_none_are_left_out(graph: ZenohGraph, peer: zenoh.Session) -> None:
    alive = [
        peer.liveliness().declare_token(f"@ros2_lv/0/z/0/{rest}")
        for rest in (
            "0/NN/%/%/bad name",
            "0/XX/%/%/n",
            "0/NN/%",
            f"1/MP/%/%/n/%bad-name/{STRING}/{STRING_HASH}/::,10:,:,:,,",
            f"1/MP/%/%/n/%a/{STRING}/{STRING_HASH}/junk",
            "0/NN/%/%/good",
        )
    ]
    await until(lambda: bool(graph.nodes()))
    assert [node.name for node in graph.nodes()] == ["/good"]
    assert [topic.name for topic in graph.topics()] == ["/rosout"]
    del alive


async def test_another_domain_is_another_graph(graph: ZenohGraph, peer: zenoh.Session) -> None:
    alive = [
        peer.liveliness().declare_token("@ros2_lv/1/z/0/0/NN/%/%/far"),
        peer.liveliness().declare_token("@ros2_lv/0/z/0/0/NN/%/%/near"),
    ]
    await until(lambda: bool(graph.nodes()))
    assert [node.name for node in graph.nodes()] == ["/near"]
    del alive
