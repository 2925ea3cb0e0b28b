"""What one client owns: its session, its subscriptions, publishers, services, actions, calls and goals."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from rwt_bridge.topics import release_publishers

if TYPE_CHECKING:
    from rwt_bridge.actions import ProvidedAction, SentGoal
    from rwt_bridge.bridge import Bridge
    from rwt_bridge.services import ClientCall, ProvidedService
    from rwt_bridge.subscriptions import ClientSubscription
    from rwt_graph.api import Publisher
    from rwt_protocol.frames import PeerInfo, Sink
    from rwt_protocol.ops import Op
    from rwt_protocol.session import Refusal, Session

logger = logging.getLogger("rwt.bridge")

_LOG_LEVELS = {"error": logging.WARNING, "warning": logging.INFO, "info": logging.DEBUG, "none": logging.DEBUG}


class Peer:
    """One client. A new connection is a new, empty peer (DIS-06)."""

    def __init__(self, bridge: Bridge, number: int, sink: Sink, info: PeerInfo, session: Session) -> None:
        self.bridge = bridge
        self.number = number
        self.sink = sink
        self.info = info
        self.session = session
        self.advertised: dict[str, set[str | int | None]] = {}
        self.implicit: set[str] = set()
        self.publishers: dict[str, Publisher] = {}
        self.subscriptions: dict[str, ClientSubscription] = {}
        self.services: dict[str, ProvidedService] = {}
        self.actions: dict[str, ProvidedAction] = {}
        self.calls: set[ClientCall] = set()
        self.goals: set[SentGoal] = set()

    def receive(self, data: bytes, binary: bool) -> None:
        """Take one message from the wire: decode it, run what it holds, and answer what was refused."""
        for item in self.session.decode(data, binary, self.bridge.graph.clock.monotonic()):
            self.bridge.dispatch(self, item)

    def closed(self, code: int, reason: str) -> None:
        """The connection has ended: give back everything (DIS-01 … DIS-07)."""
        for subscription in self.subscriptions.values():
            subscription.close()
        release_publishers(self)
        for service in self.services.values():
            service.close()
        for action in self.actions.values():
            action.close()
        for call in self.calls:
            if call.pending is not None:
                call.pending.cancel()
        self.bridge.left(self)
        logger.info("client %d left: %d %s", self.number, code, reason)

    def send(self, op: Op) -> None:
        """Send one op in the control lane."""
        self.sink.send(self.session.encode(op))

    def forget_publisher(self, topic: str) -> None:
        """Look the topic's publisher up again at the next publish."""
        self.publishers = {name: held for name, held in self.publishers.items() if held.topic != topic}

    def refused(self, refusal: Refusal) -> None:
        """Log what was refused, and answer where the protocol has an answer."""
        self.log_status(refusal.level, refusal.reason, refusal.id)

    def log_status(self, level: str, text: str, id_: object = None) -> None:
        """One line in the log, with the client's number and the op's id."""
        note = "" if id_ is None else f" [id: {id_}]"
        logger.log(_LOG_LEVELS[level], "[client %d]%s %s", self.number, note, text)
