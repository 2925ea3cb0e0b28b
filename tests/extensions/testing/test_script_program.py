"""Scripts in Python: what they may be, and what is said of those that are none."""

from __future__ import annotations

import logging
import sys
from pathlib import Path

import pytest

from rwt.extensions.testing import ObservedGraph, ObservedWire, ScriptError
from rwt.extensions.testing.script.control import ScriptControl
from rwt.extensions.testing.virtual_time import advance, settle
from rwt_graph import Node, SimulatedClock
from tests.extensions.testing.conftest import play


@pytest.fixture(autouse=True)
def own_path(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", sys.path[:])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("def robott(node): pass", ": expected a function `def robot(robot):`, plain or async; did you mean"),
        ("robot = 3", ": expected a function `def robot(robot):`, plain or async"),
        ("x = 1\n1 / 0", ":2: ZeroDivisionError: division by zero"),
        ("def robot(node):\n    node.nothing", ":2: AttributeError: "),
        ("def robot(", ": SyntaxError: "),
        ("import nowhere_to_be_found", ":1: ModuleNotFoundError: "),
        (
            "def robot(robot):\n    robot.publishes('/x', 'std_msgs/Int32', {'data': ''})",
            ":2: ScriptError: /x (std_msgs/Int32): data: expected",
        ),
    ],
)
def test_the_file_and_the_line_are_named(tmp_path: Path, graph: ObservedGraph, text: str, said: str) -> None:
    file = tmp_path / "robot.py"
    nodes = {node.name for node in graph.nodes()}
    with pytest.raises(ScriptError) as raised:
        play(graph, file, text)
    assert str(raised.value).startswith(f"{file}{said}")
    assert {node.name for node in graph.nodes()} == nodes, "nothing is left of it"


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("robot.json", "expected a script whose name ends in .toml or .py"),
        ("robot.py", "no such Python file"),
        ("robot.toml", "No such file or directory"),
    ],
)
def test_a_file_that_is_none(tmp_path: Path, graph: ObservedGraph, name: str, said: str) -> None:
    file = tmp_path / name
    with pytest.raises(ScriptError) as raised:
        ScriptControl(graph, ObservedWire(graph), file)
    assert str(raised.value) == f"{file}: {said}"


COUNTING = """
async def robot(robot):
    count = robot.publishes("/count", "std_msgs/Int32")
    number = 0
    while True:
        number += 1
        count.publish({"data": number})
        await robot.clock.sleep(1.0)
"""


@pytest.mark.anyio
async def test_a_robot_that_cannot_begin_anew_says_why(tmp_path: Path, graph: ObservedGraph) -> None:
    text = "times = []\ndef robot(node):\n    times.append(1)\n    1 / (2 - len(times))\n"
    async with graph:
        control, listener = play(graph, tmp_path / "robot.py", text), Node(graph, "listener")
        answer = await listener.call("/rwt_script/reset")
        assert not answer.success
        assert ":4: ZeroDivisionError" in answer.message
        assert (await listener.call("/rwt_script/reset")).success
        control.close()


@pytest.mark.anyio
async def test_reset_ends_a_coroutine_and_begins_anew(
    tmp_path: Path, graph: ObservedGraph, clock: SimulatedClock
) -> None:
    async with graph:
        seen: list[int] = []
        listener = Node(graph, "listener")
        listener.subscribe("/count", lambda message: seen.append(message.data), "std_msgs/Int32")
        play(graph, tmp_path / "robot.py", COUNTING)
        await advance(clock, 2.0)
        await listener.call("/rwt_script/reset")
        await advance(clock, 1.0)
        assert seen == [1, 2, 3, 1, 2]


@pytest.mark.anyio
async def test_a_coroutine_that_fails_is_logged_with_its_line(
    tmp_path: Path, graph: ObservedGraph, caplog: pytest.LogCaptureFixture
) -> None:
    async with graph:
        play(graph, tmp_path / "robot.py", "async def robot(robot):\n    raise ValueError('no')")
        await settle()
    errors = [record for record in caplog.records if record.levelno == logging.ERROR]
    assert [record.getMessage() for record in errors] == [f"{tmp_path / 'robot.py'}:2: ValueError: no"]
