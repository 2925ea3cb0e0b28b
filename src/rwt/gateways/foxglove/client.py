"""One client of Foxglove's protocol: its frames in turn, and what it owns."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, Never

from rwt.access.errors import AccessError
from rwt.delivery.counters import UNKNOWN
from rwt.gateways.base import ConnectedClient
from rwt.gateways.foxglove.assets import Assets
from rwt.gateways.foxglove.catalogue import Connections
from rwt.gateways.foxglove.errors import FoxgloveError, NotPossible
from rwt.gateways.foxglove.parameters import ParameterRequests
from rwt.gateways.foxglove.playback import PlaybackControl
from rwt.gateways.foxglove.publications import ClientChannels
from rwt.gateways.foxglove.replies import StatusLane
from rwt.gateways.foxglove.services import ServiceCalls
from rwt.gateways.foxglove.subscriptions import Subscriptions
from rwt.gateways.foxglove.wire import client_messages as said
from rwt.gateways.foxglove.wire.server_messages import Level
from rwt_participant.errors import RobotError
from rwt_transports.endpoint import FlowRules

if TYPE_CHECKING:
    from rwt.access.client_graph import ClientGraph
    from rwt.access.roles import Role
    from rwt.gateways.foxglove.catalogue import Change, Listing
    from rwt.gateways.foxglove.gateway import FoxgloveGateway
    from rwt_protocol.frames import Frame
    from rwt_transports.endpoint import PeerInfo, Sink

_MOST_REASONS: Final = 5
"""Maximum number of errors reported for one message; of the others, only the number is reported."""

_REFUSALS: Final = (RobotError, AccessError, FoxgloveError)


class FoxgloveClient(ConnectedClient[Iterator[None]]):
    """One Foxglove client; see :class:`~rwt.gateways.base.ConnectedClient` for its life cycle.

    Attributes by purpose:

    * Announced to the client: ``listing`` (channels and services of its role), ``connections`` (the
      connection graph it was last sent; None while it does not subscribe to it), ``_time`` (flow of `time`
      messages, in which only the newest waits).
    * What the client has, by kind of message: ``subscriptions``, ``publications``, ``services``,
      ``parameters``, ``assets`` (None without files), ``playback`` (None without a recording).
    """

    replies: StatusLane
    listing: Listing
    subscriptions: Subscriptions
    publications: ClientChannels
    services: ServiceCalls
    parameters: ParameterRequests

    def __init__(
        self,
        gateway: FoxgloveGateway,
        number: int,
        sink: Sink,
        info: PeerInfo,
        graph: ClientGraph,
        listing: Listing,
    ) -> None:
        replies = StatusLane(gateway, number, sink)
        super().__init__(gateway, number, info, graph, replies)
        structure = gateway.access.limits.structure_bytes
        settings, pages, playback = gateway.settings, gateway.pages, gateway.playback
        self._foxglove = gateway
        self.listing = listing
        self.connections: Connections | None = None
        self._time = sink.flow("time", FlowRules(depth=1, notes=True))
        self.subscriptions = Subscriptions(graph, replies)
        self.publications = ClientChannels(graph, replies, structure)
        self.services = ServiceCalls(graph, replies, structure, gateway.call_timeout)
        self.parameters = ParameterRequests(graph, replies, settings.parameter_names, gateway.turns)
        self.assets = None if pages is None else Assets(graph, replies, pages, settings, info.address)
        self.playback = None if playback is None else PlaybackControl(graph, replies, playback)

    # -- what it says --------------------------------------------------------------------------------------

    def _resume(self, what: Iterator[None], now: float) -> None:
        self._run(what)

    def _decode(self, data: bytes, binary: bool, now: float) -> None:
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
        """Take steps of a message now, and the rest in later turns."""
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
        self.replies.log_internal_error(op, error)
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
            self.tell_connections(self._foxglove.listing_of(self).connections())

    # -- life ----------------------------------------------------------------------------------------------

    def take_role(self, role: Role) -> None:
        """Switch to another role; permission to publish is checked again."""
        super().take_role(role)
        self.publications.ask_again()

    def withdraw_refused(self) -> None:
        """Withdraw what the client's role does not allow, and announce what the role sees."""
        super().withdraw_refused()
        before, self.listing = self.listing, self._foxglove.listing_of(self)
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
        self._foxglove.watched()

    def fetch(self, asked: said.FetchAsset) -> None:
        """Answer with a file."""
        if self.assets is None:
            raise NotPossible("fetchAsset: this server has no files (the setting `packages`)")
        self.assets.fetch(asked, self._foxglove.spawn)

    def control_playback(self, asked: said.PlaybackControlRequest) -> None:
        """Control the recording."""
        if self.playback is None:
            raise NotPossible("playback control: no recording is played here (rwt bag play)")
        self.playback.request(asked)

    def _releases(self) -> Iterator[None]:
        self._time.close()
        self.subscriptions.close()
        self.parameters.close()
        if self.assets is not None:
            self.assets.close()
        yield


def _refusing(client: FoxgloveClient, op: str, steps: Iterator[None]) -> Iterator[None]:
    """Run the steps of a message, and report rejections to the client."""
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
