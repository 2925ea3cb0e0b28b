"""What a gateway is to the server that starts it: a protocol in front of the graph, beside rosbridge."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from rwt.access.access import Access
    from rwt.access.client_graph import ClientGraph
    from rwt.access.graph_view import GraphView
    from rwt.delivery.shared_graph import SharedGraph
    from rwt_graph.api import Graph
    from rwt_transports.endpoint import Endpoint, PeerInfo, Sink
    from rwt_transports.http.routes import HttpExtension


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


class GatewayClient(Protocol):
    """A connected client of a gateway, as far as it is counted.

    Attributes:
        messages: how many have come from it.
    """

    messages: int

    @property
    def number(self) -> int:
        """Counts the clients of the gateway."""

    @property
    def sink(self) -> Sink:
        """Its connection."""

    @property
    def graph(self) -> ClientGraph:
        """The graph as it may see it."""


class Counted(Protocol):
    """What is counted alike of every gateway.

    Attributes:
        name: the protocol, as metrics call it.
        shared: the part in the graph that all clients share, with what it counts.
        clients: those that are connected; none where there are only requests over HTTP, which are counted as
            they pass (:mod:`rwt.delivery.http_traffic`).
    """

    @property
    def name(self) -> str:
        """See above."""

    @property
    def shared(self) -> SharedGraph:
        """See above."""

    @property
    def clients(self) -> Sequence[GatewayClient]:
        """See above."""


class Gateway(Counted, Protocol):
    """A protocol in front of the graph, from its construction until it is closed. It translates frames and
    requests to verbs of the graph as a client may see it (:meth:`rwt.access.access.Access.client`), and knows
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
        (:meth:`rwt.access.admission.Admission.role_now`), and end what that does not allow."""

    def close(self) -> None:
        """Leave the graph; its clients are gone already."""


MakeGateway = Callable[["Graph", "Access"], Gateway]
"""Makes a gateway in front of a graph that runs."""
