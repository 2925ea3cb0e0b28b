from __future__ import annotations

import logging
import struct
from functools import partial
from typing import TYPE_CHECKING, Any

import anyio.to_thread
import pytest

from rwt.extensions.ros1 import Ros1Graph
from tests.extensions.ros1.live.program import NODE
from tests.waiting import until

if TYPE_CHECKING:
    from rwt_graph.api import Sample
    from tests.extensions.ros1.live.conftest import Ros

pytestmark = pytest.mark.anyio

SUBSCRIBE = """
from std_msgs.msg import String
received = []
rospy.Subscriber('/chatter', String, lambda m: received.append(m.data))
"""

PUBLISH = """
from std_msgs.msg import String
publisher = rospy.Publisher('/chatter', String, queue_size=1000)
"""

#: A package that nobody has: the classes of rospy as genpy makes them, and unknown to this process.
UNKNOWN = """
import genpy.dynamic
definition = '''int32 number
Inner[] inner
time when
================================================================================
MSG: never_seen/Inner
string text
float64[2] pair
'''
classes = genpy.dynamic.generate_dynamic('never_seen/Outer', definition)
Outer, Inner = classes['never_seen/Outer'], classes['never_seen/Inner']
publisher = rospy.Publisher('/strange', Outer, latch=True, queue_size=10)
publisher.publish(Outer(7, [Inner('a', [1.0, 2.5]), Inner('b', [0.0, -1.0])], rospy.Time(5, 6)))
"""

OTHER_STRING = """
import genpy.dynamic
definition = 'string data\\nint32 number\\n'
Other = genpy.dynamic.generate_dynamic('std_msgs/String', definition)['std_msgs/String']
publisher = rospy.Publisher('/chatter', Other, latch=True, queue_size=10)
publisher.publish(Other('other', 5))
received = []
rospy.Subscriber('/commands', Other, lambda m: received.append([m.data, m.number]))
commands = rospy.Publisher('/commands', Other, queue_size=10)
"""


def _connected(graph: Ros1Graph, node: str, topic: str) -> list[str]:
    """Return the nodes that are connected to a publication of this process."""
    assert graph.session is not None
    publication = graph.session.nodes[node].publications[topic]
    return [link.caller for link in publication.links]


async def test_latched_messages_reach_late_subscribers_both_ways(ros: Ros, graph: Ros1Graph) -> None:
    graph.node("talker").advertise("/chatter", "std_msgs/String", latch=True).publish({"data": "kept"})
    program = ros.program()
    program.run(SUBSCRIBE)
    await until(lambda: program.run("result = received") == ["kept"])
    program.run("late = rospy.Publisher('/late', String, latch=True, queue_size=1); late.publish('old')")
    program.run("late.publish('new')")
    listener = graph.node("listener")
    for _ in range(2):
        messages: list[Any] = []
        listener.subscribe("/late", messages.append, "std_msgs/String")
        await until(partial(bool, messages))
        assert [message.data for message in messages] == ["new"]


async def test_a_type_that_nobody_knew_is_learned_from_its_publisher(ros: Ros, graph: Ros1Graph) -> None:
    ros.program().run(UNKNOWN)
    values: list[Any] = []
    graph.node("listener").subscribe("/strange", values.append)
    await until(lambda: values)
    (value,) = values
    assert (value.number, value.when.secs, value.when.nsecs) == (7, 5, 6)
    assert [(each.text, list(each.pair)) for each in value.inner] == [("a", [1.0, 2.5]), ("b", [0.0, -1.0])]
    info = graph.topic("/strange")
    assert info is not None
    assert [each.node for each in info.publishers] == [NODE]
    assert graph.registry.message("never_seen/Outer") is info.type
    # It can be published then, too.
    graph.node("talker").advertise("/echo", "never_seen/Outer", latch=True).publish(value)
    program = ros.program("second")
    program.run(UNKNOWN + "\nreceived = []\nrospy.Subscriber('/echo', Outer, received.append)")
    await until(lambda: program.run("result = [plain(each) for each in received]"))
    (back,) = program.run("result = [plain(each) for each in received]")
    assert back["inner"][1] == {"text": "b", "pair": [0.0, -1.0]}


async def test_a_type_is_used_as_the_topic_has_it(
    ros: Ros, graph: Ros1Graph, caplog: pytest.LogCaptureFixture
) -> None:
    program = ros.program()
    program.run(OTHER_STRING)
    values: list[Any] = []
    node = graph.node("both")
    node.subscribe("/chatter", values.append, "std_msgs/String")
    await until(lambda: values)
    assert (values[0].data, values[0].number) == ("other", 5)
    assert "defines std_msgs/String, the type of /chatter, otherwise than this process" in caplog.text
    node.subscribe("/commands", lambda _: None)
    await until(lambda: _has_number(graph))
    publisher = node.advertise("/commands", "std_msgs/String", latch=True)
    publisher.publish({"data": "go", "number": 3})
    await until(lambda: program.run("result = received") == [["go", 3]])


def _has_number(graph: Ros1Graph) -> bool:
    info = graph.topic("/commands")
    return info is not None and info.type is not None and len(info.type.slots) == 2


async def test_another_definition_of_a_subscriber_is_refused_with_both(
    ros: Ros, graph: Ros1Graph, caplog: pytest.LogCaptureFixture
) -> None:
    graph.node("talker").advertise("/commands", "std_msgs/String")
    program = ros.program()
    program.run(OTHER_STRING.replace("commands = rospy.Publisher('/commands', Other, queue_size=10)", ""))
    await until(lambda: "cannot subscribe to /commands" in caplog.text)
    assert "int32 number" in caplog.text


async def test_samples_are_relayed_as_they_came(ros: Ros, graph: Ros1Graph) -> None:
    program = ros.program()
    program.run(PUBLISH)
    samples: list[Sample] = []
    graph.participant("/listener").subscribe("/chatter", samples.append)
    await until(lambda: program.run("result = publisher.get_num_connections()") == 1)
    program.run("publisher.publish('raw')")
    await until(lambda: samples)
    assert not samples[0].payload.is_decoded
    assert samples[0].payload.serialised() == struct.pack("<I", 3) + b"raw"
    assert samples[0].node == NODE


async def test_a_killed_publisher_is_found_again(ros: Ros, graph: Ros1Graph) -> None:
    texts: list[str] = []
    graph.node("listener").subscribe(
        "/chatter", lambda message: texts.append(message.data), "std_msgs/String"
    )
    for word in ("first", "second"):
        program = ros.program()
        program.run(PUBLISH)
        await until(partial(program.run, "result = publisher.get_num_connections()"))
        program.run(f"publisher.publish({word!r})")
        await until(partial(texts.count, word))
        program.kill()


async def test_a_restarted_master_gets_all_registrations(
    ros: Ros, graph: Ros1Graph, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    node = graph.node("both")
    publisher = node.advertise("/chatter", "std_msgs/String")
    node.subscribe("/other", lambda _: None, "std_msgs/String")
    await ros.shows({"/other"}, "rostopic", "list")
    ros.stop_master()
    await until(lambda: "is tried again until it answers" in caplog.text)
    await anyio.to_thread.run_sync(ros.start_master)
    await until(lambda: "everything is registered again" in caplog.text)
    program = ros.program()
    program.run(SUBSCRIBE)

    def arrived() -> bool:
        publisher.publish({"data": "again"})
        return "again" in program.run("result = received")

    await until(arrived)
    info = await anyio.to_thread.run_sync(ros.tool, "rosnode", "info", "/both")
    assert "* /other [" in info
    assert "* to: /robot/program" in info


async def test_a_subscriber_that_stalls_is_bounded_and_affects_no_other(
    ros: Ros, graph: Ros1Graph, caplog: pytest.LogCaptureFixture
) -> None:
    stalled, other = ros.program("stalled"), ros.program("other")
    for program in (stalled, other):
        program.run(SUBSCRIBE.replace("m.data", "len(m.data)"))
    publisher = graph.node("talker").advertise("/chatter", "std_msgs/String")
    await until(lambda: len(_connected(graph, "/talker", "/chatter")) == 2)
    stalled.process.send_signal(19)
    try:
        for _ in range(60):
            publisher.publish({"data": "x" * 1_000_000})
            await anyio.sleep(0.01)
        await until(lambda: program.run("result = len(received)") == 60)
        assert graph.session is not None
        links = graph.session.nodes["/talker"].publications["/chatter"].links
        (slow,) = (link for link in links if link.traffic.dropped)
        assert slow.caller == "/robot/stalled"
        assert caplog.text.count("node /robot/stalled reads /chatter too slowly") == 1
        assert slow.traffic.queued_bytes <= 18_000_000
    finally:
        stalled.process.send_signal(18)
    publisher.publish({"data": "the last"})
    await until(lambda: 8 in stalled.run("result = received"))


async def test_the_first_message_of_a_new_publisher_is_not_lost(ros: Ros, graph: Ros1Graph) -> None:
    program = ros.program()
    program.run(SUBSCRIBE)
    graph.node("talker").publish("/chatter", {"data": "first"}, "std_msgs/String")
    await until(lambda: program.run("result = received") == ["first"])


async def test_leaving_unregisters_everything(ros: Ros, graph: Ros1Graph) -> None:
    node = graph.node("short")
    node.advertise("/chatter", "std_msgs/String")
    node.subscribe("/other", lambda _: None, "std_msgs/String")
    await ros.shows({"/other"}, "rostopic", "list")
    node.close()
    await until(lambda: ros.tool("rostopic", "list").strip() == "")
