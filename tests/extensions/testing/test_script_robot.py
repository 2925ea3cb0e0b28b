"""Robot scripted in TOML, on virtual time."""

from __future__ import annotations

from pathlib import Path

import pytest

from rwt.extensions.testing import Faults, ObservedGraph
from rwt.extensions.testing.script.file import FaultScript
from rwt.extensions.testing.script.robot import inject
from rwt.extensions.testing.virtual_time import advance, settle
from rwt.extensions.testing.wire.faults import FaultAction
from rwt_graph import Node, SimulatedClock
from rwt_participant.errors import GoalRejected, ServiceFailed
from rwt_participant.goals import GoalStatus
from tests.extensions.testing.conftest import play

pytestmark = pytest.mark.anyio


def heard(graph: ObservedGraph, topic: str, clock: SimulatedClock) -> list[tuple[float, int]]:
    seen: list[tuple[float, int]] = []
    node = Node(graph, "listener")
    node.subscribe(topic, lambda m: seen.append((clock.monotonic(), m.data)), "std_msgs/Int32")
    return seen


async def test_recorded_messages_in_the_script_and_in_a_file(
    tmp_path: Path, graph: ObservedGraph, clock: SimulatedClock
) -> None:
    (tmp_path / "b.jsonl").write_text('{"at": 1, "msg": {"data": 1}}\n{"at": 2, "msg": {"data": 2}}\n')
    async with graph:
        inline, filed = heard(graph, "/a", clock), heard(graph, "/b", clock)
        play(
            graph,
            tmp_path / "robot.toml",
            """
            [topics."/a"]
            type = "std_msgs/Int32"
            recorded = [{ at = 0.5, msg = { data = 7 } }, { at = 1.5, msg = { data = 8 } }]
            [topics."/b"]
            type = "std_msgs/Int32"
            file = "b.jsonl"
            repeat = true
            """,
        )
        await advance(clock, 4.5)
        assert inline == [(0.5, 7), (1.5, 8)]
        assert filed == [(1.0, 1), (2.0, 2), (3.0, 1), (4.0, 2)]


async def test_a_sequence_that_is_not_repeated(
    tmp_path: Path, graph: ObservedGraph, clock: SimulatedClock
) -> None:
    async with graph:
        seen = heard(graph, "/a", clock)
        text = '[topics."/a"]\ntype = "std_msgs/Int32"\nmessages = [{data = 1}, {data = 2}]\nrate = 2\n'
        play(graph, tmp_path / "robot.toml", text + "repeat = false")
        await advance(clock, 9.0)
        assert seen == [(0.0, 1), (0.5, 2)]


async def test_the_first_case_that_matches_answers(tmp_path: Path, graph: ObservedGraph) -> None:
    async with graph:
        play(
            graph,
            tmp_path / "robot.toml",
            """
            [services."/add"]
            type = "example_interfaces/AddTwoInts"
            when = [
              { request = { a = 1, b = 1 }, returns = { sum = 2 } },
              { request = { a = 1 }, returns = [{ sum = 10 }, { sum = 11 }] },
            ]
            """,
        )
        caller = Node(graph, "caller")
        assert (await caller.call("/add", {"a": 1, "b": 1})).sum == 2
        assert [(await caller.call("/add", {"a": 1})).sum for _ in range(3)] == [10, 11, 11]
        with pytest.raises(ServiceFailed, match="none of its cases"):
            await caller.call("/add", {"a": 2})


@pytest.mark.parametrize(
    ("end", "status"),
    [
        ("succeeds = { sequence = [1] }\nafter = 2", GoalStatus.SUCCEEDED),
        ("aborts = { sequence = [1] }\nafter = 2", GoalStatus.ABORTED),
        ("", GoalStatus.SUCCEEDED),
    ],
)
async def test_goals_end_as_the_script_says(
    tmp_path: Path, graph: ObservedGraph, clock: SimulatedClock, end: str, status: GoalStatus
) -> None:
    async with graph:
        play(
            graph, tmp_path / "robot.toml", f'[actions."/fib"]\ntype = "example_interfaces/Fibonacci"\n{end}'
        )
        goal = await Node(graph, "client").send_goal("/fib")
        await advance(clock, 2.0 if end else 0.0)
        ended, result = await goal.result()
        assert (ended, list(result.sequence)) == (status, [1] if end else [])


async def test_goals_that_are_rejected_or_go_on(tmp_path: Path, graph: ObservedGraph) -> None:
    async with graph:
        play(
            graph,
            tmp_path / "robot.toml",
            """
            [actions."/no"]
            type = "example_interfaces/Fibonacci"
            rejects = "not today"
            [actions."/long"]
            type = "example_interfaces/Fibonacci"
            never_ends = true
            """,
        )
        client = Node(graph, "client")
        with pytest.raises(GoalRejected, match="not today"):
            await client.send_goal("/no")
        goal = await client.send_goal("/long")
        await settle()
        assert goal.status is GoalStatus.EXECUTING
        goal.cancel()
        assert (await goal.result())[0] is GoalStatus.CANCELED


@pytest.mark.parametrize(
    ("script", "action"),
    [
        (FaultScript(drop="/x"), FaultAction(0, 0.0, "(dropped by a fault)")),
        (FaultScript(delay="/x", seconds=2.0), FaultAction(1, 2.0, "(delayed by 2 s)")),
        (FaultScript(duplicate="/x", copies=3), FaultAction(3, 0.0, "(3 times)")),
        (FaultScript(drop="/x", op="advertise"), FaultAction()),
        (FaultScript(drop="/x", to="server"), FaultAction()),
        (FaultScript(drop="/x", every=2), FaultAction()),
        (FaultScript(drop="/x", count=0), FaultAction()),
        (FaultScript(drop="/y"), FaultAction()),
    ],
)
def test_faults_of_a_script(script: FaultScript, action: FaultAction) -> None:
    faults = Faults(lambda code, reason: 0)
    inject(faults, (script,))
    assert faults.action_for("client", [("publish", "/x")]) == action


def test_refusals_and_slow_readers_of_a_script() -> None:
    faults = Faults(lambda code, reason: 0)
    inject(faults, (FaultScript(refuse=429, count=1), FaultScript(slow_reader=5.0)))
    assert (faults.refusal(), faults.refusal(), faults.read_rate) == (429, None, 5.0)
