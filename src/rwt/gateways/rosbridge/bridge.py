"""The rosbridge gateway: the clients of one graph, and what they share."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Final, Never

from rwt.access.access import Access
from rwt.access.errors import AccessError
from rwt.access.settings import SettingsError
from rwt.delivery.shared_graph import SharedGraph
from rwt.delivery.turns import client_turns
from rwt.gateways.rosbridge.ops import actions, auth, services, topics
from rwt.gateways.rosbridge.ops.offers import Offers
from rwt.gateways.rosbridge.peer import Peer
from rwt.gateways.rosbridge.pending_auth import PendingAuth
from rwt_interfaces.payload import Payload
from rwt_participant.errors import RobotError
from rwt_participant.qos import LATCHED
from rwt_protocol import ops
from rwt_protocol.codecs import CODECS, Codec, Encoding, bson_codec, encoding_of
from rwt_protocol.codecs.base import SplitLimits
from rwt_protocol.dispatcher import Dispatcher
from rwt_protocol.errors import EncodingUnavailable
from rwt_protocol.fragments import FragmentLimits
from rwt_protocol.profiles import PROFILES
from rwt_protocol.session import Session, WireLimits

if TYPE_CHECKING:
    from rwt.access.roles import Role
    from rwt.gateways.rosbridge.numpy_loading import NumpyLoading
    from rwt.gateways.rosbridge.settings import BridgeSettings
    from rwt_graph.api import Graph, Participant, Publisher
    from rwt_graph.clock import Clock
    from rwt_interfaces.registry import Registry
    from rwt_protocol.dispatcher import Steps
    from rwt_transports.endpoint import Endpoint, PeerInfo, Sink


HANDLERS: Final[Mapping[type[ops.Op], Callable[[Peer, Never], Steps | None]]] = {
    **topics.HANDLERS,
    **services.HANDLERS,
    **actions.HANDLERS,
    **auth.HANDLERS,
}


GATEWAY_NODE: Final = "/rosbridge_websocket"
"""The node as which all clients act."""


class Bridge:
    """Connects rosbridge clients to a graph.

    Attributes:
        name: of the protocol.
        settings: what the operator has set.
        access: who may do what.
        shared: the part in the graph that all clients share, as the node `/rosbridge_websocket`.
        dispatcher: which handler does which op.
        orphans: running goals of clients that have gone.
        service_offers: the services that clients offer.
        action_offers: the actions that clients offer.
        turns: of clients that cause more work than they may.

    Args:
        graph: the robot.
        settings: see above.
        access: see above; None for one of the bridge's own, which knows of no service what it reveals.
        loading: what loads numpy beside the event loop; None to load it where it is needed.

    Raises:
        SettingsError: a file that the settings name cannot be used, or a package is missing.
    """

    name: Final = "rosbridge"

    def __init__(
        self,
        graph: Graph,
        settings: BridgeSettings,
        access: Access | None = None,
        loading: NumpyLoading | None = None,
    ) -> None:
        self.settings = settings
        self.loading = loading
        self.access = access or Access(graph, settings)
        self._owns_access = access is None
        self.shared = SharedGraph(
            graph,
            GATEWAY_NODE,
            settings.unregister_timeout,
            partial(self.access.audit.write, logging.INFO, "%s"),
        )
        self.orphans = actions.OrphanedGoals()
        self.service_offers: Offers[services.Asked] = Offers()
        self.action_offers: Offers[actions.Accepted] = Offers()
        self.turns = client_turns(graph.clock)
        self._connected = ConnectedClients(self.shared.participant, graph.registry, graph.clock)
        self._codec = _exclusive_codec(settings)
        self._peers: dict[int, Peer] = {}
        self._count = 0
        self.dispatcher: Dispatcher[Peer] = Dispatcher(
            HANDLERS, on_error=self._log_error, refusals=(RobotError, AccessError), later=Peer.work
        )

    @property
    def peers(self) -> tuple[Peer, ...]:
        """The clients that are connected, in the order they came."""
        return tuple(self._peers.values())

    @property
    def clients(self) -> tuple[Peer, ...]:
        """The same, as every gateway has them."""
        return self.peers

    @property
    def client_count(self) -> int:
        """How many clients are connected."""
        return len(self._peers)

    def accept(self, sink: Sink, info: PeerInfo, *, loopback: bool = True) -> Endpoint:
        """Take in a new client.

        Args:
            sink: where to write to it.
            info: what the transport knows of it.
            loopback: whether it came over a listener that is only reached from this machine.

        Raises:
            Refused: it may not come in.
        """
        admission = self.access.admission
        role = admission.admit(info, loopback=loopback)
        limits = _wire_limits(self.settings)
        session = Session(PROFILES[self.settings.profile], limits=limits, codec=self._codec)
        join = partial(self._join, sink, info, session)
        if role is not None:
            return join(role)
        join = partial(join, by_auth=True)
        clock = self.shared.graph.clock
        return PendingAuth(join, sink, info, session, admission, clock, self.settings.auth.seconds)

    def reload_roles(self) -> None:
        """Give each client the role that the settings give it now, after
        :meth:`rwt.access.admission.Admission.reload`.

        A client keeps its connection unless it is not let in any more; what its role does not allow any more
        ends.
        """
        for peer in self.peers:
            peer.reload_role()

    def _join(
        self, sink: Sink, info: PeerInfo, session: Session, role: Role, *, by_auth: bool = False
    ) -> Peer:
        """Make a client of a connection whose role is known, perhaps from an `auth` op."""
        self._count += 1
        graph = self.access.client(self.shared, role, info.address, f"rosbridge:{self._count}")
        peer = Peer(self, self._count, sink, info, session, graph, by_auth=by_auth)
        self._peers[peer.number] = peer
        where = info.address or "?"
        self.access.audit.write(
            logging.INFO, "client %d joined from %s over %s", peer.number, where, info.transport,
            client=peer.number,
        )  # fmt: skip
        self.shared.counters.clients += 1
        self._connected.joined(peer.number, info.address)
        return peer

    def encoding_of(self, compression: str) -> Encoding:
        """How a client that asks for `compression` gets its samples."""
        return encoding_of(compression) if self._codec is None else CODECS["bson"]

    def left(self, peer: Peer) -> None:
        """Forget a client."""
        del self._peers[peer.number]
        self.shared.counters.left(peer.messages, peer.sink.traffic)
        self._connected.left(peer.number)

    def close(self) -> None:
        """Leave the graph."""
        self.shared.close()
        if self._owns_access:
            self.access.close()

    def _log_error(self, peer: Peer, op: ops.Op, error: Exception) -> None:
        self.access.audit.write(
            logging.ERROR, "internal error in %s", op.op, client=peer.number, op_id=op.id, error=error
        )


def _wire_limits(settings: BridgeSettings) -> WireLimits:
    """The bounds that a session keeps."""
    limits = settings.limits
    fragments = FragmentLimits(
        limits.fragmented_messages, limits.fragment_characters, limits.fragment_seconds
    )
    split = SplitLimits(limits.max_depth, limits.structure_bytes)
    return WireLimits(settings.max_message_size, split, fragments)


def _exclusive_codec(settings: BridgeSettings) -> Codec | None:
    """The codec of every message, where the settings ask for one encoding (BSN-01).

    Raises:
        SettingsError: it needs a package that is not installed.
    """
    if not settings.bson_only_mode:
        return None
    try:
        return bson_codec()
    except EncodingUnavailable as missing:
        raise SettingsError(f"`bson_only_mode`: {missing.reason}") from None


class ConnectedClients:
    """`/client_count` and `/connected_clients` (CFG-07, CFG-08): one latched publisher each, 0 and [] first.

    The client that connects is itself counted. The list is made when clients have come or gone and the clock
    turns next, so that a thousand that come together cost one message and not a thousand of growing length.
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
        self._tell_count()
        self._tell_list()

    def joined(self, number: int, address: str) -> None:
        """A client has connected."""
        moment = self._distro.time(self._clock.time_ns())
        self._clients[number] = {"ip_address": address, "connection_time": moment}
        self._changed()

    def left(self, number: int) -> None:
        """A client has gone."""
        self._clients.pop(number, None)
        self._changed()

    def _changed(self) -> None:
        self._tell_count()
        if not self._due:
            self._due = True
            self._clock.call_later(0.0, self._tell_list)

    def _tell_count(self) -> None:
        _publish(self._count, {"data": len(self._clients)})

    def _tell_list(self) -> None:
        self._due = False
        _publish(self._list, {"clients": list(self._clients.values())})


def _publish(publisher: Publisher, message: dict[str, object]) -> None:
    publisher.publish(Payload.from_value(publisher.type, message))
