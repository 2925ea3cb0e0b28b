from __future__ import annotations

import itertools
import threading
from functools import partial
from typing import TYPE_CHECKING, Any

import pytest

from rwt_interfaces.payload import Payload
from rwt_participant.qos import DEFAULT_QOS, LATCHED, SENSOR_DATA, Reliability
from tests.extensions.ros2.live.program import NODE
from tests.waiting import until

if TYPE_CHECKING:
    from rwt.extensions.ros2 import Ros2Graph
    from rwt_graph.api import Sample
    from tests.statements import Program

pytestmark = pytest.mark.anyio

_DEPTHS = "qos.QoSProfile(depth={}, durability=qos.DurabilityPolicy.TRANSIENT_LOCAL)"


class Received(list[str]):
    """A subscriber that writes down the texts."""

    def __call__(self, sample: Sample) -> None:
        self.append(_data(sample))


def _data(sample: Sample) -> str:
    message: Any = sample.payload.value()
    return str(message.data)


def text(graph: Ros2Graph, data: str) -> Payload:
    return Payload.from_value(graph.registry.message("std_msgs/String"), {"data": data})


async def test_bytes_pass_unchanged(graph: Ros2Graph, program: Program) -> None:
    samples: list[Sample] = []
    graph.participant("/ours").subscribe("/bytes", samples.append)
    program.run(
        """
from std_msgs.msg import UInt8MultiArray
from rclpy.serialization import serialize_message
publisher = node.create_publisher(UInt8MultiArray, '/bytes', 10)
message = UInt8MultiArray(data=bytes(range(256)) * 4000)
"""
    )
    await until(lambda: program.run("result = publisher.get_subscription_count()") == 1)
    await until(lambda: NODE in [node.name for node in graph.nodes()])
    expected = program.run("publisher.publish(message); result = serialize_message(message).hex()")
    await until(lambda: samples)
    assert not samples[0].payload.is_decoded
    assert samples[0].payload.cdr().hex() == expected
    assert samples[0].node == NODE


async def test_nodes_topics_types_and_qos_are_discovered(graph: Ros2Graph, program: Program) -> None:
    program.run(
        """
a = node.create_publisher(String, '/a', qos.qos_profile_sensor_data)
b = node.create_subscription(String, '/b', print, 10)
"""
    )
    await until(lambda: graph.topic("/a") and graph.topic("/b"))
    await until(lambda: NODE in [node.name for node in graph.nodes()])
    info = graph.topic("/a")
    assert info is not None
    assert info.type is graph.registry.message("std_msgs/String")
    (end,) = info.publishers
    assert (end.node, end.type) == (NODE, "std_msgs/msg/String")
    assert end.qos.reliability is Reliability.BEST_EFFORT
    (node,) = (node for node in graph.nodes() if node.name == NODE)
    assert "/a" in node.publishing
    assert "/b" in node.subscribing
    before = graph.version
    program.run("node.destroy_publisher(a)")
    await until(lambda: graph.topic("/a") is None)
    assert graph.version > before
    program.close()
    await until(lambda: NODE not in [node.name for node in graph.nodes()])


async def test_our_nodes_and_endpoints_are_seen(graph: Ros2Graph, program: Program) -> None:
    ours = graph.participant("/fleet/ours")
    publisher = ours.advertise("/a", graph.registry.message("std_msgs/String"), LATCHED)
    ours.subscribe("/b", lambda _: None, graph.registry.message("std_msgs/String"), SENSOR_DATA)
    look = "result = [(i.node_name, i.node_namespace, i.topic_type, int(i.qos_profile.{})) for i in {}]"
    publishers = look.format("durability", "node.get_publishers_info_by_topic('/a')")
    subscriptions = look.format("reliability", "node.get_subscriptions_info_by_topic('/b')")
    await until(lambda: program.run(publishers) == [["ours", "/fleet", "std_msgs/msg/String", 1]])
    await until(lambda: program.run(subscriptions) == [["ours", "/fleet", "std_msgs/msg/String", 2]])
    names = "result = [ns.rstrip('/') + '/' + name for name, ns in node.get_node_names_and_namespaces()]"
    await until(lambda: "/fleet/ours" in program.run(names))
    publisher.close()
    await until(lambda: not program.run(publishers))
    ours.close()
    await until(lambda: "/fleet/ours" not in program.run(names))
    assert graph.topic("/a") is None


async def test_late_subscribers_receive_what_two_publishers_retain(
    graph: Ros2Graph, program: Program
) -> None:
    program.run(
        f"""
deep = node.create_publisher(String, '/kept', {_DEPTHS.format(3)})
latched = node.create_publisher(String, '/kept', {_DEPTHS.format(1)})
for number in range(1, 6): deep.publish(String(data=f'deep {{number}}'))
for number in range(1, 3): latched.publish(String(data=f'latched {{number}}'))
"""
    )
    ours = graph.participant("/ours")
    first = Received()
    subscription = ours.subscribe("/kept", first)
    retained = ["deep 3", "deep 4", "deep 5", "latched 2"]
    await until(lambda: sorted(first) == retained)
    for number in range(2, 51):
        late = Received()
        ours.subscribe("/kept", late)
        assert late == retained, number
    program.run("deep.publish(String(data='deep 6')); latched.publish(String(data='latched 3'))")
    await until(lambda: len(first) == 6)
    retained = ["deep 4", "deep 5", "deep 6", "latched 3"]
    await until(lambda: sorted(_data(sample) for sample in subscription.history()) == retained)
    volatile = Received()
    ours.subscribe("/kept", volatile, qos=DEFAULT_QOS)
    await until(lambda: program.run("result = deep.get_subscription_count()") == 2)
    program.run("deep.publish(String(data='deep 7'))")
    await until(lambda: "deep 7" in first and volatile)
    assert volatile == ["deep 7"]
    assert first.count("deep 7") == 1


async def test_the_depth_of_a_publisher_that_starts_later(graph: Ros2Graph, program: Program) -> None:
    ours = graph.participant("/ours")
    first = Received()
    ours.subscribe("/kept", first)
    program.run(f"deep = node.create_publisher(String, '/kept', {_DEPTHS.format(2)})")
    await until(lambda: program.run("result = deep.get_subscription_count()") == 1)
    for number in range(1, 6):
        program.run(f"deep.publish(String(data='{number}'))")
        await until(partial(first.__contains__, str(number)))

    def late() -> list[str]:
        received = Received()
        ours.subscribe("/kept", received).close()
        return received

    await until(lambda: late() == ["4", "5"])
    assert first == ["1", "2", "3", "4", "5"]


async def test_a_mixture_of_latched_and_volatile_publishers(graph: Ros2Graph, program: Program) -> None:
    program.run(
        f"""
latched = node.create_publisher(String, '/mixed', {_DEPTHS.format(1)})
latched.publish(String(data='latched'))
volatile = node.create_publisher(String, '/mixed', qos.qos_profile_sensor_data)
"""
    )
    received = Received()
    graph.participant("/ours").subscribe("/mixed", received)
    await until(lambda: received == ["latched"])
    await until(lambda: program.run("result = volatile.get_subscription_count()") >= 1)
    for data in ("volatile", "latched"):
        program.run(f"{data}.publish(String(data='{data} 2'))")
        await until(partial(received.__contains__, f"{data} 2"))
    assert received == ["latched", "volatile 2", "latched 2"]


async def test_a_subscription_follows_a_best_effort_publisher_that_starts_later(
    graph: Ros2Graph, program: Program
) -> None:
    received = Received()
    graph.participant("/ours").subscribe("/later", received, graph.registry.message("std_msgs/String"))
    program.run(
        """
publisher = node.create_publisher(String, '/later', qos.qos_profile_sensor_data)
timer = node.create_timer(0.05, lambda: publisher.publish(String(data='x')))
"""
    )
    await until(lambda: received)


async def test_our_own_samples_do_not_come_back(graph: Ros2Graph, program: Program) -> None:
    ours = graph.participant("/ours")
    received = Received()
    string = graph.registry.message("std_msgs/String")
    ours.subscribe("/both", received, string)
    publisher = ours.advertise("/both", string)
    program.run(
        """
received = []
node.create_subscription(String, '/both', lambda m: received.append(m.data), 10)
publisher = node.create_publisher(String, '/both', 10)
"""
    )
    await until(lambda: program.run("result = publisher.get_subscription_count()") == 2)
    await until(lambda: publisher.subscriber_count == 2)
    publisher.publish(text(graph, "ours"))
    await until(lambda: program.run("result = received") == ["ours"])
    program.run("publisher.publish(String(data='theirs'))")
    await until(lambda: "theirs" in received)
    assert received == ["ours", "theirs"]


async def test_idle_subscriptions_need_no_threads_of_their_own(graph: Ros2Graph) -> None:
    ours, string = graph.participant("/ours"), graph.registry.message("std_msgs/String")
    before = threading.active_count()
    subscriptions = [ours.subscribe(f"/idle_{n}", lambda _: None, string) for n in range(50)]
    assert threading.active_count() == before
    for subscription in subscriptions:
        subscription.close()


async def test_descriptors_of_closed_subscriptions_are_released(graph: Ros2Graph) -> None:
    import os

    ours, string = graph.participant("/ours"), graph.registry.message("std_msgs/String")
    counts = []
    for _ in itertools.repeat(None, 30):
        ours.subscribe("/again", lambda _: None, string).close()
        counts.append(len(os.listdir("/proc/self/fd")))
    assert counts[-1] == counts[5]


async def test_a_middleware_without_callbacks_is_waited_for(
    domain: int, program: Program, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rwt.extensions.ros2 import Ros2Graph, wakeups

    def load_rcl() -> object:
        rcl = original()
        for name in wakeups.SETTERS.values():
            monkeypatch.setattr(rcl, name, lambda *_: 3)  # RCL_RET_UNSUPPORTED
        return rcl

    original = wakeups.load_rcl
    monkeypatch.setattr(wakeups, "load_rcl", load_rcl)
    received = Received()
    async with Ros2Graph() as graph:
        graph.participant("/ours").subscribe("/waited", received, graph.registry.message("std_msgs/String"))
        program.run(
            """
publisher = node.create_publisher(String, '/waited', 10)
timer = node.create_timer(0.05, lambda: publisher.publish(String(data='x')))
"""
        )
        await until(lambda: received)


async def test_many_subscriptions_share_descriptors(
    graph: Ros2Graph, program: Program, monkeypatch: pytest.MonkeyPatch
) -> None:
    import os

    from rwt.extensions.ros2 import wakeups

    monkeypatch.setattr(wakeups, "MOST_DESCRIPTORS", 8)
    ours, string = graph.participant("/ours"), graph.registry.message("std_msgs/String")
    for number in range(8):
        ours.subscribe(f"/own_{number}", lambda _: None, string)
    before = len(os.listdir("/proc/self/fd"))
    received = [Received() for _ in range(20)]
    subscriptions = [
        ours.subscribe(f"/shared_{number}", each, string) for number, each in enumerate(received)
    ]
    assert len(os.listdir("/proc/self/fd")) == before
    program.run(
        """
publishers = [node.create_publisher(String, f'/shared_{n}', 10) for n in range(20)]
"""
    )
    counts = "result = [each.get_subscription_count() for each in publishers]"
    await until(lambda: program.run(counts) == [1] * 20)
    subscriptions.pop(3).close()
    program.run("for n, each in enumerate(publishers): each.publish(String(data=str(n)))")
    await until(lambda: all(received[:3] + received[4:]))
    assert received[3] == []
    assert [each[0] for each in received[4:]] == [str(number) for number in range(4, 20)]
