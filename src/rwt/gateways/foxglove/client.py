"""One client of Foxglove's protocol: its frames in turn, and what it owns."""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable, Iterable, Iterator, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, Never, Protocol

from rwt.access.errors import AccessError
from rwt.access.quotas import RateLimit
from rwt.delivery.counters import UNKNOWN
from rwt.delivery.turns import TakesTurns
from rwt.gateways.foxglove.assets import Assets
from rwt.gateways.foxglove.catalogue import Connections
from rwt.gateways.foxglove.errors import FoxgloveError, NotPossible
from rwt.gateways.foxglove.parameters import Parameters
from rwt.gateways.foxglove.playback import PlaybackControl
from rwt.gateways.foxglove.publications import Publications
from rwt.gateways.foxglove.replies import Replies
from rwt.gateways.foxglove.services import Services
from rwt.gateways.foxglove.subscriptions import Subscriptions
from rwt.gateways.foxglove.wire import client_messages as said
from rwt.gateways.foxglove.wire.server_messages import Level
from rwt_participant.errors import RobotError
from rwt_transports.endpoint import FlowRules
from rwt_transports.errors import Refused
from rwt_transports.turns import CLIENT_SECONDS
from rwt_transports.websocket.close_codes import POLICY

if TYPE_CHECKING:
    from rwt.access.access import Access
    from rwt.access.client_graph import ClientGraph
    from rwt.gateways.foxglove.assets import Pages
    from rwt.gateways.foxglove.catalogue import Change, Listing
    from rwt.gateways.foxglove.settings import Bounds, FoxgloveSettings
    from rwt_graph.clock import Playback
    from rwt_protocol.frames import Frame
    from rwt_transports.endpoint import PeerInfo, Sink
    from rwt_transports.turns import Turns

_Waiting = Iterator[None] | tuple[bytes, bool]
"""What may wait: the rest of a message, or a frame that is not read."""

_MOST_REASONS: Final = 5
"""Refusals of one message, of many things, that a client is told; of the others it is told the number."""

_REFUSALS: Final = (RobotError, AccessError, FoxgloveError)


class Gateway(Protocol):
    """What the clients of one gateway share."""

    settings: FoxgloveSettings
    bounds: Bounds
    access: Access
    turns: Turns
    pages: Pages | None
    playback: Playback | None

    def spawn(self, task: Callable[[], Awaitable[None]], name: str) -> None:
        """Run a coroutine function."""

    def listing_of(self, client: FoxgloveClient) -> Listing:
        """What the client is shown."""
        ...

    def watched(self) -> None:
        """A client watches other parameters than before."""

    def left(self, client: FoxgloveClient) -> None:
        """A client has gone."""


class FoxgloveClient(TakesTurns[_Waiting]):
    """One client.

    Attributes:
        number: counts the clients of the gateway.
        info: what the transport knows of it.
        sink: its connection.
        messages: how many have come from it.
        graph: the graph as it may see it.
        listing: what it is shown.
        parameters: what it asks of parameters.
        connections: what it was told of who takes part in what; None where it has not asked.
    """

    def __init__(
        self, gateway: Gateway, number: int, sink: Sink, info: PeerInfo, graph: ClientGraph, listing: Listing
    ) -> None:
        super().__init__(gateway.turns, graph.work, graph.clock.monotonic)
        bounds = gateway.bounds
        self._gateway = gateway
        self.number = number
        self.info = info
        self.sink = sink
        self.messages = 0
        self.graph = graph
        self.listing = listing
        self.connections: Connections | None = None
        self._rate = (
            RateLimit(bounds.messages_per_second, bounds.messages_burst)
            if bounds.messages_per_second
            else None
        )
        self.replies = Replies(number, sink, bounds.message_bytes, gateway.access.audit, self._monotonic)
        self.subscriptions = Subscriptions(graph, self.replies)
        self.publications = Publications(graph, self.replies, bounds.structure)
        self.services = Services(graph, self.replies, bounds.structure, bounds.call_timeout)
        self.parameters = Parameters(graph, self.replies, gateway.settings.parameter_names, gateway.turns)
        self.assets = (
            None
            if gateway.pages is None
            else Assets(graph, self.replies, gateway.pages, gateway.settings, info.address)
        )
        self.playback = (
            None if gateway.playback is None else PlaybackControl(graph, self.replies, gateway.playback)
        )
        self._time = sink.flow("time", FlowRules(depth=1, notes=True))

    # -- what it says --------------------------------------------------------------------------------------

    def receive(self, data: bytes, binary: bool) -> None:
        """Take one frame from the wire, do what it asks for, and say what is refused; see
        :class:`rwt.delivery.turns.TakesTurns`."""
        if self._must_defer(self.sink.received, len(data)):
            self._wait((data if type(data) is bytes else bytes(data), binary))
            return
        now = self._began = self._monotonic()
        self._read(data, binary, now)
        self._worked += self._monotonic() - now
        if self._worked - self._counted > CLIENT_SECONDS:
            self._count_work()

    def _take_up(self, what: _Waiting, now: float) -> None:
        if isinstance(what, tuple):
            data, binary = what
            self._read(data, binary, now)
        else:
            self._run(what)

    def _read(self, data: bytes, binary: bool, now: float) -> None:
        self.messages += 1
        if self._rate is not None and not self._rate.take(now):
            self._rate_exceeded()
            return
        op = UNKNOWN
        try:
            message = said.parse_binary(data) if binary else said.parse_text(data)
            op = type(message).__name__
            steps = _HANDLERS[type(message)](self, message)  # type: ignore[arg-type]  # each has its own row
        except Exception as error:
            self.failed(op, error)
        else:
            if steps is not None:
                self._run(_refusing(self, op, steps))

    def _run(self, steps: Iterator[None]) -> None:
        """Take steps of a message, and those that there is no time for in later turns."""
        for _ in steps:
            if not self._has_time():
                self._wait(steps)
                return

    def failed(self, op: str, error: Exception) -> None:
        """Tell the client why something of it is refused; of a mistake of the server, that there is one."""
        self.graph.counters.refuse(op)
        if isinstance(error, _REFUSALS):
            self.replies.say(Level.ERROR, str(error))
            return
        audit = self._gateway.access.audit
        audit.write(logging.ERROR, "internal error in %s", op, client=self.number, error=error)
        self.replies.say(Level.ERROR, "internal error")

    def each(self, op: str, items: Iterable[object], do: Callable[[Never], None]) -> Iterator[None]:
        """Do something with each of many things, and say of which it is refused."""
        reasons: dict[str, None] = {}
        untold = 0
        for item in items:
            try:
                do(item)  # type: ignore[arg-type]  # of the kind that the caller's message has
            except _REFUSALS as error:
                self.graph.counters.refuse(op)
                if len(reasons) < _MOST_REASONS:
                    reasons[str(error)] = None
                else:
                    untold += 1
            yield
        if reasons:
            more = f"; and {untold} more" if untold else ""
            self.replies.say(Level.ERROR, "; ".join(reasons) + more)

    def _rate_exceeded(self) -> None:
        """Too many messages: the client has to go, since reading on would serve it before all others."""
        rate = self._gateway.bounds.messages_per_second
        reason = f"more than {rate} messages a second (limits.messages_per_second)"
        self.replies.log(logging.WARNING, reason)
        self.sink.close(POLICY, reason)

    # -- what it is told -----------------------------------------------------------------------------------

    def take_change(self, change: Change) -> None:
        """Tell it of another listing, and end subscriptions of what is gone."""
        self.subscriptions.end(change.gone)
        for frame in change.frames:
            self.replies.send(frame)

    def tell_time(self, frame: Frame) -> None:
        """Tell it the time, unless an older one still waits for it: then in its place."""
        self._time.send(frame)

    def tell_connections(self, now: Connections) -> None:
        """Tell it who takes part in what, as far as it has asked and does not know."""
        if self.connections is not None:
            frame = now.since(self.connections)
            self.connections = now
            if frame is not None:
                self.replies.send(frame)

    def ignore_connections(self) -> None:
        """Tell it that no more."""
        self.connections = None

    def watch_connections(self) -> None:
        """Tell it now, and after every change."""
        if self.connections is None:
            self.connections = Connections()
            self.tell_connections(self._gateway.listing_of(self).connections())

    # -- life ----------------------------------------------------------------------------------------------

    def reload_role(self) -> None:
        """Take the role that the settings give the client now, and end what it does not allow; disconnect a
        client that they do not let in."""
        try:
            role = self._gateway.access.admission.role_now(self.info, None)
        except Refused as refused:
            self.sink.close(POLICY, refused.reason)
            return
        self.graph.take_role(role)
        self.publications.ask_again()
        self.graph.withdraw_refused()
        before, self.listing = self.listing, self._gateway.listing_of(self)
        now = self.listing
        self.take_change(now.difference(before.channels, before.services, now.channels, now.services))
        if self.connections is not None:
            self.tell_connections(now.connections())

    def watch(self, names: Iterable[str], *, watches: bool) -> None:
        """Tell it of changes of parameters, or no more."""
        if watches:
            self.parameters.watch(tuple(names))
        else:
            self.parameters.unwatch(names)
        self._gateway.watched()

    def fetch(self, asked: said.FetchAsset) -> None:
        """Answer with a file."""
        if self.assets is None:
            raise NotPossible("fetchAsset: this server has no files (the setting `packages`)")
        self.assets.fetch(asked, self._gateway.spawn)

    def control_playback(self, asked: said.PlaybackControlRequest) -> None:
        """Control the recording."""
        if self.playback is None:
            raise NotPossible("playback control: no recording is played here (rwt bag play)")
        self.playback.request(asked)

    def closed(self, code: int, reason: str) -> None:
        """The connection has ended: give back everything."""
        self._end_turns()
        now = self._monotonic()
        self._time.close()
        self.subscriptions.close()
        self.parameters.close()
        if self.assets is not None:
            self.assets.close()
        self.graph.close()
        self._gateway.left(self)
        self._worked += self._monotonic() - now
        self._count_work()
        self._gateway.access.audit.write(
            logging.INFO, "foxglove client %d left: %d %s", self.number, code, reason, client=self.number
        )


def _refusing(client: FoxgloveClient, op: str, steps: Iterator[None]) -> Iterator[None]:
    """The steps of a message, of which the client is told why they cannot be taken."""
    try:
        yield from steps
    except Exception as error:
        client.failed(op, error)


_HANDLERS: Final[
    Mapping[type[said.Text | said.Binary], Callable[[FoxgloveClient, Never], Iterator[None] | None]]
] = MappingProxyType(
    {
        said.Subscribe: lambda client, message: client.each(
            "subscribe",
            message.subscriptions,
            lambda one: client.subscriptions.subscribe(one, client.listing.channels),
        ),
        said.Unsubscribe: lambda client, message: client.each(
            "unsubscribe", message.subscription_ids, client.subscriptions.unsubscribe
        ),
        said.Advertise: lambda client, message: client.each(
            "advertise", message.channels, client.publications.advertise
        ),
        said.Unadvertise: lambda client, message: client.each(
            "unadvertise", message.channel_ids, client.publications.unadvertise
        ),
        said.MessageData: lambda client, message: client.publications.publish(message),
        said.ServiceCallRequest: lambda client, message: client.services.call(
            message, client.listing.services
        ),
        said.GetParameters: lambda client, message: client.parameters.get(message),
        said.SetParameters: lambda client, message: client.parameters.set(message),
        said.SubscribeParameterUpdates: lambda client, message: client.watch(
            message.parameter_names, watches=True
        ),
        said.UnsubscribeParameterUpdates: lambda client, message: client.watch(
            message.parameter_names, watches=False
        ),
        said.SubscribeConnectionGraph: lambda client, _: client.watch_connections(),
        said.UnsubscribeConnectionGraph: lambda client, _: client.ignore_connections(),
        said.FetchAsset: lambda client, message: client.fetch(message),
        said.PlaybackControlRequest: lambda client, message: client.control_playback(message),
    }
)
