"""advertise, publish, subscribe: what reaches whom."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import pytest

from rwt.rosbridge.bridge import Bridge
from rwt_graph.clock import SimulatedClock
from rwt_graph.memory.graph import MemoryGraph
from rwt_graph.nodes.node import Node
from tests.core.rosbridge.recording_client import Client

TWIST = {
    "linear": {"x": 1.5, "y": 0.0, "z": 0.0},
    "angular": {"x": 0.0, "y": 0.0, "z": -0.25},
}


def test_a_published_message_reaches_every_subscriber_the_sender_included(
    client: Client, other: Client
) -> None:
    for each in (client, other):
        each.say("subscribe", topic="/cmd_vel", type="geometry_msgs/Twist")
    client.say("advertise", topic="/cmd_vel", type="geometry_msgs/msg/Twist")
    client.say("publish", topic="/cmd_vel", msg=TWIST)
    expected = [{"op": "publish", "topic": "/cmd_vel", "msg": TWIST}]
    assert client.heard() == expected
    assert other.heard() == expected


def test_the_payload_goes_through_as_it_came(client: Client) -> None:
    client.say("subscribe", topic="/chatter", type="std_msgs/String")
    client.say_raw(
        '{"op":"publish","topic":"/chatter","msg":{"data":"\\u00e9 \\/ é"},"type":"std_msgs/String"}'
    )
    (frame, _) = client.frames[0]
    assert frame.data == '{"op":"publish","topic":"/chatter","msg":{"data":"\\u00e9 \\/ é"}}'.encode()


def test_one_frame_object_goes_to_all(client: Client, connect: Callable[[], Client]) -> None:
    listeners = [connect() for _ in range(5)]
    for listener in listeners:
        listener.say("subscribe", topic="/chatter", type="std_msgs/String")
    client.say("publish", topic="/chatter", type="std_msgs/String", msg={"data": "x"})
    frames = [listener.frames[0][0] for listener in listeners]
    assert all(frame is frames[0] for frame in frames)


def test_each_client_hears_the_name_it_asked_for(client: Client, other: Client) -> None:
    client.say("subscribe", topic="chatter", type="std_msgs/String")
    other.say("subscribe", topic="/chatter", type="std_msgs/String")
    client.say("publish", topic="chatter", msg={"data": "x"})
    assert client.heard() == [{"op": "publish", "topic": "chatter", "msg": {"data": "x"}}]
    assert other.heard() == [{"op": "publish", "topic": "/chatter", "msg": {"data": "x"}}]


def test_two_subscriptions_of_one_client_are_one_delivery(client: Client) -> None:
    client.say("subscribe", id="a", topic="/chatter", type="std_msgs/String")
    client.say("subscribe", id="b", topic="/chatter")
    client.say("publish", topic="/chatter", msg={"data": "x"})
    assert client.heard_of("/chatter") == [{"data": "x"}]
    client.say("unsubscribe", id="a", topic="/chatter")
    client.say("publish", topic="/chatter", msg={"data": "y"})
    assert client.heard_of("/chatter") == [{"data": "y"}]
    client.say("unsubscribe", topic="/chatter")
    client.say("publish", topic="/chatter", type="std_msgs/String", msg={"data": "z"})
    assert client.heard_of("/chatter") == []


def test_missing_fields_default_and_the_header_is_stamped(client: Client) -> None:
    client.say("subscribe", topic="/p", type="geometry_msgs/PoseStamped")
    client.say("publish", topic="/p", type="geometry_msgs/PoseStamped", msg={"header": {"frame_id": "map"}})
    (message,) = client.heard_of("/p")
    assert message["header"] == {"stamp": {"sec": 1_700_000_000, "nanosec": 0}, "frame_id": "map"}
    assert message["pose"]["orientation"] == {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        ({"linear": {"x": "fast"}}, 'publish.msg.linear.x: expected float64, got "fast"'),
        ([], "publish.msg: "),
        ({"linear": {"bogus": 1}}, 'publish.msg.linear: geometry_msgs/Vector3 has no field "bogus"'),
        (None, "publish.msg: "),
    ],
)
def test_a_message_that_does_not_fit_is_refused_whole(
    client: Client, other: Client, message: object, reason: str
) -> None:
    client.say("set_level", level="error")
    other.say("subscribe", topic="/cmd_vel", type="geometry_msgs/Twist")
    client.say("publish", id="p1", topic="/cmd_vel", type="geometry_msgs/Twist", msg=message)
    (status,) = client.heard()
    assert status["op"] == "status"
    assert status["level"] == "error"
    assert status["id"] == "p1"
    assert reason in status["msg"]
    assert other.heard() == []
    client.say("publish", topic="/cmd_vel", msg=TWIST)
    assert other.heard_of("/cmd_vel") == [TWIST]


def test_no_status_before_set_level(client: Client) -> None:
    client.say("publish", topic="/nowhere", msg={})
    client.say("nonsense")
    client.say_raw("hello")
    assert client.heard() == []


def test_publish_to_an_unknown_topic_needs_a_type(client: Client) -> None:
    client.say("set_level", level="error")
    client.say("publish", topic="/nowhere", msg={"data": "x"})
    (status,) = client.heard()
    assert "cannot infer the type of /nowhere" in status["msg"]


def test_subscribe_to_an_unknown_topic_needs_a_type(client: Client) -> None:
    client.say("set_level", level="error")
    client.say("subscribe", topic="/nowhere")
    (status,) = client.heard()
    assert "cannot infer the type of /nowhere" in status["msg"]


@pytest.mark.parametrize("op", ["advertise", "subscribe"])
def test_another_type_is_refused(client: Client, other: Client, op: str) -> None:
    other.say("advertise", topic="/t", type="std_msgs/String")
    client.say("set_level", level="error")
    client.say(op, topic="/t", type="std_msgs/Int32")
    (status,) = client.heard()
    assert "/t" in status["msg"]
    assert "std_msgs/String" in status["msg"].replace("/msg/", "/")


@pytest.mark.parametrize("op", ["advertise", "subscribe"])
def test_an_unknown_type_is_refused(client: Client, op: str) -> None:
    client.say("set_level", level="error")
    client.say(op, topic="/t", type="std_msgs/Sting")
    (status,) = client.heard()
    assert "std_msgs/String" in status["msg"]


def test_a_latched_message_reaches_who_comes_late(client: Client, connect: Callable[[], Client]) -> None:
    client.say("advertise", topic="/map_name", type="std_msgs/String", latch=True)
    for name in ("old", "new"):
        client.say("publish", topic="/map_name", msg={"data": name})
    for _ in range(3):
        late = connect()
        late.say("subscribe", topic="/map_name")
        assert late.heard_of("/map_name") == [{"data": "new"}]
    late.say("subscribe", id="second", topic="/map_name")
    assert late.heard_of("/map_name") == [{"data": "new"}]
    client.say("publish", topic="/map_name", msg={"data": "newest"})
    assert late.heard_of("/map_name") == [{"data": "newest"}]


def test_every_publisher_s_latched_message_reaches_who_comes_late(graph: MemoryGraph, client: Client) -> None:
    for frame in ("camera", "laser"):
        publisher = Node(graph, frame).advertise("/tf_static", "tf2_msgs/TFMessage", latch=True)
        for name in ("old", frame):
            publisher.publish({"transforms": [{"child_frame_id": name}]})
    for number in ("first", "second"):
        client.say("subscribe", topic="/tf_static", id=number)
        told = client.heard_of("/tf_static")
        assert [msg["transforms"][0]["child_frame_id"] for msg in told] == ["camera", "laser"]


def test_an_unlatched_message_is_not_kept(clock: SimulatedClock, client: Client, other: Client) -> None:
    client.say("advertise", topic="/t", type="std_msgs/String")
    clock.advance(1.0)
    client.say("publish", topic="/t", msg={"data": "x"})
    other.say("subscribe", topic="/t")
    assert other.heard() == []


def test_the_first_second_of_a_publisher_is_kept_for_who_comes_within_it(
    clock: SimulatedClock, client: Client, other: Client
) -> None:
    client.say("advertise", topic="/t", type="std_msgs/String")
    for text in ("a", "b"):
        client.say("publish", topic="/t", msg={"data": text})
    clock.advance(0.9)
    other.say("subscribe", topic="/t")
    assert other.heard_of("/t") == [{"data": "a"}, {"data": "b"}]
    other.say("subscribe", topic="/t", id="again")
    assert other.heard_of("/t") == [], "a client is given them once"
    clock.advance(0.2)
    client.say("subscribe", topic="/t")
    assert client.heard_of("/t") == []


def test_what_a_client_published_early_goes_with_it(client: Client, other: Client) -> None:
    client.say("publish", topic="/t", type="std_msgs/String", msg={"data": "x"})
    client.leave()
    other.say("subscribe", topic="/t")
    assert other.heard() == []


def test_of_many_or_large_early_messages_the_newest_are_kept(
    bridge: Bridge, client: Client, other: Client
) -> None:
    client.say("advertise", topic="/many", type="std_msgs/Int32")
    for number in range(150):
        client.say("publish", topic="/many", msg={"data": number})
    other.say("subscribe", topic="/many")
    assert other.heard_of("/many") == [{"data": number} for number in range(50, 150)]
    client.say("advertise", topic="/large", type="std_msgs/String")
    for letter in "abc":
        client.say("publish", topic="/large", msg={"data": letter * 25_000})
    other.say("subscribe", topic="/large")
    assert [message["data"][0] for message in other.heard_of("/large")] == ["b", "c"]
    client.say("publish", topic="/large", msg={"data": "d" * 70_000})
    late = Client(bridge)
    late.say("subscribe", topic="/large")
    assert late.heard() == []


def test_a_subscriber_that_wants_nothing_old_is_given_nothing_early(client: Client, other: Client) -> None:
    client.say("advertise", topic="/t", type="std_msgs/String")
    client.say("publish", topic="/t", msg={"data": "x"})
    other.say("subscribe", topic="/t", qos={"durability": "volatile"})
    assert other.heard() == []


@pytest.mark.parametrize(
    ("msg", "missing"),
    [
        ({"pose": {"position": {"x": 1, "y": 2}}}, "pose.position.z, pose.orientation"),
        ({}, "pose"),
        ({"header": {}, "pose": {}}, "pose.position, pose.orientation"),
    ],
)
def test_who_hears_warnings_hears_which_fields_took_their_defaults(
    client: Client, other: Client, msg: Mapping[str, object], missing: str
) -> None:
    other.say("subscribe", topic="/p", type="geometry_msgs/PoseStamped")
    client.say("set_level", level="warning")
    client.say("advertise", topic="/p", type="geometry_msgs/PoseStamped")
    client.say("publish", topic="/p", msg=msg, id="p1")
    text = f"publish.msg: defaults were taken for what is missing: {missing}"
    assert client.heard() == [{"op": "status", "level": "warning", "msg": text, "id": "p1"}]
    assert len(other.heard_of("/p")) == 1


def test_a_whole_message_is_nothing_to_be_warned_of(client: Client) -> None:
    client.say("set_level", level="warning")
    client.say("advertise", topic="/p", type="geometry_msgs/PointStamped")
    client.say("publish", topic="/p", msg={"point": {"x": 1, "y": 2, "z": 3}})
    assert client.heard() == []


def test_a_topic_outlives_its_last_publisher_by_ten_seconds(
    graph: MemoryGraph, clock: SimulatedClock, client: Client, other: Client
) -> None:
    client.say("advertise", topic="/t", type="std_msgs/String", latch=True)
    client.say("publish", topic="/t", msg={"data": "x"})
    client.leave()
    clock.advance(9.9)
    other.say("subscribe", topic="/t")
    assert other.heard_of("/t") == [{"data": "x"}]
    other.say("unsubscribe", topic="/t")
    clock.advance(0.2)
    assert graph.topic("/t") is None


def test_unadvertise_by_id_leaves_the_others(
    graph: MemoryGraph, clock: SimulatedClock, client: Client
) -> None:
    client.say("advertise", id="a", topic="/t", type="std_msgs/String")
    client.say("advertise", id="b", topic="/t", type="std_msgs/String")
    client.say("unadvertise", id="a", topic="/t")
    client.say("unadvertise", id="never", topic="/t")
    clock.advance(20)
    assert graph.topic("/t") is not None
    client.say("unadvertise", topic="/t")
    clock.advance(20)
    assert graph.topic("/t") is None


def test_what_was_only_published_stays_until_disconnect(
    graph: MemoryGraph, clock: SimulatedClock, client: Client
) -> None:
    client.say("publish", topic="/t", type="std_msgs/String", msg={})
    client.say("unadvertise", topic="/t")
    clock.advance(20)
    assert graph.topic("/t") is not None
    client.leave()
    clock.advance(20)
    assert graph.topic("/t") is None


def test_after_disconnect_nothing_is_left(
    graph: MemoryGraph, clock: SimulatedClock, client: Client, other: Client
) -> None:
    client.say("subscribe", topic="/t", type="std_msgs/String")
    client.leave()
    assert graph.topic("/t") is None
    other.say("publish", topic="/t", type="std_msgs/String", msg={})
    assert client.heard() == []


def test_order_is_kept(client: Client) -> None:
    client.say("subscribe", topic="/n", type="std_msgs/Int32")
    for number in range(100):
        client.say("publish", topic="/n", type="std_msgs/Int32", msg={"data": number})
    assert [message["data"] for message in client.heard_of("/n")] == list(range(100))


def test_a_program_in_the_process_hears_and_is_heard(graph: MemoryGraph, client: Client) -> None:
    heard: list[float] = []
    node = graph.node("robot")
    node.subscribe("/cmd_vel", lambda message: heard.append(message.linear.x), type="geometry_msgs/Twist")
    client.say("publish", topic="/cmd_vel", msg=TWIST)
    assert heard == [1.5]
    client.say("subscribe", topic="/odom_name", type="std_msgs/String")
    node.advertise("/odom_name", "std_msgs/String").publish({"data": "odom"})
    assert client.heard_of("/odom_name") == [{"data": "odom"}]


def test_at_level_info_success_is_told(client: Client) -> None:
    client.say("set_level", level="info")
    client.say("advertise", id="a1", topic="/t", type="std_msgs/String")
    assert client.heard() == [{"op": "status", "id": "a1", "level": "info", "msg": "advertise: done"}]
    client.say("call_service", id="c1", service="/nothing")
    (reply,) = client.heard()
    assert reply["op"] == "service_response"
    client.say("set_level", level="warning")
    client.say("unadvertise", id="a1", topic="/t")
    assert client.heard() == []


POINT = {"x": 1.0, "y": 2.0, "z": 3.0}


@pytest.mark.parametrize("graph", ["noetic"], indirect=True)
@pytest.mark.parametrize("frame_id", ["map", "long" * 2000])
def test_the_publisher_counts_in_ros_1(client: Client, other: Client, frame_id: str) -> None:
    """Whatever the clients wrote, and however many of them share it."""
    stamp = {"secs": 1, "nsecs": 2}
    other.say("subscribe", topic="/point", type="geometry_msgs/PointStamped")
    headers: list[Mapping[str, object]] = [
        {"seq": 70, "stamp": stamp, "frame_id": frame_id},
        {"frame_id": frame_id, "stamp": stamp},
        {"stamp": stamp, "frame_id": frame_id, "seq": 0},
        {"seq": 70, "frame_id": frame_id, "stamp": stamp},
    ]
    for publisher, header in zip((client, other) * 2, headers, strict=True):
        message = {"header": header, "point": POINT}
        publisher.say("publish", topic="/point", type="geometry_msgs/PointStamped", msg=message)
    heard = [each["msg"]["header"] for each in other.heard()]
    assert heard == [{"seq": n, "stamp": stamp, "frame_id": frame_id} for n in (1, 2, 3, 4)]


def test_the_id_of_a_publish_that_advertises_takes_it_back(client: Client, graph: MemoryGraph) -> None:
    client.say("set_level", level="warning")
    client.say("publish", id="p", topic="/x", type="std_msgs/String", msg={"data": "a"})
    client.say("publish", id="q", topic="/x", msg={"data": "b"})
    client.say("unadvertise", id="q", topic="/x")
    assert graph.topic("/x") is not None
    client.say("unadvertise", id="p", topic="/x")
    client.heard()
    client.say("unadvertise", id="p", topic="/x")
    assert "does not advertise" in client.heard()[0]["msg"]


def test_a_publish_without_id_that_advertises_does_so_until_its_client_leaves(client: Client) -> None:
    client.say("set_level", level="warning")
    client.say("publish", topic="/x", type="std_msgs/String", msg={"data": "a"})
    client.say("unadvertise", topic="/x")
    assert "does not advertise" in client.heard()[0]["msg"]
