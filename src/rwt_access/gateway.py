"""What a gateway is to the server that starts it: a protocol in front of the graph, beside rosbridge."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from rwt_access.access import Access
    from rwt_access.graph_view import GraphView
    from rwt_graph.api import Graph
    from rwt_protocol.transport import Endpoint, PeerInfo, Sink
    from rwt_transports.http import HttpExtension


class AcceptPeer(Protocol):
    """Takes in a client of a gateway."""

    def __call__(self, sink: Sink, info: PeerInfo, *, loopback: bool) -> Endpoint:
        """Take in a new client.

        Args:
            sink: where to write to it.
            info: what the transport knows of it.
            loopback: whether it came over a listener that is only reached from this machine.

        Raises:
            Refused: it may not come in.
        """


class Gateway(Protocol):
    """A protocol in front of the graph, from its construction until it is closed. It translates frames and
    requests to verbs of the graph as a client may see it (:meth:`rwt_access.access.Access.client`), and knows
    no rule.

    Attributes:
        websockets: the WebSocket subprotocols that it speaks, and what takes in their clients.
        http: its pages, its section of the index, and its metrics.
    """

    @property
    def websockets(self) -> Mapping[str, AcceptPeer]:
        """See above."""

    @property
    def http(self) -> HttpExtension[GraphView]:
        """See above."""

    def reload_roles(self) -> None:
        """Give each connected client the role that the settings give it now
        (:meth:`rwt_access.admission.Admission.role_now`), and end what that does not allow."""

    def close(self) -> None:
        """Leave the graph; its clients are gone already."""


MakeGateway = Callable[["Graph", "Access"], Gateway]
"""Makes a gateway in front of a graph that runs."""
