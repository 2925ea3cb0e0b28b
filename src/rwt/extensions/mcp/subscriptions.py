"""Resource subscriptions: agents are notified when a topic has new messages."""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable, Sequence
from typing import TYPE_CHECKING, Any, Final

import anyio
import mcp_types as types
from mcp.server.subscriptions import InMemorySubscriptionBus, ListenHandler, ResourceUpdated
from mcp.shared.exceptions import MCPError

from rwt.access.errors import AccessError
from rwt.extensions.mcp.errors import ToolError
from rwt_participant.errors import RobotError

if TYPE_CHECKING:
    from anyio.abc import TaskGroup, TaskStatus
    from mcp.server.context import ServerRequestContext

    from rwt.extensions.mcp.agent import Host

    Context = ServerRequestContext[TaskGroup, Any]

logger = logging.getLogger(__name__)

TOPICS: Final = "robot://topics/"
"""Start of the URIs that agents can subscribe to."""

#: Minimum interval between two notifications about one topic, in seconds.
_INTERVAL_SECONDS: Final = 1.0

#: Maximum number of topics of one session or stream.
_MAX_TOPICS: Final = 16

Tell = Callable[[str], Awaitable[None]]
"""Notifies the agent that the resource of a URI has changed."""


class ResourceSubscriptions:
    """Handlers of the requests for subscriptions, of sessions and of streams (since 2026-07-28)."""

    def __init__(self, host: Host) -> None:
        self._host = host

    async def subscribe(self, context: Context, params: types.SubscribeRequestParams) -> types.EmptyResult:
        """Notify a session of new messages until it unsubscribes or ends."""
        # The SDK has no public hook for the end of a session.
        connection, uri = context.session._connection, str(params.uri)
        scopes: dict[str, anyio.CancelScope] = connection.state.setdefault("subscriptions", {})
        if uri not in scopes or scopes[uri].cancel_called:
            _check_number([*scopes, uri])
            scopes[uri] = await self._start(context, uri, context.session.send_resource_updated)
            connection.exit_stack.callback(scopes[uri].cancel)
        return types.EmptyResult()

    async def unsubscribe(
        self, context: Context, params: types.UnsubscribeRequestParams
    ) -> types.EmptyResult:
        """End a subscription of a session; no-op for one that does not exist."""
        scope = context.session._connection.state.get("subscriptions", {}).pop(str(params.uri), None)
        if scope is not None:
            scope.cancel()
        return types.EmptyResult()

    async def listen(
        self, context: Context, params: types.SubscriptionsListenRequestParams
    ) -> types.SubscriptionsListenResult:
        """Notify a stream of new messages until it ends."""
        bus = InMemorySubscriptionBus()
        uris = list(dict.fromkeys(params.notifications.resource_subscriptions or ()))
        _check_number(uris)
        scopes: dict[str, anyio.CancelScope] = {}
        try:
            for uri in uris:
                scopes[uri] = await self._start(context, uri, lambda uri: bus.publish(ResourceUpdated(uri)))
            return await ListenHandler(bus)(context, params)
        finally:
            for scope in scopes.values():
                scope.cancel()

    async def _start(self, context: Context, uri: str, tell: Tell) -> anyio.CancelScope:
        self._host.note(context, f"subscribe to {uri}", acts=False)
        try:
            scope: anyio.CancelScope = await context.lifespan_context.start(self._run, context, uri, tell)
        except (ToolError, RobotError, AccessError) as error:
            raise MCPError(types.INVALID_PARAMS, str(error)) from None
        return scope

    async def _run(
        self, context: Context, uri: str, tell: Tell, *, task_status: TaskStatus[anyio.CancelScope]
    ) -> None:
        is_started = False
        try:
            with anyio.CancelScope() as scope:
                async with self._host.agent(context, lasts=True) as agent:
                    topic = _topic_of(uri)
                    type = (await agent.robot.type_of(topic)).name
                    # An event cannot be cleared, so the callback sets the current one of this list.
                    has_new = [anyio.Event()]
                    async with agent.robot.subscribe(topic, lambda _: has_new[0].set(), type):
                        is_started = True
                        task_status.started(scope)
                        while True:
                            await has_new[0].wait()
                            has_new[0] = anyio.Event()
                            # A message that arrives from here on causes a further notification.
                            await tell(uri)
                            await anyio.sleep(_INTERVAL_SECONDS)
        except (ToolError, RobotError, AccessError) as error:
            if not is_started:
                raise
            scope.cancel()  # Marks it as ended: the agent may subscribe again.
            logger.info("the subscription to %s has ended: %s", uri, error)


def _topic_of(uri: str) -> str:
    topic = uri.removeprefix(TOPICS)
    if topic == uri or not topic:
        raise ToolError(f"{uri[:200]!r} cannot be subscribed to; topics can, as {TOPICS}odom")
    return f"/{topic}"


def _check_number(uris: Sequence[str]) -> None:
    if len(uris) > _MAX_TOPICS:
        raise MCPError(types.INVALID_PARAMS, f"{len(uris)} subscriptions; the limit is {_MAX_TOPICS}")
