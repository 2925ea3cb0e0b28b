"""A person is asked before an agent acts, where that is wanted; a program that cannot ask is refused."""

from __future__ import annotations

from typing import Any

import pytest
from mcp_types import CallToolResult, ElicitRequestFormParams, ElicitResult, InputRequiredResult

from rwt_mcp.approvals import Questions
from tests.mcp.agents import Era, agent_at, agent_of_connection, done, refused, url_of
from tests.mcp.robots import small_robot

pytestmark = [pytest.mark.anyio, pytest.mark.asyncio_only, pytest.mark.timeout(120)]

ASKED: dict[str, Any] = {"gateways": ["mcp"], "mcp": {"default_role": "admin", "confirm": ["/cmd_*"]}}
ERAS: tuple[Era, ...] = ("legacy", "auto")
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


NO = (
    ElicitResult(action="decline"),
    ElicitResult(action="cancel"),
    ElicitResult(action="accept", content={"allow": False}),
)


@pytest.mark.parametrize("era", ERAS)
async def test_a_yes_is_for_one_act(era: Era) -> None:
    person = yes()
    async with (
        small_robot(**ASKED) as (server, robot),
        agent_at(url_of(server), era, elicitation_callback=person.ask) as agent,
    ):
        tool = {each.name: each for each in (await agent.list_tools()).tools}["publish"]
        known = {"topic", "message", "type", "seconds", "rate", "stop"}
        assert set(tool.input_schema["properties"]) == known  # The model sees nothing of the question.
        await done(agent, "publish", **DRIVE)
        await done(agent, "publish", **DRIVE)
        await done(agent, "set_parameter", name="/small_robot:speed", value=1.0)  # Not asked about.
    assert robot.heard == [0.5, 0.5]
    assert len(person.questions) == 2
    assert person.questions[0] == 'May the agent publish {"linear":{"x":0.5}} on /cmd_vel?'


@pytest.mark.parametrize("era", ERAS)
@pytest.mark.parametrize("answer", NO, ids=["decline", "cancel", "accept without leave"])
async def test_without_a_yes_nothing_happens(era: Era, answer: ElicitResult) -> None:
    person = Person(answer)
    async with small_robot(**ASKED) as (server, robot):
        async with agent_at(url_of(server), era, elicitation_callback=person.ask) as agent:
            assert "the person did not allow it" in await refused(agent, "publish", **DRIVE)
        assert robot.heard == [] and len(person.questions) == 1
        assert server.graph.topic("/cmd_vel") is not None


@pytest.mark.parametrize("era", ERAS)
async def test_a_program_that_cannot_ask_is_refused(era: Era) -> None:
    async with small_robot(**ASKED) as (server, robot):
        async with agent_at(url_of(server), era) as agent:
            text = await refused(agent, "publish", **DRIVE)
            assert "this program cannot ask" in text and "mcp.confirm" in text
        assert robot.heard == []


async def test_a_yes_cannot_be_used_again_or_for_something_else() -> None:
    async with small_robot(**ASKED) as (server, robot):
        async with agent_at(url_of(server), elicitation_callback=yes().ask) as agent:
            first = await agent.session.call_tool("publish", DRIVE, allow_input_required=True)
            assert isinstance(first, InputRequiredResult) and first.request_state
            answer: Any = {"leave": ElicitResult(action="accept", content={"allow": True})}
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
            assert "this program cannot ask" in await refused(agent, "publish", **DRIVE)
        asked = agent_of_connection(server.urls[0], person=person.ask, confirm=["/cmd_vel"])
        async with asked as agent:
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
    word = questions.ask("me", "publish", {"a": 1, "b": 2}, 0.0)
    assert questions.answered(word, owner, tool, arguments, after) is fits
    assert not questions.answered(word, "me", "publish", {"a": 1, "b": 2}, 0.0)


async def test_questions_without_answers_are_bounded() -> None:
    questions = Questions()
    words = [questions.ask("me", "publish", {}, 0.0) for _ in range(1000)]
    assert [questions.answered(word, "me", "publish", {}, 0.0) for word in words].count(True) == 256
