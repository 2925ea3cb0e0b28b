"""A person is asked before an agent acts, where that is wanted; a program that cannot ask is refused."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import anyio
import pytest
from mcp.client import Client
from mcp_types import CallToolResult, ElicitRequestFormParams, ElicitResult, InputRequiredResult

from rwt import Settings
from rwt.extensions.mcp.person import Questions
from rwt_client import connect
from tests.extensions.mcp.agents import Era, agent_at, agent_of_connection, done, refused, url_of
from tests.extensions.mcp.robots import SmallRobot, small_robot
from tests.waiting import until

pytestmark = [pytest.mark.anyio, pytest.mark.timeout(120)]

ASKED: dict[str, Any] = {"gateways": ["mcp"], "mcp": {"default_role": "admin", "confirm": ["/cmd_*"]}}
DRIVE: dict[str, Any] = {"topic": "/cmd_vel", "message": {"linear": {"x": 0.5}}}


class Person:
    """Answers as it was told to, and notes what it was asked."""

    def __init__(self, answer: ElicitResult) -> None:
        self.answer = answer
        self.questions: list[str] = []

    async def ask(self, _: object, params: object) -> ElicitResult:
        assert isinstance(params, ElicitRequestFormParams)
        self.questions.append(params.message)
        return self.answer


def yes() -> Person:
    return Person(ElicitResult(action="accept", content={"allow": True}))


@asynccontextmanager
async def asked(
    settings: dict[str, Any], era: Era = "auto", person: Person | None = None, token: str | None = None
) -> AsyncIterator[tuple[SmallRobot, Client]]:
    """A small robot and its agent, whose program can ask a person if there is one."""
    ask = None if person is None else person.ask
    async with (
        small_robot(Settings.model_validate(settings)) as (server, robot),
        agent_at(url_of(server), era, token, elicitation_callback=ask) as agent,
    ):
        yield robot, agent


NO = (
    ElicitResult(action="decline"),
    ElicitResult(action="cancel"),
    ElicitResult(action="accept", content={"allow": False}),
)


async def test_a_givenis_for_one_act(era: Era) -> None:
    person = yes()
    async with asked(ASKED, era, person) as (robot, agent):
        tool = {each.name: each for each in (await agent.list_tools()).tools}["publish"]
        known = {"topic", "message", "type", "seconds", "rate", "stop"}
        assert set(tool.input_schema["properties"]) == known  # The model sees nothing of the question.
        await done(agent, "publish", **DRIVE)
        await done(agent, "publish", **DRIVE)
        await done(agent, "set_parameter", name="/small_robot:speed", value=1.0)  # Not asked about.
    assert robot.heard == [0.5, 0.5]
    assert len(person.questions) == 2
    assert person.questions[0] == 'May the agent publish {"linear":{"x":0.5}} on /cmd_vel?'


@pytest.mark.parametrize("answer", NO, ids=["decline", "cancel", "accept without permission"])
async def test_without_permission_nothing_happens(era: Era, answer: ElicitResult) -> None:
    person = Person(answer)
    async with asked(ASKED, era, person) as (robot, agent):
        assert "the user declined" in await refused(agent, "publish", **DRIVE)
        assert robot.heard == [] and len(person.questions) == 1


async def test_a_program_that_cannot_ask_is_refused(era: Era) -> None:
    async with asked(ASKED, era) as (robot, agent):
        assert "your client cannot ask" in await refused(agent, "publish", **DRIVE)
        assert robot.heard == []


async def test_a_givencannot_be_used_again_or_for_something_else() -> None:
    async with small_robot(**ASKED) as (server, robot):
        async with agent_at(url_of(server), elicitation_callback=yes().ask) as agent:
            first = await agent.session.call_tool("publish", DRIVE, allow_input_required=True)
            assert isinstance(first, InputRequiredResult) and first.request_state
            answer: Any = {"permission": ElicitResult(action="accept", content={"allow": True})}
            faster = {**DRIVE, "message": {"linear": {"x": 5.0}}}
            again = await agent.session.call_tool(
                "publish", faster, input_responses=answer, request_state=first.request_state,
                allow_input_required=True,
            )  # fmt: skip
            assert isinstance(again, InputRequiredResult)  # Asked anew: it was about another message.
            for expected in (CallToolResult, InputRequiredResult):
                result = await agent.session.call_tool(
                    "publish", faster, input_responses=answer, request_state=again.request_state,
                    allow_input_required=True,
                )  # fmt: skip
                assert isinstance(result, expected)
            unasked = await agent.session.call_tool(
                "publish", DRIVE, input_responses=answer, request_state="made up", allow_input_required=True
            )
            assert isinstance(unasked, InputRequiredResult)
        assert robot.heard == [5.0]


async def test_the_command_asks_too() -> None:
    person = yes()
    async with small_robot() as (server, robot):
        async with agent_of_connection(server.urls[0], confirm=["/cmd_vel"]) as agent:
            assert "your client cannot ask" in await refused(agent, "publish", **DRIVE)
        async with agent_of_connection(server.urls[0], person=person.ask, confirm=["/cmd_vel"]) as agent:
            await done(agent, "publish", **DRIVE)
        assert robot.heard == [0.5] and len(person.questions) == 1


@pytest.mark.parametrize(
    ("owner", "tool", "arguments", "after", "fits"),
    [
        ("me", "publish", {"a": 1, "b": 2}, 0.0, True),
        ("me", "publish", {"b": 2, "a": 1}, 600.0, True),
        ("you", "publish", {"a": 1, "b": 2}, 0.0, False),
        ("me", "call_service", {"a": 1, "b": 2}, 0.0, False),
        ("me", "publish", {"a": 1, "b": 3}, 0.0, False),
        ("me", "publish", {"a": 1, "b": 2}, 601.0, False),
    ],
)
async def test_an_answer_is_for_what_was_asked(
    owner: str, tool: str, arguments: dict[str, object], after: float, fits: bool
) -> None:
    questions = Questions()
    question = frozenset({"May it?", "May it what?"})
    word = questions.ask(question, "me", "publish", {"a": 1, "b": 2}, 0.0)
    found = questions.answered(word, owner, tool, arguments, after)
    assert found == (question if fits else None)
    assert questions.answered(word, "me", "publish", {"a": 1, "b": 2}, 0.0) is None


async def test_questions_without_answers_are_bounded() -> None:
    questions, question = Questions(), frozenset({"May it?"})
    words = [questions.ask(question, "me", "publish", {}, 0.0) for _ in range(1000)]
    assert [questions.answered(word, "me", "publish", {}, 0.0) for word in words].count(question) == 256


GATED: dict[str, Any] = {
    "gateways": ["mcp"],
    "auth": {
        "default_role": "viewer",
        "tokens": {
            "pilot": {"token": "the-token-of-a-pilot", "role": "pilot"},
            "trainee": {"token": "the-token-of-a-trainee", "role": "trainee"},
        },
    },
    "roles": {
        name: {"subscribe": ["*"], "publish": ["/cmd_vel"], "call": ["/add"], "goals": ["/count"]}
        for name in ("pilot", "trainee")
    },
    "mcp": {"confirm": ["/add"]},
    "gate": {
        "rules": {
            "asked": {
                "topics": ["/cmd_vel"],
                "services": ["/add"],
                "actions": ["/count"],
                "approval": {"roles": ["pilot"], "seconds": 20, "remember_seconds": 60},
            }
        }
    },
}


async def test_the_user_grants_the_approval_that_the_gate_requires(era: Era) -> None:
    person = yes()
    async with asked(GATED, era, person, "the-token-of-a-pilot") as (robot, agent):
        await done(agent, "publish", **DRIVE, seconds=0.4)
        assert set(robot.heard) == {0.5, 0.0} and len(robot.heard) > 2
        assert len(person.questions) == 1 and "gate.rules.asked" in person.questions[0]
        ended = await done(agent, "send_goal", action="/count", goal={"order": 2})
        assert ended.startswith("the goal succeeded") and len(person.questions) == 2
        # Once for mcp.confirm, and once for the gate.
        answer = await done(agent, "call_service", service="/add", request={"a": 1, "b": 2})
        assert answer.startswith('{"sum":3}')
        assert len(person.questions) == 4


async def test_without_the_approval_that_the_gate_requires_nothing_happens(era: Era) -> None:
    for person, expected in ((None, "your client cannot ask"), (Person(NO[0]), "the user declined")):
        async with asked(GATED, era, person, "the-token-of-a-pilot") as (robot, agent):
            assert expected in await refused(agent, "publish", **DRIVE, seconds=0.2)
            assert expected in await refused(agent, "send_goal", action="/count", goal={"order": 2})
            assert robot.heard == [] and not robot.begun.is_set()


async def test_where_others_give_the_giventhe_agent_waits_for_it() -> None:
    person = yes()
    async with (
        small_robot(Settings.model_validate(GATED)) as (server, robot),
        agent_at(url_of(server), token="the-token-of-a-trainee", elicitation_callback=person.ask) as agent,
        connect(server.urls[0], headers={"Authorization": "Bearer the-token-of-a-pilot"}) as pilot,
    ):
        waiting: list[Any] = []

        def answer(message: Any) -> None:
            waiting.extend(message.approvals)

        await pilot.subscribe("/gate/approvals", answer, "rwt_gate_msgs/Approvals")
        async with anyio.create_task_group() as tasks:
            ended: list[str] = []

            async def count() -> None:
                ended.append(await done(agent, "send_goal", action="/count", goal={"order": 2}))

            tasks.start_soon(count)
            await until(lambda: bool(waiting))
            assert not robot.begun.is_set() and "mcp:" in waiting[0].client
            given = {"id": waiting[0].id, "approve": True}
            await pilot.call("/gate/approve", given, "rwt_gate_msgs/Approve")
        assert ended[0].startswith("the goal succeeded") and person.questions == []
        assert "publish" in await refused(agent, "publish", **DRIVE)
