"""Agents are notified of new messages, over sessions, streams and a connection to a robot elsewhere."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Any

import anyio
import pytest
from mcp.client.subscriptions import ResourceUpdated
from mcp.shared.exceptions import MCPError
from mcp_types import ResourceUpdatedNotification

from rwt import Settings
from tests.extensions.mcp.agents import agent_at, agent_of_connection, done, refused, url_of
from tests.extensions.mcp.robots import small_robot
from tests.extensions.mcp.test_gateway import GUARDED, GUEST, PILOT
from tests.waiting import until, until_answered

if TYPE_CHECKING:
    from rwt import Server

pytestmark = [
    pytest.mark.anyio,
    pytest.mark.timeout(120),
    # Sessions of older versions subscribe by requests that the newest version replaces.
    pytest.mark.filterwarnings("ignore::mcp.shared.exceptions.MCPDeprecationWarning"),
]

NUMBER = "robot://topics/number"


class Told:
    """Notifications that a client of a session received."""

    def __init__(self) -> None:
        self.uris: list[str] = []

    async def __call__(self, message: Any) -> None:
        if isinstance(message, ResourceUpdatedNotification):
            self.uris.append(str(message.params.uri))


def subscriptions(server: Server) -> int:
    """The number of subscribers of the topic, apart from the robot's own."""
    topic = server.graph.topic("/number")
    return 0 if topic is None else len(topic.subscribers)


@asynccontextmanager
async def session(server: Server, told: Told, token: str | None = None) -> AsyncIterator[Any]:
    async with agent_at(url_of(server), "legacy", token, message_handler=told) as agent:
        yield agent


async def test_a_session_is_told_until_it_unsubscribes() -> None:
    told = Told()
    async with small_robot() as (server, _), session(server, told) as agent:
        assert agent.server_capabilities.resources.subscribe
        await agent.subscribe_resource(NUMBER)
        await agent.subscribe_resource(NUMBER)
        await until(lambda: len(told.uris) >= 2)
        assert set(told.uris) == {NUMBER} and subscriptions(server) == 1
        await agent.unsubscribe_resource(NUMBER)
        await agent.unsubscribe_resource(NUMBER)
        await until(lambda: subscriptions(server) == 0)
        for wrong in ("robot://overview", "robot://topics/nought"):
            with pytest.raises(MCPError, match=r"cannot be subscribed to|there is no topic /nought"):
                await agent.subscribe_resource(wrong)


async def test_the_end_of_a_session_ends_its_subscriptions() -> None:
    async with small_robot() as (server, _):
        async with session(server, Told()) as agent:
            await agent.subscribe_resource(NUMBER)
            assert subscriptions(server) == 1
        await until(lambda: subscriptions(server) == 0)


async def test_a_stream_is_told_until_it_ends() -> None:
    async with small_robot() as (server, _), agent_at(url_of(server)) as agent:
        resources = agent.server_capabilities.resources
        assert resources is not None and resources.subscribe
        async with agent.listen(resource_subscriptions=[NUMBER]) as events:
            found = [await anext(events) for _ in range(2)]
        assert found == [ResourceUpdated(NUMBER)] * 2
        await until(lambda: subscriptions(server) == 0)
        with pytest.raises(MCPError, match="there is no topic /nought"):
            async with agent.listen(resource_subscriptions=["robot://topics/nought"]):
                pass


async def test_over_a_connection_to_a_robot_elsewhere() -> None:
    async with small_robot() as (server, _), agent_of_connection(server.urls[0]) as agent:
        with anyio.fail_after(30):
            async with agent.listen(resource_subscriptions=[NUMBER]) as events:
                assert await anext(events) == ResourceUpdated(NUMBER)
        await until(lambda: subscriptions(server) == 0)


async def test_only_topics_of_the_role_can_be_subscribed_to() -> None:
    async with small_robot(Settings.model_validate(GUARDED)) as (server, _):
        async with session(server, Told(), PILOT) as agent:
            await agent.subscribe_resource("robot://topics/battery")
            with pytest.raises(MCPError, match="there is no topic /status"):
                await agent.subscribe_resource("robot://topics/status")
        async with agent_at(url_of(server), token=GUEST) as agent:
            with pytest.raises(MCPError, match="there is no topic /battery"):
                async with agent.listen(resource_subscriptions=["robot://topics/battery"]):
                    pass


async def test_subscriptions_are_bounded_and_do_not_block_calls() -> None:
    settings = {"gateways": ["mcp"], "mcp": {"default_role": "admin", "requests_per_address": 3}}
    async with small_robot(Settings.model_validate(settings)) as (server, robot):
        for number in range(20):
            robot.node.advertise(f"/t{number}", "std_msgs/String")
        async with session(server, Told()) as agent:
            for number in range(3):
                await agent.subscribe_resource(f"robot://topics/t{number}")
            with pytest.raises(MCPError, match=r"you have 3 subscriptions \(mcp.requests_per_address\)"):
                await agent.subscribe_resource("robot://topics/t3")
            await agent.unsubscribe_resource("robot://topics/t0")
            await until(lambda: (it := server.graph.topic("/t0")) is not None and not it.subscribers)
            await agent.subscribe_resource("robot://topics/t3")
            assert await done(agent, "list_robot", kinds=["topics"])
        async with agent_at(url_of(server)) as agent:
            with pytest.raises(MCPError, match="17 subscriptions; the limit is 16"):
                async with agent.listen(resource_subscriptions=[f"robot://topics/t{n}" for n in range(17)]):
                    pass


async def test_a_subscription_ends_when_the_robot_gives_its_topic_another_type() -> None:
    async with small_robot() as (server, robot):
        clients = server.graph.participant("/rosbridge_websocket", for_clients=True)
        registry = server.graph.registry
        clients.advertise("/late", registry.message("std_msgs/String"))

        def subscribers() -> int:
            topic = server.graph.topic("/late")
            return 0 if topic is None else len(topic.subscribers)

        async with session(server, Told()) as agent:
            await agent.subscribe_resource("robot://topics/late")
            assert subscribers() == 1
            robot.node.advertise("/late", "std_msgs/Int32")
            await until(lambda: subscribers() == 0)
            # The agent may subscribe again, now with the robot's type.
            await until_answered(lambda: _subscribed(agent, subscribers))


async def _subscribed(agent: Any, subscribers: Callable[[], int]) -> bool:
    await agent.subscribe_resource("robot://topics/late")
    return subscribers() == 1


async def test_a_tool_that_waits_ends_when_the_robot_gives_its_topic_another_type() -> None:
    async with small_robot() as (server, robot), agent_at(url_of(server)) as agent:
        clients = server.graph.participant("/rosbridge_websocket", for_clients=True)
        clients.advertise("/late", server.graph.registry.message("std_msgs/String"))
        answers: list[str] = []

        async def read() -> None:
            answers.append(await refused(agent, "read_topic", topic="/late", timeout=50))

        async with anyio.create_task_group() as tasks:
            tasks.start_soon(read)
            await until(lambda: (it := server.graph.topic("/late")) is not None and it.subscribers)
            robot.node.advertise("/late", "std_msgs/Int32")
        (answer,) = answers
        assert "/late: the robot uses this topic with type std_msgs/msg/Int32" in answer
