"""Who is connected, told to the graph: `/client_count` and `/connected_clients` (CFG-07, CFG-08)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt_interfaces.payload import Payload
from rwt_program.qos import LATCHED

if TYPE_CHECKING:
    from rwt_graph.api import Participant, Publisher
    from rwt_graph.clock import Clock
    from rwt_interfaces.registry import Registry


class ConnectedClients:
    """One latched publisher of each topic, whatever the number of listeners, saying 0 and [] at first.

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
