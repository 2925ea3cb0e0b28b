"""Services of this process on ROS 2, and calls of services in other processes."""

from __future__ import annotations

import logging
from collections import Counter, deque
from collections.abc import Callable, Hashable, Iterable
from functools import partial
from itertools import count
from typing import TYPE_CHECKING, NamedTuple

from rwt.extensions.ros2.connection import Connection, now
from rwt.extensions.ros2.type_supports.installed import NotInstalled
from rwt.extensions.ros2.wakeups import Inbox
from rwt_graph.api import OnReply, PendingCall, ServiceInfo
from rwt_graph.backend import (
    MemoryCall,
    MemoryProvider,
    NodeResources,
    OfferedServices,
    PerNode,
    RemoteServiceTable,
    Services,
)
from rwt_graph.errors import Ros2Error
from rwt_graph.problems import Problems
from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.payload import Payload
from rwt_interfaces.serialise.unpack import compile_decoder
from rwt_interfaces.serialise.wire_rules import FOLLOWED_CDR
from rwt_participant.errors import CallFailed

if TYPE_CHECKING:
    from rwt.extensions.ros2.rcl import RequestId
    from rwt.extensions.ros2.type_supports.calls import RawCall
    from rwt.extensions.ros2.type_supports.described_types import DescribedTypes
    from rwt_graph.clock import Clock
    from rwt_participant.timers import Timer

logger = logging.getLogger(__name__)

#: Maximum unanswered requests of other processes to one service.
_MOST_OPEN = 1000

#: Maximum unanswered requests to a service of another process: the depth of ROS 2's services by default. A
#: service loses the requests above its depth, and their callers would wait for ever.
_MOST_SENT = 10

#: Seconds without an answer, after which a service is sent more requests in spite of that.
_STALLED_SECONDS = 2.0

#: End of a problem's text.
DEFINITION_ADVICE = "give its definition with --interfaces DIR"

#: Seconds between two looks at a service that is known, but not connected yet.
_CONNECT_SECONDS = 0.02


class FoundService(NamedTuple):
    """Service of a node of another process, as ROS 2 reports it.

    Attributes:
        request_hash, response_hash: `RIHS01_…` of the two messages; empty if the other process does not
            announce them.
    """

    node: str
    name: str
    type_name: str
    request_hash: str
    response_hash: str


class Server:
    """Service of one provider of this process."""

    def __init__(self, connection: Connection, provider: MemoryProvider, services: Services) -> None:
        self._connection = connection
        self._provider = provider
        self._services = services
        self._raw = raw = connection.service(provider.owner, provider.name, provider.type)
        self._decode = compile_decoder(provider.type.request, FOLLOWED_CDR)
        self._inbox: Inbox[RawCall | Ros2Error] = Inbox(
            connection.wakeups, "service", raw.endpoint, raw.take, self._serve
        )
        self._names = (provider.owner.name, provider.name)
        connection.own_services[self._names] = float("inf")
        self._callers = NodeResources("/_remote", private=True)

    def _serve(self, request: RawCall | Ros2Error) -> None:
        provider = self._provider
        if isinstance(request, Ros2Error):
            logger.warning("%s", request)
            return
        if len(provider.open) >= _MOST_OPEN:
            logger.warning("a request to %s is dropped: %d are unanswered", provider.name, _MOST_OPEN)
            return
        try:
            payload = Payload(provider.type.request, self._decode(request.data))
        except InvalidMessage as error:
            logger.warning("a request to %s from another process is dropped: %s", provider.name, error)
            return
        self._services.call(provider.name, payload, partial(self._answer, request.id), None, self._callers)

    def _answer(self, request_id: RequestId, answer: Payload | CallFailed) -> None:
        if isinstance(answer, CallFailed):
            # ROS 2's services have no errors: the caller's timeout is its answer.
            logger.warning(
                "a call of %s from another process is not answered: %s", self._provider.name, answer
            )
        elif not self._inbox.is_closed:
            self._raw.answer(request_id, answer.cdr())

    def close(self) -> None:
        """Take no more requests."""
        self._inbox.close()
        self._connection.own_services[self._names] = now()


class Client:
    """Client of one node for one service of other processes.

    Requests wait here until the service is connected and has answered earlier ones.
    """

    def __init__(self, connection: Connection, owner: NodeResources, info: ServiceInfo, clock: Clock) -> None:
        self._clock = clock
        self._response = info.type.response
        self._raw = raw = connection.client(owner, info.name, info.type)
        self._decode = compile_decoder(self._response, FOLLOWED_CDR)
        self._inbox: Inbox[RawCall | Ros2Error] = Inbox(
            connection.wakeups, "client", raw.endpoint, raw.take, self._on_response
        )
        self._waiting: deque[MemoryCall] = deque()
        # Open calls by number; those that count as the service's load are in `_load`.
        self._sent: dict[int, MemoryCall] = {}
        self._load: set[int] = set()
        self._answers = 0
        self._timer: Timer | None = None

    def ask(self, call: MemoryCall) -> None:
        """Send a request, now or later."""
        self._waiting.append(call)
        self.send_waiting()

    def send_waiting(self) -> None:
        """Send the requests that the service can take."""
        delay = _STALLED_SECONDS
        while self._waiting and len(self._load) < _MOST_SENT:
            if not self._raw.endpoint.service_server_is_available():
                delay = _CONNECT_SECONDS
                break
            call = self._waiting.popleft()
            if not call.done:
                self._send(call)
        if self._waiting and self._timer is None:
            self._answers = 0
            self._timer = self._clock.call_later(delay, self._look_again)

    def _look_again(self) -> None:
        self._timer = None
        if not self._answers:
            self._load.clear()
        self.send_waiting()

    def _send(self, call: MemoryCall) -> None:
        try:
            number = self._raw.send(call.request.cdr())
        except Ros2Error as error:
            call.end_with(CallFailed(str(error)))
            return
        self._sent[number] = call
        self._load.add(number)
        call.on_end = partial(self._ended, number)

    def _ended(self, number: int) -> None:
        del self._sent[number]
        self._load.discard(number)
        self.send_waiting()

    def _on_response(self, received: RawCall | Ros2Error) -> None:
        self._answers += 1
        if isinstance(received, Ros2Error):
            logger.warning("%s", received)  # Of an unknown call, which ends by its timeout.
            return
        # A call that has ended is no longer there; so is one that another provider has answered.
        call = self._sent.get(received.id.number)
        if call is None:
            return
        try:
            response = Payload(self._response, self._decode(received.data))
        except InvalidMessage as error:
            call.fail(f"the answer of {call.service} is not a {self._response.name}: {error}")
        else:
            call.reply(response)

    def close(self) -> None:
        """Send and receive nothing more; the calls have ended, or end later without an answer."""
        if self._timer is not None:
            self._timer.cancel()
        self._waiting.clear()
        self._inbox.close()


class Ros2Services(OfferedServices[Connection]):
    """Offers the services of this process to ROS 2, and calls those of others."""

    def __init__(self, services: Services, types: DescribedTypes, clock: Clock, problems: Problems) -> None:
        super().__init__(services)
        self._clock = clock
        self._clients: PerNode[Client] = PerNode(Client.close)
        self._found: frozenset[FoundService] = frozenset()
        # Number of nodes by name, and the providers of services whose node was started again, oldest first.
        self._nodes: Counter[str] = Counter()
        self._providers: dict[FoundService, deque[Hashable]] = {}
        self._numbers = count()
        self._remote: RemoteServiceTable[None] = RemoteServiceTable(services)
        self.info, self.names, self.by_node = self._remote.info, self._remote.names, self._remote.by_node
        self._types = types
        self._problems = problems

    def close(self) -> None:
        """Close every endpoint; open calls end."""
        self._nodes.clear()
        self._providers.clear()
        self._remote.close()
        for identity in tuple(self._clients.made):
            self._clients.close(*identity)
        for withdraw in self._offers.values():
            withdraw()
        super().close()

    def _offer(self, connection: Connection, provider: MemoryProvider) -> Callable[[], object] | None:
        try:
            return Server(connection, provider, self._services).close
        except NotInstalled as error:
            connection.note_missing(provider.name, error)
        except Ros2Error as error:
            logger.warning("%s is only for clients of this server: %s", provider.name, error)
        return None

    # Services of other processes

    def apply(self, found: Iterable[FoundService]) -> None:
        """Adapt the services of other processes to a reading of the graph."""
        found = frozenset(found)
        for key in sorted(found - self._found):
            type = self._types.service(key.type_name, key.request_hash, key.response_hash)
            if type is not None:
                self._remote.found(key, ServiceInfo(key.name, type, key.node), None)
            else:
                self._report(key)
        for key in self._found - found:
            self._problems.forget(key.name)
            for provider in self._providers.pop(key, (key,)):
                self._remote.lost(provider, key.name)
        self._found = found
        for identity, client in tuple(self._clients.made.items()):
            if self._remote.get(identity[1]) is None:
                self._clients.close(*identity)
            else:
                client.send_waiting()

    def follow_nodes(self, nodes: Counter[str]) -> None:
        """Adapt the providers to the number of nodes by name; called before :meth:`apply`.

        A node that was killed is listed until its lease ends, beside the one that was started again. They are
        two providers of the same services, and the calls that only the first one has received end with it.
        """
        for node in self._nodes.keys() | nodes.keys():
            keys = [key for key in self._found if key.node == node]
            for _ in range(nodes[node] - max(self._nodes[node], 1)):
                self._restarted(keys)
            for _ in range(self._nodes[node] - max(nodes[node], 0)):
                self._left(keys, node)
        self._nodes = Counter(nodes)

    def _restarted(self, keys: Iterable[FoundService]) -> None:
        """Add another provider of each of these services."""
        for key in keys:
            service = self._remote.get(key.name)
            if service is not None:
                providers = self._providers.setdefault(key, deque[Hashable]((key,)))
                providers.append((key, next(self._numbers)))
                self._remote.found(providers[-1], service.first[0], None)

    def _left(self, keys: Iterable[FoundService], node: str) -> None:
        """Remove the oldest provider of each of these services."""
        for key in keys:
            providers = self._providers.get(key, deque[Hashable]((key,)))
            self._remote.lost(providers.popleft(), key.name, node)
            if not providers:
                self._providers.pop(key, None)

    def _report(self, service: FoundService) -> None:
        name = service.type_name
        is_known = self._types.service(name, "", "") is not None
        what = (
            f"its node defines {name} otherwise than this server" if is_known else f"{name} is not known here"
        )
        self._problems.report(
            service.name,
            f"{service.name} cannot be called: {what}, and ROS 2 describes no services to others; "
            f"{DEFINITION_ADVICE}",
        )

    def forget_client(self, owner: NodeResources, name: str) -> None:
        """Close the client of a node for a service, which is not called soon; no-op without."""
        self._clients.close(owner, name)

    def call(
        self, name: str, request: Payload, on_reply: OnReply, timeout: float | None, caller: NodeResources
    ) -> PendingCall | None:
        service, connection = self._remote.get(name), self._connection
        if service is None or connection is None:
            return None
        call, info = MemoryCall(name, request, on_reply), service.first[0]
        try:
            client = self._clients.get(caller, name, lambda: Client(connection, caller, info, self._clock))
        except Ros2Error as error:
            call.end_with(CallFailed(f"Service {name} cannot be called: {error}"))
            return call
        call.wait(service.open, caller, self._services.deadlines, timeout)
        client.ask(call)
        return call
