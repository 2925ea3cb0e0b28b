"""Channels: what a client is told that there is, live, in its role, and the messages that it gets."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import pytest

from rwt import Settings
from rwt.access.access import Access
from rwt.extensions.foxglove.gateway import NODE, FoxgloveGateway
from rwt.rosbridge.bridge import Bridge
from rwt_graph import MemoryGraph, Node
from rwt_graph.clock import SimulatedClock
from rwt_interfaces.distro import NOETIC
from rwt_interfaces.registry import Registry
from rwt_interfaces.structs import MessageType
from rwt_participant.qos import LATCHED
from rwt_transports.endpoint import DropReason
from rwt_transports.errors import Refused
from tests.conftest import START_NS
from tests.core.rosbridge.recording_client import Client
from tests.extensions.foxglove.conftest import MakeGateway, guest
from tests.extensions.foxglove.viewer import EVERY_NODES, Data, Viewer

TIME = """\

================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
HELLO = bytes.fromhex("00010000 06000000") + b"hello\0"
"""The String "hello" in CDR."""


def test_the_first_text_says_what_the_server_is(viewer: Viewer) -> None:
    info = viewer.heard()[0]
    assert info["op"] == "serverInfo"
    assert info["name"].startswith("Robot Web Tools ")
    # rosapi is not there, no files are, and nothing is played; the time is simulated.
    assert info["capabilities"] == [
        "clientPublish", "parametersSubscribe", "time", "services", "connectionGraph",
    ]  # fmt: skip
    assert info["supportedEncodings"] == ["cdr", "json"]
    assert info["metadata"] == {"ROS_DISTRO": "jazzy"}
    assert len(info["sessionId"]) == 32


WIDE = """\
std_msgs/Header header
wstring<=5 word
uint8[] octets
geometry_msgs/Point[2] corners
bool yes
"""


def test_what_viewers_cannot_read_serialised_is_a_channel_in_json(clock: SimulatedClock) -> None:
    registry = Registry()
    registry.add_text(WIDE, "shop_msgs/Wide")
    graph = MemoryGraph(registry, clock)
    gateway = FoxgloveGateway(graph, Access(graph, Settings()))
    wide = Node(graph, "robot").advertise("/wide", "shop_msgs/Wide", latch=True)
    wide.publish({"word": "größe", "octets": b"\x00\xff", "yes": True})
    viewer = Viewer(gateway)
    viewer.heard()
    channel = viewer.channels["/wide"]
    assert (channel["encoding"], channel["schemaEncoding"]) == ("json", "jsonschema")
    assert channel["schemaName"] == "shop_msgs/msg/Wide"
    time = {"type": "object", "properties": {name: {"type": "integer"} for name in ("sec", "nanosec")}}
    point = {"type": "object", "properties": {axis: {"type": "number"} for axis in "xyz"}}
    assert json.loads(channel["schema"]) == {
        "type": "object",
        "properties": {
            "header": {"type": "object", "properties": {"stamp": time, "frame_id": {"type": "string"}}},
            "word": {"type": "string"},
            "octets": {"type": "string", "contentEncoding": "base64"},
            "corners": {"type": "array", "items": point},
            "yes": {"type": "boolean"},
        },
    }
    viewer.subscribe("/wide", 9)
    (message,) = viewer.heard_data()
    assert message.subscription == 9
    read = json.loads(message.payload)
    assert (read["word"], read["octets"], read["yes"]) == ("größe", "AP8=", True)
    assert len(read["corners"]) == 2 and read["header"]["frame_id"] == ""


def test_a_channel_whose_schema_would_be_too_large_stays_serialised(clock: SimulatedClock) -> None:
    registry = Registry()
    registry.add_text("wstring w\n", "p/L0")
    for level in range(1, 16):
        registry.add_text(f"L{level - 1} a\nL{level - 1} b\n", f"p/L{level}")
    graph = MemoryGraph(registry, clock)
    gateway = FoxgloveGateway(graph, Access(graph, Settings()))
    Node(graph, "robot").advertise("/large", "p/L15")
    viewer = Viewer(gateway)
    viewer.heard()
    assert viewer.channels["/large"]["encoding"] == "cdr"


def test_a_channel_describes_its_type_with_all_that_it_contains(
    graph: MemoryGraph, gateway: FoxgloveGateway
) -> None:
    Node(graph, "robot").advertise("/h", "std_msgs/Header")
    viewer = Viewer(gateway)
    viewer.heard()
    channel = viewer.channels["/h"]
    assert channel == {
        "id": channel["id"],
        "topic": "/h",
        "encoding": "cdr",
        "schemaName": "std_msgs/msg/Header",
        "schemaEncoding": "ros2msg",
        "schema": "builtin_interfaces/Time stamp\nstring frame_id\n" + TIME,
    }


def test_ros_1_has_its_own_schemas_and_encoding() -> None:
    graph = MemoryGraph(Registry(NOETIC), SimulatedClock(START_NS))
    gateway = FoxgloveGateway(graph, Access(graph, Settings(distro="noetic")))
    publisher = Node(graph, "robot").advertise("/h", "std_msgs/Header")
    viewer = Viewer(gateway)
    info = viewer.heard()[0]
    assert info["supportedEncodings"] == ["ros1", "json"]
    assert info["metadata"] == {"ROS_DISTRO": "noetic"}
    channel = viewer.channels["/h"]
    assert (channel["encoding"], channel["schemaName"], channel["schemaEncoding"]) == (
        "ros1", "std_msgs/Header", "ros1msg",
    )  # fmt: skip
    assert channel["schema"] == "uint32 seq\ntime stamp\nstring frame_id\n"
    viewer.subscribe("/h")
    publisher.publish({"seq": 3, "stamp": {"secs": 1, "nsecs": 2}, "frame_id": "map"})
    (data,) = viewer.heard_data()
    assert data.payload == struct.pack("<III", 3, 1, 2) + b"\3\0\0\0map"


def test_messages_go_out_as_the_robot_serialises_them(graph: MemoryGraph, gateway: FoxgloveGateway) -> None:
    publisher = Node(graph, "robot").advertise("/t", "std_msgs/String")
    viewer = Viewer(gateway)
    viewer.subscribe("/t", id=7)
    publisher.publish({"data": "hello"})
    assert viewer.heard() == [Data(7, START_NS, HELLO)]
    viewer.say("unsubscribe", subscriptionIds=[7])
    publisher.publish({"data": "hello"})
    assert viewer.heard() == []
    viewer.say("unsubscribe", subscriptionIds=[7])  # It may have ended with its channel.
    assert viewer.heard() == []


def test_a_message_is_serialised_once_for_all_clients_of_all_gateways(
    graph: MemoryGraph, gateway: FoxgloveGateway, monkeypatch: pytest.MonkeyPatch
) -> None:
    publisher = Node(graph, "robot").advertise("/t", "sensor_msgs/Image")
    viewers = [Viewer(gateway) for _ in range(3)]
    for viewer, id in zip(viewers, (1, 1, 2), strict=True):
        viewer.subscribe("/t", id)
    bridge = Client(Bridge(graph, Settings()))
    bridge.say("subscribe", topic="/t", compression="cbor-raw")
    made: list[str] = []
    original = MessageType.binary_encoder

    def counted(self: MessageType, form: Any) -> Any:
        made.append(form)
        return original(self, form)

    monkeypatch.setattr(MessageType, "binary_encoder", counted)
    publisher.publish({"data": b"x" * 1_000_000})
    assert made == ["cdr"]  # The others found it.
    parts = [
        [frame.parts for frame, topic in each.frames if topic == "/t"][-1] for each in (*viewers, bridge)
    ]
    large = [max(part, key=len) for part in parts]
    assert all(each is large[0] for each in large)
    assert len(large[0]) == 1_000_000
    # Those of one id share the frame with its head, too.
    assert viewers[0].frames[-1][0] is viewers[1].frames[-1][0]
    assert viewers[0].frames[-1][0] is not viewers[2].frames[-1][0]


def test_what_is_kept_comes_first(graph: MemoryGraph, gateway: FoxgloveGateway) -> None:
    Node(graph, "robot").advertise("/t", "std_msgs/String", qos=LATCHED).publish({"data": "hello"})
    viewer = Viewer(gateway)
    viewer.subscribe("/t")
    assert viewer.heard() == [Data(1, START_NS, HELLO)]


def test_channels_come_and_go_with_the_graph(
    graph: MemoryGraph, gateway: FoxgloveGateway, clock: SimulatedClock, viewer: Viewer
) -> None:
    viewer.heard()
    node = Node(graph, "robot")
    node.advertise("/t", "std_msgs/String")
    node.advertise_service("/s", "std_srvs/Trigger", lambda _: {"success": True})
    clock.advance(0.2)
    viewer.heard()
    assert viewer.topics == {"/t"} and "/s" in viewer.services
    first = viewer.channels["/t"]["id"]
    viewer.subscribe("/t")
    assert len(viewer.client.graph.counters.topics) == 1
    node.close()
    clock.advance(0.2)
    texts = [each for each in viewer.heard() if isinstance(each, dict)]
    assert any(first in each.get("channelIds", ()) for each in texts if each["op"] == "unadvertise")
    assert viewer.topics == set() and "/s" not in viewer.services
    # The gateway does not hold the topic that it told of.
    assert graph.topic("/t") is None
    Node(graph, "again").advertise("/t", "std_msgs/String").publish({"data": "hello"})
    clock.advance(0.2)
    viewer.heard()
    assert viewer.channels["/t"]["id"] > first
    viewer.subscribe("/t")  # The subscription of the channel that is gone has ended with it.
    assert viewer.statuses() == []


def test_a_topic_of_another_type_is_another_channel(
    graph: MemoryGraph, gateway: FoxgloveGateway, clock: SimulatedClock, viewer: Viewer
) -> None:
    node = Node(graph, "robot")
    node.advertise("/t", "std_msgs/String")
    clock.advance(0.2)
    viewer.subscribe("/t")
    node.close()
    clock.advance(0.2)
    Node(graph, "robot").advertise("/t", "std_msgs/Int32")
    clock.advance(0.2)
    viewer.heard()
    assert viewer.channels["/t"]["schemaName"] == "std_msgs/msg/Int32"


def test_a_topic_that_only_subscribers_have_is_shown_but_for_those_of_the_gateway(
    graph: MemoryGraph, gateway: FoxgloveGateway
) -> None:
    Node(graph, "robot").subscribe("/cmd", lambda _: None, type="std_msgs/String")
    graph.participant(NODE).subscribe("/own", lambda _: None, graph.registry.message("std_msgs/String"))
    viewer = Viewer(gateway)
    viewer.heard()
    assert viewer.topics == {"/cmd"}


def test_clients_of_one_role_share_what_they_are_told(graph: MemoryGraph, gateway: FoxgloveGateway) -> None:
    Node(graph, "robot").advertise("/t", "std_msgs/String")
    one, other = Viewer(gateway), Viewer(gateway)
    assert one.frames[1][0] is other.frames[1][0]


# -- roles -------------------------------------------------------------------------------------------------


def test_a_role_is_shown_what_it_may_use(graph: MemoryGraph, make: MakeGateway) -> None:
    node = Node(graph, "robot")
    for name in ("open", "secret"):
        node.advertise(f"/{name}_topic", "std_msgs/String")
        node.advertise_service(f"/{name}_service", "std_srvs/Trigger", lambda _: {"success": True})
    node.advertise("/open_to_write", "std_msgs/String")
    gateway = make(**guest(subscribe=["/open_topic"], call=["/open*"], publish=["/open_to_write"]))
    viewer = Viewer(gateway)
    heard = viewer.heard()
    assert "secret" not in str(heard)
    assert viewer.topics == {"/open_topic"}
    assert set(viewer.services) == {"/open_service"}
    viewer.say("subscribeConnectionGraph")
    (update,) = viewer.heard()
    assert [each["name"] for each in update["publishedTopics"]] == ["/open_to_write", "/open_topic"]
    assert "secret" not in str(update)
    viewer.say("subscribe", subscriptions=[{"id": n, "channelId": n} for n in range(50)])
    assert "secret" not in str(viewer.heard())


def test_a_viewer_that_may_only_look_is_not_told_that_it_can_do_more(make: MakeGateway) -> None:
    viewer = Viewer(make(**guest(subscribe=["*"])))
    capabilities = viewer.heard()[0]["capabilities"]
    assert "clientPublish" not in capabilities and "parametersSubscribe" not in capabilities


def test_who_must_authenticate_by_an_op_is_turned_away(make: MakeGateway, tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("a" * 16)
    gateway = make(auth={"rosauth_secret_file": str(secret)})
    with pytest.raises(Refused, match=r"auth\.tokens") as refused:
        Viewer(gateway)
    assert refused.value.status == 401


def test_another_role_shows_other_channels_and_ends_what_it_does_not_allow(
    graph: MemoryGraph, gateway: FoxgloveGateway, make: MakeGateway
) -> None:
    publisher = Node(graph, "robot").advertise("/t", "std_msgs/String")
    Node(graph, "robot").advertise("/u", "std_msgs/String")
    gateway = make(**guest(subscribe=["*"], publish=["*"]))
    viewer = Viewer(gateway)
    viewer.subscribe("/t", 1)
    viewer.subscribe("/u", 2)
    viewer.advertise("/mine", "std_msgs/String")
    assert viewer.heard() == []
    gateway.access.admission.prepare(Settings.model_validate(guest(subscribe=["/u"])))()
    gateway.reload_roles()
    heard = viewer.heard()
    assert viewer.topics == {"/u"}
    assert any("roles.guest.publish" in str(each) for each in heard)
    publisher.publish({"data": "hello"})
    assert viewer.heard_data() == []
    viewer.publish(b'{"data":"x"}')
    assert viewer.statuses() == ["message data: this client advertises no channel 1"]
    gateway.access.admission.prepare(
        Settings.model_validate({"auth": {"tokens": {"a": {"token": "x" * 20, "role": "admin"}}}})
    )()
    gateway.reload_roles()
    assert viewer.close_code == 1008


# -- refusals and drops ------------------------------------------------------------------------------------


def test_a_subscription_that_is_not_possible_is_refused_by_itself(
    graph: MemoryGraph, gateway: FoxgloveGateway
) -> None:
    publisher = Node(graph, "robot").advertise("/t", "std_msgs/String")
    Node(graph, "robot").advertise("/u", "std_msgs/String")
    viewer = Viewer(gateway)
    viewer.heard()
    t, u = (viewer.channels[name]["id"] for name in ("/t", "/u"))
    asked = [(1, 999), (1, t), (1, u), (2, t), (3, u)]
    viewer.say("subscribe", subscriptions=[{"id": id, "channelId": channel} for id, channel in asked])
    assert "".join(viewer.statuses()) == (
        "subscribe: there is no channel 999; subscribe: subscription 1 is in use; take another id;"
        f" subscribe: channel {t} (/t) is subscribed to already"
    )
    publisher.publish({"data": "hello"})
    assert [each.subscription for each in viewer.heard_data()] == [1]


def test_subscriptions_are_bounded(graph: MemoryGraph, make: MakeGateway) -> None:
    node = Node(graph, "robot")
    for number in range(4):
        node.advertise(f"/t{number}", "std_msgs/String")
    viewer = Viewer(make(limits={"subscriptions": 2}))
    viewer.heard()
    ids = [channel["id"] for channel in viewer.channels.values()]
    viewer.say("subscribe", subscriptions=[{"id": id, "channelId": id} for id in ids])
    (status,) = viewer.statuses()
    assert status.count("limits.subscriptions") == 1
    viewer.say("unsubscribe", subscriptionIds=ids)
    viewer.say("subscribe", subscriptions=[{"id": id, "channelId": id} for id in ids[2:4]])
    assert viewer.statuses() == []


def test_a_slow_viewer_hears_once_why_messages_are_missing(
    graph: MemoryGraph, gateway: FoxgloveGateway, clock: SimulatedClock
) -> None:
    Node(graph, "robot").advertise("/t", "std_msgs/String")
    viewer = Viewer(gateway)
    viewer.subscribe("/t")
    viewer.heard()
    drop = viewer.flows["/t"].drop
    assert drop is not None
    for _ in range(3):
        drop(DropReason.BACKLOG)
        clock.advance(1.5)
    (status,) = [each for each in viewer.heard() if isinstance(each, dict)]
    assert (status["level"], status["id"]) == (1, "dropped /t")
    assert status["message"] == (
        "/t: messages are dropped: this connection is slower than all that it is subscribed to"
    )


def test_who_leaves_leaves_nothing(
    graph: MemoryGraph, gateway: FoxgloveGateway, clock: SimulatedClock
) -> None:
    Node(graph, "robot").advertise("/t", "std_msgs/String")
    before = graph.topics(), graph.services()
    viewer = Viewer(gateway)
    viewer.subscribe("/t")
    viewer.advertise("/mine", "std_msgs/String")
    viewer.leave()
    clock.advance(20.0)  # A topic outlives its last publisher by ten seconds.
    assert (graph.topics(), graph.services()) == before
    assert gateway.clients == () and not gateway.shared.fanouts
    # Nothing looks at the graph any more, either.
    assert clock.until_next() is None


def changes(viewer: Viewer) -> dict[str, Any]:
    """Return the next connection graph sent to the viewer, without the parts of every node."""
    (update,) = viewer.heard_of("connectionGraphUpdate")
    for of in ("publishedTopics", "subscribedTopics"):
        update[of] = [each for each in update[of] if each["name"] not in EVERY_NODES]
    return dict(update)


def test_the_connection_graph_is_told_once_and_then_what_changes(
    graph: MemoryGraph, gateway: FoxgloveGateway, clock: SimulatedClock
) -> None:
    robot = Node(graph, "robot")
    robot.advertise("/t", "std_msgs/String")
    viewer = Viewer(gateway)
    viewer.heard()
    viewer.say("subscribeConnectionGraph")
    update = changes(viewer)
    assert update["publishedTopics"] == [{"name": "/t", "publisherIds": ["/robot"]}]
    assert (update["removedTopics"], update["removedServices"]) == ([], [])
    other = Node(graph, "other")
    other.subscribe("/t", lambda _: None)
    other.advertise_service("/s", "std_srvs/Trigger", lambda _: {"success": True})
    clock.advance(0.2)
    update = changes(viewer)
    assert update["publishedTopics"] == []
    assert update["subscribedTopics"] == [{"name": "/t", "subscriberIds": ["/other"]}]
    assert {"name": "/s", "providerIds": ["/other"]} in update["advertisedServices"]
    robot.close()
    clock.advance(0.2)
    update = changes(viewer)
    assert update["publishedTopics"] == [{"name": "/t", "publisherIds": []}]
    other.close()
    clock.advance(0.2)
    update = changes(viewer)
    assert "/t" in update["removedTopics"] and "/s" in update["removedServices"]
    viewer.say("unsubscribeConnectionGraph")
    Node(graph, "third").advertise("/v", "std_msgs/String")
    clock.advance(0.2)
    assert not any(
        isinstance(each, dict) and each["op"] == "connectionGraphUpdate" for each in viewer.heard()
    )


def test_time_that_is_not_the_walls_is_told(clock: SimulatedClock, viewer: Viewer) -> None:
    viewer.heard()
    clock.advance(0.1)
    times = [each for each in viewer.heard() if isinstance(each, int)]
    assert times and times[-1] == START_NS + 100_000_000
    clock.set_time(START_NS - 5)
    clock.advance(0.05)
    assert any(isinstance(each, int) and each < START_NS + 100_000_000 for each in viewer.heard())
