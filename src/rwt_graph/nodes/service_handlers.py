"""Service handlers of a program as callbacks of the graph, and awaitable calls."""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable
from functools import partial
from typing import TypeAlias

from rwt_graph.accounts import hold_for_asker
from rwt_graph.api import Graph, ServiceCall
from rwt_interfaces.structs import MessageType
from rwt_participant.errors import ServiceFailed
from rwt_participant.messages import (
    MessageLike,
    ServiceHandler,
    call_handler,
    is_coroutine_function,
)

logger = logging.getLogger(__name__)

Answer: TypeAlias = "MessageLike | Awaitable[MessageLike | None] | None"


def failure_text(error: Exception) -> str:
    """Return the reason that a caller receives for an exception."""
    return str(error) or type(error).__name__


class ServiceFunction:
    """Handler of a service as a callback of the graph; its exceptions are the caller's :exc:`ServiceFailed`.

    A plain handler runs on the graph's thread and blocks it: slow work belongs in an `async def` handler,
    code that blocks in a thread (`threaded=True`). Each call of a coroutine handler is a task; calls may
    overlap.
    """

    def __init__(self, graph: Graph, service: str, response: MessageType, handler: ServiceHandler) -> None:
        self._graph = graph
        self._service = service
        self._response = response
        self._handler = handler
        self._is_coroutine = is_coroutine_function(handler)

    def __call__(self, call: ServiceCall) -> None:
        # Read now: the request may be a view of a receive buffer that is reused after this returns.
        request = call.request.value()
        if self._is_coroutine and not self._graph.running:
            call.fail(f"service {self._service} has a coroutine handler, and the graph is not running")
            return
        call_handler(
            self._handler,
            request,
            self._response,
            call.reply,
            partial(self._fail, call),
            self._spawn,
            self._graph.clock.time_ns,
        )

    def _spawn(self, finish: Callable[[], Awaitable[None]]) -> None:
        # The task keeps the request, even if its caller no longer waits for the answer.
        release = hold_for_asker(0)

        async def run() -> None:
            try:
                await finish()
            finally:
                release()

        self._graph.spawn(run, f"service {self._service}")

    def _fail(self, call: ServiceCall, error: Exception) -> None:
        if not isinstance(error, ServiceFailed):
            logger.error("service %s failed", self._service, exc_info=error)
        call.fail(failure_text(error))
