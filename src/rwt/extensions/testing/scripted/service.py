"""Scripted service: its responses, and the requests it received."""

from __future__ import annotations

from collections.abc import Callable

import anyio

from rwt.extensions.testing.errors import check_messages
from rwt.extensions.testing.journal import Journal, Kind, Received
from rwt.extensions.testing.matching import Matching, mismatch
from rwt_graph.clock import Clock
from rwt_graph.nodes.service_handlers import Answer
from rwt_interfaces.structs import ServiceType
from rwt_participant.errors import ServiceFailed
from rwt_participant.messages import Message, MessageLike, ServiceHandler, to_payload


class Case:
    """Responses of a service to matching requests. Each method returns the service.

    Raises:
        ScriptError: the requests have no such field.
    """

    def __init__(self, service: ScriptedService, request: Matching) -> None:
        if request is not None and not callable(request):
            mismatch(service.type.request.struct(), request)  # raises for a field that does not exist
        self._service = service
        self._request = request

    def returns(self, *responses: MessageLike | None, after: float = 0.0) -> ScriptedService:
        """Return these responses, one per call; the last one repeats.

        Args:
            after: delay of each response, in seconds of the robot's clock.

        Raises:
            ScriptError: a response does not fit the service type.
        """
        for response in responses:
            self._service.check(response)
        left = list(responses or (None,))

        def answer(request: Message) -> Answer:
            response = left.pop(0) if len(left) > 1 else left[0]
            return response if after <= 0 else self._service.later(after, lambda: response)

        return self.calls(answer)

    def raises(self, reason: str, after: float = 0.0) -> ScriptedService:
        """Fail with a reason."""

        def fail() -> MessageLike | None:
            raise ServiceFailed(reason)

        return self.calls(lambda request: fail() if after <= 0 else self._service.later(after, fail))

    def calls(self, function: ServiceHandler) -> ScriptedService:
        """Answer with a plain or coroutine function of the request."""
        handlers = self._service.handlers
        if self._request is None:
            handlers[:] = [*(each for each in handlers if each[0] is not None), (None, function)]
        else:
            handlers.insert(0, (self._request, function))
        return self._service

    def never_answers(self) -> ScriptedService:
        """Leave callers waiting until their timeout or the end of the graph."""
        return self.calls(lambda request: anyio.sleep_forever())


class ScriptedService(Case):
    """Service of a scripted robot. The last script wins; each method returns the service.

    Attributes:
        name: absolute name.
        handlers: requests with their answers. The first match answers: the newest case before older ones, and
            the answer to all requests last.
    """

    def __init__(self, name: str, interface: ServiceType, clock: Clock, journal: Journal) -> None:
        self.name = name
        self.type = interface
        self.handlers: list[tuple[Matching, ServiceHandler]] = []
        self._clock = clock
        self._journal = journal
        super().__init__(self, None)

    @property
    def requests(self) -> list[Message]:
        """Received requests, oldest first."""
        return [entry.message for entry in self._journal.of(Kind.CALL, self.name)]

    def when(self, request: Matching) -> Case:
        """Script the answer to matching requests, for example ``.when({"a": 1}).returns({"sum": 1})``.

        Raises:
            ScriptError: the request has no such field.
        """
        return Case(self, request)

    def handle(self, request: Message) -> Answer:
        """Record a request and answer it. Called on the graph's thread."""
        payload = to_payload(self.type.request, request, self._clock.time_ns)
        self._journal.add(Received(Kind.CALL, self.name, payload, "", self._clock.time_ns()))
        for wanted, handler in self.handlers:
            if not mismatch(request, wanted):
                return handler(request)
        known = "none of its cases matches this request" if self.handlers else "nothing was scripted for it"
        raise ServiceFailed(f"{self.name} has no answer: {known}")

    async def later(self, after: float, answer: Callable[[], MessageLike | None]) -> MessageLike | None:
        """Answer after `after` seconds of the robot's clock."""
        await self._clock.sleep(after)
        return answer()

    def check(self, response: MessageLike | None) -> None:
        """Raise :exc:`ScriptError` if a response does not fit the service type."""
        check_messages(self.type.response, (response,), self._clock.time_ns, self.name)
