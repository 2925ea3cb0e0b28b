"""The rosbridge gateway: its clients and their shared state."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from operator import attrgetter
from typing import Final, Never, cast

from rwt.access.access import Access
from rwt.access.admission import Admission
from rwt.access.decisions import VERBS
from rwt.access.errors import AccessError, NotAuthenticated
from rwt.access.roles import Role
from rwt.access.settings import AuthSettings, SettingsError
from rwt.gateways.base import ConnectionGateway
from rwt.rosbridge.numpy_loading import NumpyLoading
from rwt.rosbridge.ops import actions, services, topics
from rwt.rosbridge.ops.offers import Offers
from rwt.rosbridge.peer import Peer
from rwt.rosbridge.settings import BridgeSettings
from rwt_graph.api import Graph, Participant, Publisher
from rwt_graph.clock import Clock
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_participant.errors import RobotError
from rwt_participant.qos import LATCHED
from rwt_participant.timers import Timer
from rwt_protocol import ops
from rwt_protocol.codecs import ENCODINGS, Encoding, bson_codec, encoding_of
from rwt_protocol.codecs.base import Codec
from rwt_protocol.dispatcher import Dispatcher, Steps
from rwt_protocol.errors import EncodingUnavailable
from rwt_protocol.limits import WireLimits
from rwt_protocol.ops import Direction
from rwt_protocol.profiles import PROFILES
from rwt_protocol.readers import readers
from rwt_protocol.session import Session
from rwt_transports.endpoint import Endpoint, PeerInfo, Sink
from rwt_transports.http.addresses import holder_of
from rwt_transports.websocket.close_codes import POLICY

# The dispatcher calls each handler with the part of a client that `_PARTS` names, which a mapping's type
# cannot express.
HANDLERS: Final = cast(
    "Mapping[type[ops.Op], Callable[[Peer, Never], Steps | None]]",
    {**topics.HANDLERS, **services.HANDLERS, **actions.HANDLERS, ops.Auth: Peer.authenticate},
)

_PARTS: Final = {
    model: attrgetter(part)
    for part, handlers in (
        ("topics", topics.HANDLERS),
        ("services", services.HANDLERS),
        ("actions", actions.HANDLERS),
    )
    for model in handlers
}


GATEWAY_NODE: Final = "/rosbridge_websocket"
"""Absolute name of the node as which all clients act."""


class Bridge(ConnectionGateway[Peer]):
    """The rosbridge gateway: connects rosbridge clients to a graph, as the node `/rosbridge_websocket`.

    Attributes:
        orphans: running goals of clients that have left.

    Args:
        graph: the robot.
        settings: settings of the operator.
        access: access rules of the server; by default the bridge creates its own, without disclosures.
        loading: loads numpy in a thread; None loads it on first use.

    Raises:
        SettingsError: a file that the settings name cannot be used, or a package is missing.
    """

    name = "rosbridge"
    verbs = tuple(VERBS)

    def __init__(
        self,
        graph: Graph,
        settings: BridgeSettings,
        access: Access | None = None,
        loading: NumpyLoading | None = None,
    ) -> None:
        super().__init__(graph, access or Access(graph, settings), GATEWAY_NODE, settings.unregister_timeout)
        self._owns_access = access is None
        self.settings = settings
        self.loading = loading
        # Builds the models of the ops, which takes milliseconds, before the first client connects.
        readers(PROFILES[settings.profile], Direction.TO_SERVER)
        self.orphans = actions.Orphans()
        self.service_offers: Offers[services.Asked] = {}
        self.action_offers: Offers[actions.Accepted] = {}
        self._connected = ConnectedClients(self.shared.participant, graph.registry, graph.clock)
        self._codec = _exclusive_codec(settings)
        limits = settings.limits
        self._limits = WireLimits(
            settings.max_message_size,
            limits.max_depth,
            limits.structure_bytes,
            limits.fragmented_messages,
            limits.fragment_characters,
            limits.fragment_seconds,
        )
        self.dispatcher: Dispatcher[Peer] = Dispatcher(
            HANDLERS,
            on_error=lambda peer, op, error: peer.replies.log_internal_error(op.op, error, op.id),
            refusals=(RobotError, AccessError),
            later=Peer.work,
            parts=_PARTS,
        )

    def accept(self, sink: Sink, info: PeerInfo, *, loopback: bool = True) -> Endpoint:
        """Accept a new client, see :class:`~rwt.gateways.base.AcceptPeer`.

        A client without credentials may have to send an `auth` op before anything else.
        """
        admission = self.access.admission
        role = admission.admit(info, loopback=loopback)
        session = Session(PROFILES[self.settings.profile], limits=self._limits, codec=self._codec, light=True)
        if role is not None:
            return self._join(sink, info, session, role)

        def join(role: Role) -> Peer:
            sink.count_for(holder_of(info.address, role.credential))
            peer = self._join(sink, info, session, role)
            peer.is_role_by_auth = True
            return peer

        return PendingAuth(join, sink, info, session, admission, self.shared.graph.clock, self.settings.auth)

    def _join(self, sink: Sink, info: PeerInfo, session: Session, role: Role) -> Peer:
        peer = self.join(role, info, lambda number, graph: Peer(self, number, sink, info, session, graph))
        self._connected.joined(peer.number, info.address)
        return peer

    def encoding_of(self, compression: str) -> Encoding:
        """Return the encoding of samples for a client that asks for `compression`."""
        return encoding_of(compression) if self._codec is None else ENCODINGS["bson"]

    def left(self, client: Peer) -> None:
        """Remove a client whose connection has ended."""
        super().left(client)
        self._connected.left(client.number)

    def close(self) -> None:
        """Leave the graph."""
        super().close()
        if self._owns_access:
            self.access.close()


def _exclusive_codec(settings: BridgeSettings) -> Codec | None:
    if not settings.bson_only_mode:
        return None
    try:
        return bson_codec()
    except EncodingUnavailable as missing:
        raise SettingsError(f"`bson_only_mode`: {missing.reason}") from None


class ConnectedClients:
    """Latched `/client_count` and `/connected_clients` (CFG-07, CFG-08), initially 0 and [].

    A client that connects is counted itself. Messages are published once per turn of the loop, so that a
    thousand new clients cost one message.
    """

    def __init__(self, participant: Participant, registry: Registry, clock: Clock) -> None:
        self._clock = clock
        self._count = participant.advertise("/client_count", registry.message("std_msgs/Int32"), LATCHED)
        self._list = participant.advertise(
            "/connected_clients", registry.message("rosbridge_msgs/ConnectedClients"), LATCHED
        )
        self._distro = registry.distro
        self._clients: dict[int, dict[str, object]] = {}
        self._due = False
        _publish(self._count, {"data": 0})
        self._publish_list()

    def joined(self, number: int, address: str) -> None:
        """Add a client that has connected."""
        moment = self._distro.time(self._clock.time_ns())
        self._clients[number] = {"ip_address": address, "connection_time": moment}
        self._changed()

    def left(self, number: int) -> None:
        """Remove a client that has disconnected."""
        self._clients.pop(number, None)
        self._changed()

    def _changed(self) -> None:
        _publish(self._count, {"data": len(self._clients)})
        # The count at once, since it is small; the list has an entry for each client.
        if not self._due:
            self._due = True
            self._clock.call_later(0.0, self._publish_list)

    def _publish_list(self) -> None:
        self._due = False
        _publish(self._list, {"clients": list(self._clients.values())})


def _publish(publisher: Publisher, message: dict[str, object]) -> None:
    publisher.publish(Payload.from_value(publisher.type, message))


_NO_AUTH: Final = "this server wants `auth` as the first message"


class PendingAuth:
    """Endpoint of a connection until its first message, which must be a valid `auth` op.

    Life cycle::

        waiting ── valid `auth` ──────────────────> handed over to a peer
           │
           └── anything else, or `auth.seconds` ──> closed

    Anything else is: another op, an op that the session itself would handle, a fragment, an invalid message,
    or one that is larger than `auth.message_bytes`.

    Args:
        settings: its timeout, and its largest message.

    Attributes:
        largest_bytes: maximum size of its message.
    """

    def __init__(
        self,
        join: Callable[[Role], Endpoint],
        sink: Sink,
        info: PeerInfo,
        session: Session,
        admission: Admission,
        clock: Clock,
        settings: AuthSettings,
    ) -> None:
        self.largest_bytes = settings.message_bytes
        self._join = join
        self._sink = sink
        self._info = info
        self._session = session
        self._admission = admission
        self._monotonic = clock.monotonic
        # None once the outcome is known.
        self._timer: Timer | None = clock.call_later(settings.seconds, self._too_late)

    def receive(self, data: bytes, binary: bool) -> None:
        """Read the first message: one frame with the `auth` op and nothing else."""
        if self._timer is None:
            return
        if len(data) > self.largest_bytes:
            # Transports with whole messages have received it already.
            self.oversized(len(data), self.largest_bytes, b"")
            return
        rosauth = self._admission.rosauth
        if rosauth is not None:
            items = self._session.decode(data, binary, self._monotonic())
            if len(items) == 1 and isinstance(items[0], ops.Auth):
                try:
                    role = rosauth.authenticate(items[0])
                except NotAuthenticated as refused:
                    self._turn_away(str(refused))
                    return
                self._decide()
                self._sink.hand_over(self._join(role))
                return
        self._turn_away(_NO_AUTH)

    def oversized(self, size: int, limit: int, head: bytes) -> None:
        """Called for a message over the size limit."""
        self._turn_away(
            f"a message of {size} bytes before `auth`, and {limit} is the limit (auth.message_bytes)"
        )

    def closed(self, code: int, reason: str) -> None:
        """Called when the connection has ended."""
        self._decide()

    def _turn_away(self, reason: str) -> None:
        self._decide()
        self._admission.log_refusal("auth", self._info, reason)
        self._sink.close(POLICY, reason)

    def _too_late(self) -> None:
        self._turn_away("no `auth` came in time (auth.seconds)")

    def _decide(self) -> None:
        timer, self._timer = self._timer, None
        if timer is not None:
            timer.cancel()
