"""A scripted service: its responses, and what it received."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from functools import partial
from typing import TYPE_CHECKING

import anyio

from rwt_graph.program.service_handlers import Answer, ServiceHandler
from rwt_program.errors import ServiceFailed
from rwt_program.messages import Message, MessageLike, to_payload
from rwt_testing.errors import ScriptError
from rwt_testing.journal import Kind, Received
from rwt_testing.matching import Matching, mismatch

if TYPE_CHECKING:
    from rwt_graph.clock import Clock
    from rwt_interfaces.structs import ServiceType
    from rwt_testing.journal import Journal


class ScriptedService:
    """One service of a scripted robot. What is said last counts; each method gives the service again.

    Attributes:
        name: absolute name.
        type: its interface.
    """

    def __init__(self, name: str, interface: ServiceType, clock: Clock, journal: Journal) -> None:
        self.name = name
        self.type = interface
        self._clock = clock
        self._journal = journal
        self._rules: list[tuple[Matching, ServiceHandler]] = []
        self._otherwise: ServiceHandler = self._unscripted

    @property
    def requests(self) -> list[Message]:
        """The requests that came so far, oldest first."""
        return [entry.message for entry in self._journal.of(Kind.CALL, self.name)]

    def when(self, request: Matching) -> Case:
        """The answer to requests with these fields only, for example ``.when({"a": 1}).returns({"sum": 1})``.

        Raises:
            ScriptError: the request has no such field.
        """
        return Case(self, request)

    def returns(self, *responses: MessageLike | None, after: float = 0.0) -> ScriptedService:
        """Answer with these, one call after the other; the last is for all further calls.

        Args:
            after: seconds of the robot's clock that each answer takes.

        Raises:
            ScriptError: one does not fit the service's response.
        """
        return self.set(None, self.answering(responses, after))

    def raises(self, reason: str, after: float = 0.0) -> ScriptedService:
        """Fail, and say why."""
        return self.set(None, self.failing(reason, after))

    def calls(self, function: ServiceHandler) -> ScriptedService:
        """Answer with what a plain or coroutine function makes of the request."""
        return self.set(None, function)

    def never_answers(self) -> ScriptedService:
        """Leave every caller waiting, until its own timeout or the end of the graph."""
        return self.set(None, _silence)

    def set(self, request: Matching, handler: ServiceHandler) -> ScriptedService:
        """Let `handler` answer the requests that match; of several cases the one said last wins."""
        if request is None:
            self._otherwise = handler
        else:
            self._rules.insert(0, (request, handler))
        return self

    def answering(self, responses: tuple[MessageLike | None, ...], after: float) -> ServiceHandler:
        """A handler that gives these answers in turn."""
        for response in responses:
            self._check(response)
        left = list(responses or (None,))

        def answer(request: Message) -> Answer:
            response = left.pop(0) if len(left) > 1 else left[0]
            return response if after <= 0 else self._later(after, lambda: response)

        return answer

    def failing(self, reason: str, after: float) -> ServiceHandler:
        """A handler that fails."""

        def fail() -> MessageLike | None:
            raise ServiceFailed(reason)

        return lambda request: fail() if after <= 0 else self._later(after, fail)

    def handle(self, request: Message) -> Answer:
        """Note one request and answer it. Called on the graph's thread."""
        payload = to_payload(self.type.request, request, self._clock.time_ns)
        self._journal.add(Received(Kind.CALL, self.name, payload, "", self._clock.time_ns()))
        for wanted, handler in self._rules:
            if not mismatch(request, wanted):
                return handler(request)
        return self._otherwise(request)

    async def _later(self, after: float, answer: Callable[[], MessageLike | None]) -> MessageLike | None:
        await self._clock.sleep(after)
        return answer()

    def _check(self, response: MessageLike | None) -> None:
        try:
            to_payload(self.type.response, {} if response is None else response, self._clock.time_ns)
        except ValueError as error:
            raise ScriptError(f"{self.name} ({self.type.name}) cannot answer so: {error}") from None

    def _unscripted(self, request: Message) -> Answer:
        known = "none of its cases matches this request" if self._rules else "nothing was scripted for it"
        raise ServiceFailed(f"{self.name} has no answer: {known}")


class Case:
    """The answer to some requests; see :meth:`ScriptedService.when`. Each method gives the service again."""

    def __init__(self, service: ScriptedService, request: Matching) -> None:
        if request is not None and not callable(request):
            mismatch(service.type.request.struct(), request)  # raises for a field that does not exist
        self._say: Callable[[ServiceHandler], ScriptedService] = partial(service.set, request)
        self._service = service

    def returns(self, *responses: MessageLike | None, after: float = 0.0) -> ScriptedService:
        """As :meth:`ScriptedService.returns`."""
        return self._say(self._service.answering(responses, after))

    def raises(self, reason: str, after: float = 0.0) -> ScriptedService:
        """As :meth:`ScriptedService.raises`."""
        return self._say(self._service.failing(reason, after))

    def calls(self, function: ServiceHandler) -> ScriptedService:
        """As :meth:`ScriptedService.calls`."""
        return self._say(function)

    def never_answers(self) -> ScriptedService:
        """As :meth:`ScriptedService.never_answers`."""
        return self._say(_silence)


def _silence(request: Message) -> Awaitable[None]:
    return anyio.sleep_forever()


__all__ = ["Case", "ScriptedService"]
