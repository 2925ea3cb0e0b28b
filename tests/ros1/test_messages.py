"""Messages of all standard types, value by value against those of rospy and roscpp."""

from __future__ import annotations

import json
import subprocess
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

import anyio.to_thread
import pytest

from rwt_graph.api import Sample
from rwt_interfaces.distro import NOETIC
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_participant.qos import LATCHED
from tests.waiting import until

if TYPE_CHECKING:
    from rwt_graph.ros1 import Ros1Graph
    from tests.ros1.conftest import Ros

pytestmark = pytest.mark.anyio

#: Publishes a random message of each type, and compares what comes back.
PROGRAM: Final = """
import importlib, random, genpy
source = random.Random(7)
packages = 'actionlib_msgs geometry_msgs nav_msgs rosgraph_msgs sensor_msgs std_msgs tf2_msgs'.split()
classes = {}
for package in packages:
    module = importlib.import_module(package + '.msg')
    for name in dir(module):
        each = getattr(module, name)
        if isinstance(each, type) and issubclass(each, genpy.Message):
            classes[each._type] = each

def value(kind):
    base, bracket, length = kind.partition('[')
    if bracket:
        count = int(length[:-1] or source.randrange(4))
        if base in ('uint8', 'char'):
            return bytes(source.randrange(256) for _ in range(count))
        return [value(base) for _ in range(count)]
    if base in ('float32', 'float64'):
        return source.randrange(-10**6, 10**6) / 8
    if base == 'string':
        return source.choice(['', 'text', 'Umläute äöü', '<&>"'])
    if base == 'bool':
        return source.random() < 0.5
    if base == 'time':
        return genpy.Time(source.randrange(2**31), source.randrange(10**9))
    if base == 'duration':
        return genpy.Duration(source.randrange(2**31), source.randrange(10**9))
    if '/' not in base and (base in ('byte', 'char') or 'int' in base):
        bits = {'byte': 8, 'char': 8}.get(base) or int(base.strip('uint'))
        signed = base == 'byte' or base[0] == 'i'
        return source.randrange(-2**(bits - 1), 2**(bits - 1)) if signed else source.randrange(2**bits)
    return filled(genpy.message.get_message_class(base if '/' in base else 'std_msgs/' + base))

def filled(cls):
    return cls(*(value(kind) for kind in cls._slot_types))

sent, back, publishers = {}, {}, []
for name, cls in classes.items():
    sent[name] = filled(cls)
    publishers.append(rospy.Publisher('/from/' + name, cls, latch=True, queue_size=1))
    publishers[-1].publish(sent[name])
    rospy.Subscriber('/back/' + name, cls, lambda message, name=name: back.setdefault(name, message))
result = {name: cls._md5sum for name, cls in classes.items()}
"""

NODE_CPP: Final = r"""
#include <ros/ros.h>
#include <std_msgs/String.h>
// A package of which no other program has the definition.
namespace never_seen {
struct Pose { std::string name; double values[2]; int32_t count; };
}
namespace ros { namespace message_traits {
template<> struct MD5Sum<never_seen::Pose> {
  static const char* value() { return "MD5"; }
  static const char* value(const never_seen::Pose&) { return value(); }
};
template<> struct DataType<never_seen::Pose> {
  static const char* value() { return "never_seen/Pose"; }
  static const char* value(const never_seen::Pose&) { return value(); }
};
template<> struct Definition<never_seen::Pose> {
  static const char* value() { return "string name\nfloat64[2] values\nint32 count\n"; }
  static const char* value(const never_seen::Pose&) { return value(); }
};
} namespace serialization {
template<> struct Serializer<never_seen::Pose> {
  template<typename Stream, typename T> inline static void allInOne(Stream& stream, T m) {
    stream.next(m.name); stream.next(m.values[0]); stream.next(m.values[1]); stream.next(m.count);
  }
  ROS_DECLARE_ALLINONE_SERIALIZER
};
}}
ros::Publisher poses, echo;
void received(const never_seen::Pose& pose) {
  never_seen::Pose next = pose;
  next.count++;
  poses.publish(next);
}
void heard(const std_msgs::String& text) { echo.publish(text); }
int main(int argc, char** argv) {
  ros::init(argc, argv, "cpp");
  ros::NodeHandle node;
  poses = node.advertise<never_seen::Pose>("/poses", 10, true);
  echo = node.advertise<std_msgs::String>("/echo", 1000);
  ros::Subscriber a = node.subscribe("/set_pose", 10, received), b = node.subscribe("/say", 1000, heard);
  never_seen::Pose pose; pose.name = "first"; pose.values[0] = 1.5; pose.values[1] = -2; pose.count = 1;
  poses.publish(pose);
  ros::spin();
}
"""


def build_node(folder: Path) -> str:
    """Compile the program of roscpp; returns its path."""
    registry = Registry(NOETIC)
    registry.add_text("string name\nfloat64[2] values\nint32 count\n", "never_seen/Pose")
    source, program = folder / "node.cpp", str(folder / "node")
    md5 = registry.message("never_seen/Pose").md5
    source.write_text(NODE_CPP.replace('"MD5"', f'"{md5}"'), encoding="utf-8")
    libraries = ("-lroscpp", "-lrosconsole", "-lroscpp_serialization", "-lrostime", "-lboost_system")
    subprocess.run(("g++", "-O0", "-o", program, str(source), *libraries), check=True, timeout=300)
    return program


async def test_every_standard_message_is_the_same_as_in_rospy(ros: Ros, graph: Ros1Graph) -> None:
    program = ros.program()
    sums: dict[str, str] = program.run(PROGRAM)
    assert len(sums) > 100
    assert {name: graph.registry.message(name).md5 for name in sums} == sums
    node = graph.participant("/checker")
    payloads: dict[str, Payload] = {}

    def keep(name: str, sample: Sample) -> None:
        payloads[name] = sample.payload.detach()

    for name in sums:
        node.subscribe(f"/from/{name}", partial(keep, name))
    await until(lambda: len(payloads) == len(sums), "a message did not come")
    for name, payload in payloads.items():
        expected = program.run(f"result = plain(sent[{name!r}])")
        assert json.loads(bytes(payload.json())) == expected, name
        again = Payload.from_value(payload.type, payload.value())
        node.advertise(f"/back/{name}", payload.type, LATCHED).publish(again)
    await until(lambda: program.run("result = len(back)") == len(sums), "a message did not come back")
    assert program.run("result = [name for name in sent if plain(sent[name]) != plain(back[name])]") == []


async def test_roscpp_with_a_package_that_nobody_else_has(ros: Ros, graph: Ros1Graph, tmp_path: Path) -> None:
    process = ros.start(await anyio.to_thread.run_sync(build_node, tmp_path))
    poses: list[tuple[str, list[float], int]] = []
    node = graph.node("checker")
    node.subscribe("/poses", lambda each: poses.append((each.name, list(each.values), each.count)))
    await until(lambda: poses == [("first", [1.5, -2.0], 1)])
    node.advertise("/set_pose", "never_seen/Pose", latch=True).publish(
        {"name": "set", "values": [0, 3], "count": 4}
    )
    await until(lambda: poses[1:] == [("set", [0.0, 3.0], 5)])
    texts: list[str] = []
    node.subscribe("/echo", lambda each: texts.append(each.data), "std_msgs/String")
    publisher = node.advertise("/say", "std_msgs/String")
    await until(lambda: publisher.subscriber_count == 1)

    def is_connected() -> bool:
        publisher.publish({"data": "probe"})
        return bool(texts)

    await until(is_connected)
    for number in range(200):
        publisher.publish({"data": str(number)})
    await until(lambda: "199" in texts)
    assert [text for text in texts if text != "probe"] == [str(number) for number in range(200)]
    assert process.poll() is None
