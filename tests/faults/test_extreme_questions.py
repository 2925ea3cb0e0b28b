"""Every service of rosapi and of parameters is asked with extreme names, texts and numbers in each of its
fields: each question has one answer, which is no internal error, and leaves the graph as it was."""

from __future__ import annotations

import os
from typing import Any, Final, NamedTuple

import anyio
import anyio.lowlevel
import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rwt import Settings
from rwt.access.access import Access
from rwt.rosapi import DISCLOSURES, Rosapi
from rwt.rosbridge import Bridge
from rwt_graph import MemoryGraph, Node
from rwt_interfaces import Registry
from rwt_interfaces.distro import DISTROS
from rwt_interfaces.payload import Payload
from tests.core.rosbridge.recording_client import Client
from tests.faults.server_log import Failures

FEW: Final = 60
EXAMPLES: Final = int(os.environ.get("SWEEP_EXAMPLES", FEW))
"""Clients, each of which asks several questions; `make fuzz` asks for more."""

NUMBERS: Final = (0, 1, -1, 4, 9, 10, 255, 256, 2**31, 2**53 + 1, 2**63 - 1, -(2**63), 2**63, 2**64, 10**400)
REALS: Final = (0.0, -0.0, 1.5, 1e308, -1e308, 5e-324)

NAMES: Final = (
    "", "/", "//", "~", "~x", ":", "a:", ":a", "a:b:c", "/robot", "/robot/", "/robot:speed", "/robot/speed",
    "/robot:text", "robot:speed", "speed", "/label", "label", "/label/", "/count", "/count/_action/status",
    "/add", "add/", "/image", "/rosapi", "/rosapi/topics", "/nothing", "/nothing:x", "*", "/*", "[a-", "{}",
    "$(x)", "%s", "{0}", "\0", "a\nb", "\x1b[31m", "\ud7ff", "\U0001f916", "\u202e", " ", "a b", ".", "..",
    "/../..", "x" * 300, "/a" * 3000, "a." * 3000, "use_sim_time", "robot_description", "/robot_description",
    "qos_overrides./tf.publisher.depth", "std_msgs/String", "std_msgs/msg/String", "String", "std_msgs/",
    "/String", "a/b/c/d", "std_msgs/msg/String[]", "std_srvs/srv/SetBool", "sensor_msgs/msg/PointCloud2",
    "example_interfaces/action/Fibonacci", "example_interfaces/Fibonacci_Feedback", "time",
    "builtin_interfaces/Time",
)  # fmt: skip
"""Where names, types and texts are expected."""

VALUES: Final = (
    "", "null", "true", "0", "-0", "1.5", "1e400", "-1e400", "NaN", "Infinity", "1" * 5000, "2e1000",
    "9223372036854775807", "9223372036854775808", '"x"', '"\\ud800"', '"\\u0000"', "[]", "[1,2]", "[1,true]",
    "[[1]]", "[1.5,2]", '["a"]', "{}", '{"a":1}', '{"a":{"":[{}]},"/":2}', '{"a/b":1}', "[" * 5000,
    "[" * 40 + "]" * 40, '{"a":' * 40 + "1" + "}" * 40, "not json", "\ufeff1", "1 2", "'x'", "[1,]",
    "{'a':1}",
)  # fmt: skip
"""Where JSON is expected."""


class Question(NamedTuple):
    """A service and its arguments."""

    service: str
    args: Any


def _robot(graph: MemoryGraph) -> Node:
    node = Node(graph, "robot")
    node.advertise("/label", "std_msgs/String", latch=True).publish({"data": "x"})
    node.subscribe("/image", lambda message: None, "sensor_msgs/Image")
    node.advertise_service("/add", "example_interfaces/AddTwoInts", lambda asked: {"sum": 1})

    async def count(goal: Any) -> dict[str, Any]:
        return {"sequence": []}

    node.advertise_action("/count", "example_interfaces/Fibonacci", count)
    for name, default in (("speed", 1.5), ("text", "x"), ("whole", 1), ("octets", b"x"), ("list", [1.0])):
        node.parameters.declare(name, default)
    return node


def _services(distro: str) -> dict[str, Any]:
    """The fields, with their defaults, that each service of rosapi and of parameters is asked with."""
    graph = MemoryGraph(Registry(DISTROS[distro]))
    Rosapi(graph)
    _robot(graph)
    package = "/robot/" if distro == "jazzy" else "/rosapi/"
    return {
        info.name: msgspec.to_builtins(Payload.from_value(info.type.request, {}).value())
        for info in graph.services()
        if info.name.startswith(("/rosapi/", package))
    }


SERVICES: Final = {distro: _services(distro) for distro in ("jazzy", "noetic")}

_texts = st.sampled_from(NAMES) | st.sampled_from(VALUES)
_wholes = st.sampled_from(NUMBERS)
_values = st.fixed_dictionaries(
    {"type": st.integers(0, 12)},
    optional={
        "bool_value": st.booleans(),
        "integer_value": _wholes,
        "double_value": st.sampled_from(REALS),
        "string_value": _texts,
        "byte_array_value": st.lists(_wholes, max_size=2),
        "integer_array_value": st.lists(_wholes, max_size=2),
        "double_array_value": st.lists(st.sampled_from(REALS), max_size=2),
        "string_array_value": st.lists(_texts, max_size=2),
    },
)
_parameters = st.fixed_dictionaries({"name": st.sampled_from(NAMES)}, optional={"value": _values})
_odd = st.none() | st.booleans() | _wholes | st.sampled_from(REALS) | _texts | st.lists(_texts, max_size=2)


def _field(name: str, default: Any) -> st.SearchStrategy[Any]:
    match default:
        case str():
            likely: st.SearchStrategy[Any] = st.sampled_from(VALUES if name == "value" else NAMES)
        case list():
            likely = st.lists(_parameters if name == "parameters" else st.sampled_from(NAMES), max_size=3)
        case _:
            likely = _wholes
    return st.one_of(likely, likely, likely, _odd)


def _questions(distro: str) -> st.SearchStrategy[list[Question]]:
    def ask(service: str) -> st.SearchStrategy[Question]:
        fields = {name: _field(name, default) for name, default in SERVICES[distro][service].items()}
        by_name = st.fixed_dictionaries({}, optional=fields)
        return st.one_of(by_name, by_name, by_name, st.lists(_odd, max_size=3), _odd).map(
            lambda args: Question(service, args)
        )

    return st.lists(st.sampled_from(sorted(SERVICES[distro])).flatmap(ask), min_size=5, max_size=15)


async def _ask(distro: str, questions: list[Question]) -> None:
    graph = MemoryGraph(Registry(DISTROS[distro]))
    async with graph:
        with Rosapi(graph):
            _robot(graph)
            given = Settings.model_validate({"distro": distro})
            client = Client(Bridge(graph, given, Access(graph, given, DISCLOSURES)))
            before = graph.topics(), graph.services(), graph.actions(), graph.nodes()
            for number, question in enumerate(questions):
                client.say("call_service", id=number, service=question.service, args=question.args)
                answers = client.heard()
                turns = 0
                while turns < 3 or (not answers and turns < 1000):  # A second answer would come in these.
                    await anyio.lowlevel.checkpoint()
                    answers += client.heard()
                    turns += 1
                heard = [(each["op"], each["id"]) for each in answers]
                assert heard == [("service_response", number)], (question, answers)
                assert "internal error" not in str(answers), (question, answers)
            assert (graph.topics(), graph.services(), graph.actions(), graph.nodes()) == before, questions


@pytest.mark.parametrize("distro", SERVICES)
def test_every_question_has_one_answer_and_leaves_nothing(distro: str) -> None:
    @settings(max_examples=EXAMPLES, derandomize=EXAMPLES == FEW)
    @given(questions=_questions(distro))
    def ask(questions: list[Question]) -> None:
        with Failures() as failures:
            anyio.run(_ask, distro, questions)
            failures.check()

    ask()
