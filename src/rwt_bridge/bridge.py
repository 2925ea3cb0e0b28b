"""The bridge: every rosbridge client of one graph, and what they share."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Never

from rwt.observability.loop_lag import LoopLag
from rwt_access.admission import Admission
from rwt_access.audit import write
from rwt_access.settings import SettingsError
from rwt_bridge.connected_clients import Census
from rwt_bridge.ops import actions, services, topics
from rwt_bridge.ops import auth as control
from rwt_bridge.peer import Peer
from rwt_bridge.pending_auth import Doorstep
from rwt_delivery.counters import Ledger
from rwt_delivery.fanout import Fanout
from rwt_delivery.shared_publishers import Publications
from rwt_program.errors import RobotError
from rwt_protocol import ops
from rwt_protocol.codecs import CODECS, Codec, Encoding, bson_codec, encoding_of
from rwt_protocol.dispatcher import Dispatcher
from rwt_protocol.errors import EncodingUnavailable
from rwt_protocol.fragments import FragmentLimits
from rwt_protocol.profiles import PROFILES
from rwt_protocol.session import Session, WireLimits

if TYPE_CHECKING:
    from rwt_access.roles import Role
    from rwt_bridge.ops.actions import SentGoal
    from rwt_bridge.settings import BridgeSettings
    from rwt_graph.api import Graph
    from rwt_interfaces.structs import MessageType
    from rwt_protocol.transport import Endpoint, PeerInfo, Sink
    from rwt_transports.relay.dial import RelayStatus

#: Goals whose sender has disconnected are remembered for a later `cancel_action_goal`, up to this many.
_MOST_ORPHANS = 1000

HANDLERS: dict[type[ops.Op], Callable[[Peer, Never], None]] = {
    ops.Advertise: topics.on_advertise,
    ops.Unadvertise: topics.on_unadvertise,
    ops.Publish: topics.on_publish,
    ops.Subscribe: topics.on_subscribe,
    ops.Unsubscribe: topics.on_unsubscribe,
    ops.CallService: services.on_call_service,
    ops.ServiceResponse: services.on_service_response,
    ops.AdvertiseService: services.on_advertise_service,
    ops.UnadvertiseService: services.on_unadvertise_service,
    ops.SendActionGoal: actions.on_send_action_goal,
    ops.CancelActionGoal: actions.on_cancel_action_goal,
    ops.ActionFeedback: actions.on_action_feedback,
    ops.ActionResult: actions.on_action_result,
    ops.AdvertiseAction: actions.on_advertise_action,
    ops.UnadvertiseAction: actions.on_unadvertise_action,
    ops.Auth: control.on_auth,
}


class Bridge:
    """Connects rosbridge clients to a graph.

    Attributes:
        graph: the robot.
        participant: the node under which all clients act, `/rosbridge_websocket`.
        publications: the publishers that clients share.
        dispatcher: which handler does which op.
        admission: who comes in, and as what.
        ledger: what is counted.
        census: who is connected, told to the graph.
        loop_lag: how late the event loop is.
        dials: how each dial-out goes.

    Raises:
        SettingsError: a file that the settings name cannot be used.
    """

    def __init__(self, graph: Graph, settings: BridgeSettings) -> None:
        self.graph = graph
        self.participant = graph.participant("/rosbridge_websocket")
        self.ledger = Ledger()
        self.census = Census(self.participant, graph.registry, graph.clock)
        self.loop_lag = LoopLag(graph.clock)
        self.publications = Publications(
            self.participant, graph.clock, settings.unregister_timeout, self.ledger
        )
        self.now = graph.clock.time_ns
        self._settings = settings
        self.limits = settings.limits
        self.admission = Admission(settings, time.time, graph.clock.monotonic)
        self._exclusive = CODECS["bson"] if settings.bson_only_mode else None
        self._codec = _exclusive_codec(settings)
        self._fanouts: dict[str, Fanout] = {}
        self._peers: set[Peer] = set()
        self.dials: list[RelayStatus] = []
        self._count = 0
        self._orphans: dict[SentGoal, str] = {}
        self.dispatcher: Dispatcher[Peer] = Dispatcher(HANDLERS, on_error=_log_error, refusals=(RobotError,))

    @property
    def peers(self) -> tuple[Peer, ...]:
        """The clients that are connected, in the order they came."""
        return tuple(sorted(self._peers, key=lambda peer: peer.number))

    @property
    def fanouts(self) -> Mapping[str, Fanout]:
        """The topics that clients listen to, by absolute name."""
        return self._fanouts

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
        role = self.admission.admit(info, loopback=loopback)
        limits = _wire_limits(self._settings)
        session = Session(PROFILES[self._settings.profile], limits=limits, codec=self._codec)
        if role is not None:
            return self.join(sink, info, session, role)
        rosauth = self.admission.rosauth
        assert rosauth is not None, "admit lets nobody in without a role unless `auth` can give one"
        return Doorstep(self, sink, info, session, rosauth, self._settings.auth.seconds)

    def join(self, sink: Sink, info: PeerInfo, session: Session, role: Role) -> Peer:
        """Make a client of a connection whose role is known."""
        self._count += 1
        peer = Peer(self, self._count, sink, info, session, role)
        self._peers.add(peer)
        where = info.address or "?"
        write(
            logging.INFO, "client %d joined from %s over %s", peer.number, where, info.transport,
            client=peer.number,
        )  # fmt: skip
        self.ledger.clients += 1
        self.census.joined(peer.number, info.address)
        return peer

    def left(self, peer: Peer) -> None:
        """Forget a client; its goals run on, and can still be cancelled from the same address."""
        self._peers.discard(peer)
        self.ledger.left(peer)
        self.census.left(peer.number)
        self.admission.left(peer.info)
        for goal in peer.goals:
            goal.orphan()
            self._orphans[goal] = peer.info.address
        while len(self._orphans) > _MOST_ORPHANS:
            del self._orphans[next(iter(self._orphans))]

    def fanout(self, topic: str, type: MessageType) -> Fanout:
        """The fan-out of a topic, made if nobody listens yet.

        Raises:
            TypeConflict: the topic has another type.
        """
        fanout = self._fanouts.get(topic)
        if fanout is None:
            fanout = self._fanouts[topic] = Fanout(
                self.participant, topic, type, self.ledger.use_topic(topic), self.graph.clock
            )
        else:
            fanout.check_type(type)
            known = self.graph.topic(topic)
            if known is not None and not known.publishers:
                fanout.renew()
        return fanout

    def release_fanout(self, fanout: Fanout) -> None:
        """End a fan-out that nobody listens to any more."""
        if fanout.is_empty and self._fanouts.get(fanout.topic) is fanout:
            del self._fanouts[fanout.topic]
            self.ledger.release_topic(fanout.counts)
            fanout.close()

    def encoding_of(self, compression: str) -> Encoding:
        """How a client that asks for `compression` gets its samples."""
        return self._exclusive or encoding_of(compression)

    def call_timeout(self, wished: float | None) -> float | None:
        """Seconds a service call may take: zero or less waits for ever, absent is the default (SRV-10)."""
        seconds = self._settings.default_call_service_timeout if wished is None else wished
        return seconds if seconds > 0 else None

    def orphaned_goal(self, address: str, action: str, id_: str | int | None) -> SentGoal | None:
        """The newest running goal of that id whose sender, at that address, has disconnected."""
        for goal, sender in reversed(self._orphans.items()):
            if sender == address and goal.action == action and goal.id == id_:
                return goal
        return None

    def forget_goal(self, goal: SentGoal) -> None:
        """The goal has ended."""
        self._orphans.pop(goal, None)

    def close(self) -> None:
        """Leave the graph."""
        self.loop_lag.close()
        self.publications.close()
        self.participant.close()


def _wire_limits(settings: BridgeSettings) -> WireLimits:
    """The bounds that a session keeps."""
    wished = settings.limits
    fragments = FragmentLimits(
        wished.fragmented_messages, wished.fragment_characters, wished.fragment_seconds
    )
    return WireLimits(settings.max_message_size, wished.max_depth, fragments)


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


def _log_error(peer: Peer, op: ops.Op, error: Exception) -> None:
    write(logging.ERROR, "internal error in %s", op.op, client=peer.number, op_id=op.id, error=error)
