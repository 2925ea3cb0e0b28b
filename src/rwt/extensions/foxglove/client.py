"""One client of Foxglove's protocol: its frames and its resources."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Final, TypeVar

from rwt.access.errors import AccessError
from rwt.access.graph_view import STOP
from rwt.delivery.counters import UNKNOWN
from rwt.delivery.drop_notices import NoticeFlow
from rwt.extensions.foxglove.assets import Assets
from rwt.extensions.foxglove.catalogue import Connections, ListingChange, RoleListing
from rwt.extensions.foxglove.errors import FoxgloveError, InvalidFrame, NotPossible
from rwt.extensions.foxglove.parameters import ParameterRequests
from rwt.extensions.foxglove.playback import PlaybackControl
from rwt.extensions.foxglove.publications import ClientChannels
from rwt.extensions.foxglove.replies import FoxgloveReplies
from rwt.extensions.foxglove.services import ServiceCalls
from rwt.extensions.foxglove.subscriptions import Subscriptions
from rwt.extensions.foxglove.wire import client_messages as said
from rwt.extensions.foxglove.wire.server_messages import Level, status
from rwt.gateways.base import ConnectedClient
from rwt_participant.errors import RobotError
from rwt_transports.endpoint import FlowRules, PeerInfo, Sink

if TYPE_CHECKING:
    from rwt.access.client_graph import ClientGraph
    from rwt.access.roles import Role
    from rwt.extensions.foxglove.gateway import FoxgloveGateway

_MAX_REASONS: Final = 5
"""Maximum number of errors reported for one message; of the others, only the number is reported."""

T = TypeVar("T")

_REFUSALS: Final = (RobotError, AccessError, FoxgloveError)


_Message = said.Text | said.Binary | InvalidFrame
"""Message of a frame, or why there is none."""


def _decode(data: bytes, binary: bool, now: float) -> tuple[_Message]:
    """Read a frame, which holds one message."""
    try:
        return (said.parse_binary(data) if binary else said.parse_text(data),)
    except InvalidFrame as invalid:
        return (invalid,)


class FoxgloveClient(ConnectedClient[_Message, Iterator[None]]):
    """One Foxglove client; see :class:`~rwt.gateways.base.ConnectedClient` for its life cycle.

    Attributes by purpose:

    * Announced to the client: ``listing`` (channels and services of its role), ``connections`` (the
      connection graph it was last sent; None while it does not subscribe to it), ``time`` (flow of `time`
      messages, in which only the newest waits).
    * Resources of the client, by kind of message: ``subscriptions``, ``publications``, ``services``,
      ``parameters``, ``assets`` (None without files), ``playback`` (None without a recording).
    """

    replies: FoxgloveReplies
    listing: RoleListing
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
        listing: RoleListing,
    ) -> None:
        replies = FoxgloveReplies(gateway, number, sink)
        super().__init__(gateway, number, info, graph, replies, _decode)
        structure = gateway.access.limits.structure_bytes
        pages, playback = gateway.pages, gateway.playback
        self._foxglove = gateway
        self.listing = listing
        self.connections: Connections | None = None
        self.time = sink.flow("time", FlowRules(depth=1, notes=True))
        self.subscriptions = Subscriptions(graph, replies)
        self.publications = ClientChannels(graph, replies, structure)
        self._gate_notices, self._gate_notice = NoticeFlow(sink, "commands"), ""
        graph.tell_notices(self._tell_notice)
        graph.tell_ended(self.publications.on_ended)
        self.services = ServiceCalls(graph, replies, structure, gateway.call_timeout)
        self.parameters = ParameterRequests(graph, replies, gateway.scheduler)
        self.assets = None if pages is None else Assets(graph, replies, pages, info.address, gateway.files)
        self.playback = None if playback is None else PlaybackControl(graph, replies, playback)

    # -- from the client -----------------------------------------------------------------------------------

    def _resume(self, what: _Message | Iterator[None], now: float) -> None:
        if isinstance(what, Iterator):
            self._run_steps(what)
        else:
            self._run((what,), now)

    def _run(self, messages: Sequence[_Message], now: float) -> None:
        for message in messages:
            op = UNKNOWN
            try:
                if isinstance(message, Exception):
                    raise message
                op = type(message).__name__
                steps = self._handle(message)
            except Exception as error:
                self._failed(op, error)
            else:
                if steps is not None:
                    self._run_steps(self._refusing(op, steps))

    def _handle(self, message: said.Text | said.Binary) -> Iterator[None] | None:
        """Process a message; long work is returned as steps."""
        match message:
            case said.MessageData():
                return self.publications.publish(message)
            case said.ServiceCallRequest():
                return self.services.call(message, self.listing.services)
            case said.SubscribeChannels():
                channels = self.listing.channels
                subscribe = partial(self.subscriptions.subscribe, channels=channels)
                return self._each("subscribe", message.subscriptions, subscribe)
            case said.UnsubscribeChannels():
                return self._each("unsubscribe", message.subscription_ids, self.subscriptions.unsubscribe)
            case said.AdvertiseChannels():
                return self._each("advertise", message.channels, self.publications.advertise)
            case said.UnadvertiseChannels():
                return self._each("unadvertise", message.channel_ids, self.publications.unadvertise)
            case said.GetParameters():
                self.parameters.get(message)
            case said.SetParameters():
                self.parameters.set(message)
            case said.SubscribeParameterUpdates():
                self.parameters.watch(message.parameter_names)
                self._foxglove.watched()
            case said.UnsubscribeParameterUpdates():
                self.parameters.unwatch(message.parameter_names)
                self._foxglove.watched()
            case said.SubscribeConnectionGraph():
                if self.connections is None:
                    self.connections = Connections()
                    self.send_connections(self._foxglove.listing(self.graph.role).connections())
            case said.UnsubscribeConnectionGraph():
                self.connections = None
            case said.FetchAsset():
                if self.assets is None:
                    raise NotPossible("fetchAsset: this server has no files (the setting `packages`)")
                self.assets.fetch(message, self._foxglove.shared.graph.spawn)
            case said.PlaybackControlRequest():
                if self.playback is None:
                    raise NotPossible("playback control: no recording is played here (rwt bag play)")
                self.playback.request(message)
        return None

    def _refusing(self, op: str, steps: Iterator[None]) -> Iterator[None]:
        try:
            yield from steps
        except Exception as error:
            self._failed(op, error)

    def _tell_notice(self, text: str) -> None:
        """Send what the gate did to a command, unless it is the same as for the one before."""
        if text != self._gate_notice:
            self._gate_notice = text
            self._gate_notices.send(status(Level.WARNING, f"gate: {text}", "gate"))

    def report_connection(self, text: str, is_connected: bool) -> None:
        """Send a status: an error if the connection is lost."""
        self.replies.send(status(Level.INFO if is_connected else Level.ERROR, text, "graph"))

    def report_problem(self, topic: str, text: str) -> None:
        """Send a status about a topic that the client advertises or may subscribe to."""
        if self.graph.advertises(topic) or self.graph.topic(topic) is not None:
            self.replies.send(status(Level.WARNING, text, f"problem of {topic}"))

    def _names_stop(self, data: bytes, binary: bool) -> bool:
        # In this protocol, text frames neither publish nor call.
        opcode, id = said.addressee(data) if binary else (0, 0)
        if opcode == said.SERVICE_CALL_REQUEST:
            service = self.listing.services.get(id)
            return service is not None and service.name == STOP
        return opcode == said.MESSAGE_DATA and self.publications.topic_of(id) == STOP

    def _run_steps(self, steps: Iterator[None]) -> None:
        for _ in steps:
            if not self._has_time():
                self._wait(steps)
                return

    def _failed(self, op: str, error: Exception) -> None:
        self.graph.counters.refuse(op)
        if isinstance(error, _REFUSALS):
            self.replies.say(Level.ERROR, str(error))
            return
        self.replies.log_internal_error(op, error)
        self.replies.say(Level.ERROR, "internal error")

    def _each(self, op: str, items: Iterable[T], do: Callable[[T], None]) -> Iterator[None]:
        """Apply a function to each item in steps, and report those that are rejected."""
        reasons: dict[str, None] = {}
        more = 0
        for item in items:
            try:
                do(item)
            except _REFUSALS as error:
                self.graph.counters.refuse(op)
                if len(reasons) < _MAX_REASONS:
                    reasons[str(error)] = None
                else:
                    more += 1
            # One item per step: a client may name thousands at once.
            yield
        if reasons:
            self.replies.say(Level.ERROR, "; ".join(reasons) + (f"; and {more} more" if more else ""))

    # -- to the client -------------------------------------------------------------------------------------

    def take_change(self, change: ListingChange) -> None:
        """Announce another listing, and end subscriptions of removed channels."""
        self.subscriptions.end(change.gone)
        for frame in change.frames:
            self.replies.send(frame)

    def send_connections(self, now: Connections) -> None:
        """Send what has changed in the connection graph, if the client subscribes to it."""
        if self.connections is not None:
            # Since what this client was sent last: it may have subscribed at any time.
            frame = now.since(self.connections)
            self.connections = now
            if frame is not None:
                self.replies.send(frame)

    # -- life cycle ----------------------------------------------------------------------------------------

    def take_role(self, role: Role) -> None:
        """Switch to another role; permission to publish is checked again."""
        super().take_role(role)
        self.publications.ask_again()

    def withdraw_refused(self) -> None:
        """Withdraw what the client's role does not allow, and announce what the role sees."""
        super().withdraw_refused()
        before, self.listing = self.listing, self._foxglove.listing(self.graph.role)
        now = self.listing
        self.take_change(now.difference(before.channels, before.services, now.channels, now.services))
        if self.connections is not None:
            self.send_connections(now.connections())

    def _releases(self) -> Iterator[None]:
        self.time.close()
        self._gate_notices.close()
        self.subscriptions.close()
        self.parameters.close()
        if self.assets is not None:
            self.assets.close()
        yield
