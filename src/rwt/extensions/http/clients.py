"""HTTP clients: requests of one session, or program, share one view of the graph, and their quotas."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable, Hashable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Final
from urllib.parse import unquote

import anyio

from rwt.access.client_graph import ClientGraph
from rwt.access.errors import QuotaExceeded
from rwt.access.graph_view import STOP, GraphView, canonical
from rwt.access.roles import Role
from rwt.extensions.http import problems
from rwt.extensions.http.events import EventQueue, event
from rwt.extensions.http.representations import EVENTS
from rwt.gateways.base import Gateway
from rwt.gateways.visitors import Metered, Visitor, Visitors, peer_of
from rwt_transports.endpoint import DropReason, PeerInfo
from rwt_transports.errors import Refused
from rwt_transports.http.addresses import network_of
from rwt_transports.http.routes import HttpRequest, HttpResponse
from rwt_transports.shared_pool import PoolFull, PoolRow, Share, SharedPool

Handler = Callable[["HttpRequest", "GraphView"], HttpResponse | Awaitable[HttpResponse]]


STREAMS: Final = PoolRow("event streams and long polls", "api.streams", "event streams and waiting requests")

SESSION: Final = "RWT-Session"
"""Header with the name that a program chooses, to distinguish it from others with its token and address."""

MAX_SESSIONS: Final = 32
"""Maximum number of clients of one role, credential and address at a time; further programs without a session
count as one.
"""

_is_session: Final = re.compile(r"[\w-]{1,64}", re.ASCII).fullmatch


def names_stop(request: HttpRequest) -> bool:
    """Return True for a request that may press the emergency stop: a call of its service, or a message."""
    if request.method != "POST" or "stop" not in request.path:
        return False
    kind, _, path = request.path.removeprefix("/api/").partition("/")
    return kind in ("services", "topics") and canonical(f"/{unquote(path).strip('/')}") == STOP


class ReaderStream(ABC):
    """Event stream of one reader, which ends when it is no longer `allowed`."""

    def __init__(
        self, client: HttpClient, depth: int, max_bytes: int, allowed: Callable[[ClientGraph], bool]
    ) -> None:
        self._client = client
        self._streams = client.streams_of_all
        self._share: Share | None = None
        self._dropped = 0
        self.allowed = allowed
        self.queue = EventQueue(depth, max_bytes, self._drop, self._close)

    def response(self, request: HttpRequest) -> HttpResponse:
        """Return the response with the stream, which holds the client.

        Raises:
            PoolFull: `api.streams` is reached.
        """
        try:
            self._share = self._streams.take(self._client.graph.holder, self._displace)
        except PoolFull:
            self.queue.close()
            raise
        self._client.add_stream(self, request)
        headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
        return HttpResponse(self.queue, 200, EVENTS, headers)

    @abstractmethod
    def _drop(self, reason: DropReason) -> None:
        """Count and report a dropped event."""

    def _displace(self, reason: str) -> None:
        """End the stream in favour of another client."""
        self.queue.close(event({"reason": reason}, "ended"))

    def _close(self) -> None:
        if self._share is not None:
            self._streams.release(self._share)
        self._client.discard_stream(self)


class HttpClient(Visitor):
    """Client over HTTP, with the life cycle of a :class:`Visitor`.

    Requests of one credential, role and address are of one client if they have the same session
    (:data:`SESSION`), or none and the same `User-Agent`.

    When the client leaves, its publishers and leases are released.

    Attributes:
        streams: open streams, each with the request that began it.
        streams_of_all: pool of the open streams, and of the requests that wait, of all clients.
    """

    __slots__ = ("graph", "streams", "streams_of_all")

    def __init__(self, clients: Clients, key: Hashable, graph: ClientGraph) -> None:
        super().__init__(clients, key)
        self.graph = graph
        self.streams_of_all = clients.streams_of_all
        self.streams: dict[ReaderStream, PeerInfo] = {}

    def leave(self) -> None:
        """Release everything."""
        super().leave()
        self.graph.close()

    def add_stream(self, stream: ReaderStream, request: HttpRequest) -> None:
        """Add a stream, which holds the client."""
        self.hold()
        self.streams[stream] = peer_of(request)

    def discard_stream(self, stream: ReaderStream) -> None:
        """Remove a stream that has ended; a second call is a no-op."""
        if self.streams.pop(stream, None) is not None:
            self.release()


class Clients(Visitors[HttpClient]):
    """All clients of the gateway.

    Attributes:
        streams_of_all: pool of the open streams, and of the requests that wait.

    Args:
        streams: capacity of that pool (`api.streams`).
    """

    def __init__(self, gateway: Gateway, linger: float, streams: int) -> None:
        self.streams_of_all = SharedPool(STREAMS, streams)
        super().__init__(gateway.shared.counters, gateway.shared.graph.clock, linger)
        self._gateway = gateway
        self._count = 0

    @property
    def streams(self) -> int:
        """Number of open streams."""
        return sum(len(client.streams) for client in self.present)

    @contextmanager
    def client_of(self, request: HttpRequest, reader: GraphView) -> Iterator[HttpClient]:
        """Return the client that sent a request, held for the block."""
        role, address = reader.role, request.address

        def make(clients: Visitors[HttpClient], key: Hashable) -> HttpClient:
            self._count += 1
            gateway = self._gateway
            name, agent = f"{gateway.name}:{self._count}", request.headers.get("user-agent", "")
            graph = gateway.access.client(gateway.shared, role, address, name, agent)
            return HttpClient(self, key, graph)

        client = self.find(self._key_of(request, (role.name, role.credential, network_of(address))), make)
        client.hold()
        try:
            yield client
        finally:
            client.release()

    @contextmanager
    def waiting(self, client: HttpClient) -> Iterator[None]:
        """Count a request that waits within the block.

        Raises:
            PoolFull: `api.streams` is reached; also at the end of the block, if it was ended in favour of
                another client.
        """
        reasons: list[str] = []
        with anyio.CancelScope() as scope:

            def displace(reason: str) -> None:
                reasons.append(reason)
                scope.cancel()

            share = self.streams_of_all.take(client.graph.holder, displace)
            try:
                yield
            finally:
                self.streams_of_all.release(share)
        if scope.cancelled_caught:
            raise PoolFull(reasons[0])

    def _key_of(self, request: HttpRequest, owner: tuple[str, str, str]) -> Hashable:
        """Return the identity of a client among those of its owner: its session, or else its program.

        Raises:
            HttpProblem: the session has another form.
            QuotaExceeded: there are too many sessions.
        """
        session = request.headers.get(SESSION.lower())
        shared = (owner, None, "")
        if names_stop(request):
            return shared  # A stop is never rejected, and it needs no client of its own.
        if session is not None and not _is_session(session):
            raise problems.HttpProblem(
                "invalid-request", f"{SESSION}: expected 1 to 64 letters, digits, `-` and `_`", where=SESSION
            )
        # The header tells programs apart that have the same token: two browsers, or a browser and curl.
        program = request.headers.get("user-agent", "")[:200] if session is None else ""
        key = (owner, session, program)
        if key in self or sum(known[0] == owner for known in self.keys) < MAX_SESSIONS:
            return key
        # A chosen session is a promise of a client of its own; without one, sharing is fine.
        if session is not None:
            raise QuotaExceeded(f"{MAX_SESSIONS} clients of this credential and address, which is the limit")
        return shared

    def reload_roles(self) -> None:
        """Apply the current roles of the settings, and end what they do not allow."""
        admission = self._gateway.access.admission
        for client in self.present:
            client.hold()  # Hold the client: ending its last stream must not remove it meanwhile.
            name = client.graph.role.name
            role = admission.roles.get(name)
            if role is not None:
                client.graph.take_role(role.given_by(client.graph.role.credential))
                client.graph.withdraw_refused()
            for stream, info in tuple(client.streams.items()):
                if (
                    role is None
                    or not self._still_has(info, client.graph.role)
                    or not stream.allowed(client.graph)
                ):
                    stream.queue.close()
            client.release()

    def _still_has(self, info: PeerInfo, role: Role) -> bool:
        try:
            # By the request that began the stream: its token may have been withdrawn.
            now = self._gateway.access.admission.role_now(info, None)
            return (now.name, now.credential) == (role.name, role.credential)
        except Refused:
            return False

    def close(self) -> None:
        """End every stream, and let every client leave."""
        # Streams first: each holds its client.
        for client in self.present:
            for stream in tuple(client.streams):
                stream.queue.close()
        super().close()


def page(handler: Handler) -> Handler:
    """Return a handler as the page of a route; only here do errors become problem documents."""

    def answer(request: HttpRequest, reader: GraphView) -> HttpResponse | Awaitable[HttpResponse]:
        try:
            answered = handler(request, reader)
        except problems.REFUSALS as error:
            return problems.answer(request, problems.problem_of(error, reader))
        if isinstance(answered, HttpResponse):
            return answered
        return _answered(request, reader, answered)

    return answer


async def _answered(
    request: HttpRequest, reader: GraphView, awaitable: Awaitable[HttpResponse]
) -> HttpResponse:
    try:
        return await Metered(awaitable, partial(reader.work.add, kind="pages"), reader.clock.monotonic)
    except problems.CallWaits as waits:
        return waits.response
    except problems.REFUSALS as error:
        return problems.answer(request, problems.problem_of(error, reader))
