"""Messages of all standard types, value by value against those of rospy and roscpp."""

from __future__ import annotations

import json
from functools import partial
from typing import TYPE_CHECKING, Final

import pytest

from rwt_graph.api import Sample
from rwt_interfaces.payload import Payload
from rwt_participant.qos import LATCHED
from tests.extensions.ros1.live.relay import UNSEEN_TYPES
from tests.waiting import until

if TYPE_CHECKING:
    from rwt.extensions.ros1 import Ros1Graph
    from tests.extensions.ros1.live.conftest import Ros
    from tests.extensions.ros1.live.relay import Relay

pytestmark = pytest.mark.anyio

#: Publishes a random message of each type, and compares what comes back.
PROGRAM: Final = """
import importlib, random, genpy
source = random.Random(7)
largest_bits = globals().get('largest_bits', 64)
classes = {}
for package in '''
    actionlib actionlib_msgs diagnostic_msgs dynamic_reconfigure geometry_msgs map_msgs move_base_msgs
    nav_msgs pcl_msgs roscpp rosgraph_msgs sensor_msgs shape_msgs std_msgs stereo_msgs tf2_msgs
    trajectory_msgs unseen_msgs visualization_msgs
'''.split():
    try:
        module = importlib.import_module(package + '.msg')
    except ImportError:
        continue
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
        bits = min(largest_bits, {'byte': 8, 'char': 8}.get(base) or int(base.strip('uint')))
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


async def test_every_standard_message_is_the_same_as_in_rospy(ros: Ros, graph: Ros1Graph) -> None:
    program = ros.program()
    sums: dict[str, str] = program.run(PROGRAM)
    assert len(sums) > 100
    node = graph.participant("/checker")
    payloads: dict[str, Payload] = {}

    def keep(name: str, sample: Sample) -> None:
        payloads[name] = sample.payload.detach()

    for name in sums:
        node.subscribe(f"/from/{name}", partial(keep, name))
    await until(lambda: len(payloads) == len(sums), "a message did not come")
    assert {name: payload.type.md5 for name, payload in payloads.items()} == sums
    for name, payload in payloads.items():
        expected = program.run(f"result = plain(sent[{name!r}])")
        assert json.loads(bytes(payload.json())) == expected, name
        again = Payload.from_value(payload.type, payload.value())
        node.advertise(f"/back/{name}", payload.type, LATCHED).publish(again)
    await until(lambda: program.run("result = len(back)") == len(sums), "a message did not come back")
    assert program.run("result = [name for name in sent if plain(sent[name]) != plain(back[name])]") == []


@pytest.mark.timeout(600)
async def test_roscpp_receives_and_sends_every_message_in_order(
    ros: Ros, graph: Ros1Graph, relay: Relay
) -> None:
    process = ros.start(relay.program)
    name = UNSEEN_TYPES[0]
    node = graph.node("checker")
    numbers: list[int] = []
    node.subscribe(f"/cpp/{name}", lambda each: numbers.append(each.large))
    await until(lambda: graph.topic(f"/cpp/{name}").type is not None)  # type: ignore[union-attr]  # subscribed
    publisher = node.advertise(f"/back/{name}", name)

    def is_connected() -> bool:
        publisher.publish({"large": -1})
        return bool(numbers)

    await until(is_connected)
    for number in range(200):
        publisher.publish({"text": str(number), "pair": [0.5, number], "large": number})
    await until(lambda: 199 in numbers)
    assert [number for number in numbers if number >= 0] == [*range(200)]
    assert process.poll() is None
