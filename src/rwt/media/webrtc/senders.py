"""Who sends a camera or a microphone now, as a latched topic: the light beside an operator's camera."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from rwt_interfaces.payload import Payload
from rwt_participant.qos import LATCHED

if TYPE_CHECKING:
    from rwt.access.access import Access
    from rwt.delivery.shared_graph import SharedGraph

TOPIC: Final = "/whip/senders"
TYPE: Final = "rwt_gate_msgs/MediaSenders"


@dataclass(frozen=True, slots=True)
class Sending:
    """What one client sends.

    Attributes:
        topic: on which it is published.
        kind: ``video`` or ``audio``.
        client: its name, as the gate and the audit have it.
        role: its role.
        since_ns: ROS time since when.
    """

    topic: str
    kind: str
    client: str
    role: str
    since_ns: int


class SendersTopic:
    """Tells on :data:`TOPIC` who sends, on which no client publishes.

    Args:
        shared: whose participant publishes.
        access: reserves the topic.
    """

    def __init__(self, shared: SharedGraph, access: Access) -> None:
        access.reserve(TOPIC)
        self._distro = shared.graph.distro
        self._publisher = shared.participant.advertise(TOPIC, shared.graph.registry.message(TYPE), LATCHED)
        self.tell(())

    def tell(self, senders: Iterable[Sending]) -> None:
        """Publish all who send now."""
        told = [
            {
                "topic": each.topic,
                "kind": each.kind,
                "client": each.client,
                "role": each.role,
                "since": self._distro.time(each.since_ns),
            }
            for each in senders
        ]
        self._publisher.publish(Payload.from_value(self._publisher.type, {"senders": told}))
