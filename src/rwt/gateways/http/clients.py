"""Who asks: the graph as all HTTP clients of one role and address may use it together, as long as they do."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Generator, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from rwt.gateways.http import problems
from rwt_transports.endpoint import PeerInfo
from rwt_transports.errors import Refused
from rwt_transports.http.routes import HttpResponse
from rwt_transports.limits import network_of

if TYPE_CHECKING:
    from rwt.access.access import Access
    from rwt.access.client_graph import ClientGraph
    from rwt.access.graph_view import GraphView
    from rwt.access.quotas import Work
    from rwt.access.roles import Role
    from rwt.delivery.shared_graph import SharedGraph
    from rwt_participant.timers import Timer
    from rwt_transports.http.routes import HttpRequest

T = TypeVar("T")

Handler = Callable[["HttpRequest", "GraphView"], HttpResponse | Awaitable[HttpResponse]]


class Stream(Protocol):
    """An answer without end."""

    def allowed(self, graph: ClientGraph) -> bool:
        """Whether the role that its client has now may see it."""

    def end(self) -> None:
        """End it."""


class HttpClient:
    """What clients of one role and address hold together.

    A request holds it while it is answered, and so do streams and goals: quotas count for all of them. Since
    nobody says goodbye over HTTP, it goes some seconds after its last request, and what it published on, and
    its leases at the gate, with it.

    Attributes:
        graph: the graph as they may see it.
        address: theirs.
        streams: that are open, each with the request that began it.
    """

    __slots__ = ("_clients", "_holds", "_key", "_timer", "address", "graph", "streams")

    def __init__(self, clients: Clients, key: tuple[str, str], graph: ClientGraph, address: str) -> None:
        self._clients = clients
        self._key = key
        self._holds = 0
        self._timer: Timer | None = None
        self.graph = graph
        self.address = address
        self.streams: dict[Stream, PeerInfo] = {}

    def hold(self) -> None:
        """Let it be there until :meth:`release`."""
        self._holds += 1
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def release(self) -> None:
        """Hold it no longer; after a while without holds it gives everything back."""
        self._holds -= 1
        if not self._holds:
            self._timer = self.graph.clock.call_later(self._clients.linger, self.leave)

    def leave(self) -> None:
        """Give everything back."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self._clients.forget(self._key)
        self.graph.close()

    def add_stream(self, stream: Stream, request: HttpRequest) -> None:
        """Keep a stream that has begun."""
        self.hold()
        self.streams[stream] = peer_of(request)

    def discard_stream(self, stream: Stream) -> None:
        """Forget a stream that has ended; a second call does nothing."""
        if self.streams.pop(stream, None) is not None:
            self.release()


class Clients:
    """All clients of the gateway.

    Attributes:
        linger: seconds that a client is there after its last request.

    Args:
        access: who may do what.
        shared: the gateway's part in the graph.
        linger: see above.
    """

    def __init__(self, access: Access, shared: SharedGraph, linger: float) -> None:
        self._access = access
        self._shared = shared
        self._count = 0
        self.linger = linger
        self._known: dict[tuple[str, str], HttpClient] = {}

    @property
    def streams(self) -> int:
        """How many answers without end there are."""
        return sum(len(client.streams) for client in self._known.values())

    @contextmanager
    def client_of(self, request: HttpRequest, reader: GraphView) -> Iterator[HttpClient]:
        """The client that a request comes from, held for the block."""
        client = self._find(request, reader.role)
        client.hold()
        try:
            yield client
        finally:
            client.release()

    def _find(self, request: HttpRequest, role: Role) -> HttpClient:
        key = (role.name, network_of(request.address))
        client = self._known.get(key)
        if client is None:
            self._count += 1
            self._shared.counters.clients += 1
            self._shared.counters.present += 1
            graph = self._access.client(self._shared, role, request.address, f"http:{self._count}")
            client = self._known[key] = HttpClient(self, key, graph, request.address)
        return client

    def forget(self, key: tuple[str, str]) -> None:
        """Forget a client that leaves."""
        if self._known.pop(key, None) is not None:
            self._shared.counters.present -= 1

    def reload_roles(self) -> None:
        """Let each client act as the settings say now, and end the streams that they do not allow."""
        admission = self._access.admission
        for (name, _), client in tuple(self._known.items()):
            client.hold()
            role = admission.roles.get(name)
            if role is not None:
                client.graph.take_role(role)
                client.graph.withdraw_refused()
            for stream, info in tuple(client.streams.items()):
                if role is None or not self._still_has(info, name) or not stream.allowed(client.graph):
                    stream.end()
            client.release()

    def _still_has(self, info: PeerInfo, role: str) -> bool:
        try:
            return self._access.admission.role_now(info, None).name == role
        except Refused:
            return False

    def close(self) -> None:
        """End every stream, and let every client go."""
        for client in tuple(self._known.values()):
            for stream in tuple(client.streams):
                stream.end()
            client.leave()


def peer_of(request: HttpRequest) -> PeerInfo:
    """A request as admission knows connections."""
    target = f"{request.path}?{request.query}" if request.query else request.path
    return PeerInfo("http", request.address, 0, target, request.headers)


class _Measured(Awaitable[T]):
    """An awaitable whose work is counted, step by step, as what a reader has caused."""

    __slots__ = ("_awaitable", "_monotonic", "_work")

    def __init__(self, awaitable: Awaitable[T], work: Work, monotonic: Callable[[], float]) -> None:
        self._awaitable = awaitable
        self._work = work
        self._monotonic = monotonic

    def __await__(self) -> Generator[Any, Any, T]:
        steps = self._awaitable.__await__()
        step: Callable[[], Any] = lambda: next(steps)  # noqa: E731 - the others are made in the loop
        while True:
            began = self._monotonic()
            try:
                waited_for = step()
            except StopIteration as end:
                result: T = end.value
                return result
            finally:
                self._work.add(self._monotonic() - began, "pages")
            try:
                sent = yield waited_for
            except BaseException as error:
                step = _thrown(steps, error)
            else:
                step = _sent(steps, sent)


def _thrown(steps: Any, error: BaseException) -> Callable[[], Any]:
    return lambda: steps.throw(error)


def _sent(steps: Any, value: object) -> Callable[[], Any]:
    return lambda: next(steps) if value is None else steps.send(value)


def page(handler: Handler) -> Handler:
    """A handler as a route's page: what it raises that is its client's to know becomes a problem, in this one
    place, and what it works after it has waited is counted, too."""

    def answer(request: HttpRequest, reader: GraphView) -> HttpResponse | Awaitable[HttpResponse]:
        try:
            answered = handler(request, reader)
        except problems.REFUSALS as error:
            return problems.answer(request, problems.problem_of(error))
        if isinstance(answered, HttpResponse):
            return answered
        return _answered(request, reader, answered)

    return answer


async def _answered(
    request: HttpRequest, reader: GraphView, awaitable: Awaitable[HttpResponse]
) -> HttpResponse:
    try:
        return await _Measured(awaitable, reader.work, reader.clock.monotonic)
    except problems.REFUSALS as error:
        return problems.answer(request, problems.problem_of(error))
