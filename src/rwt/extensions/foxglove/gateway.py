"""The Foxglove gateway: its clients, their shared state, and the announcement of changes of the graph."""

from __future__ import annotations

import html
from collections.abc import Mapping
from importlib.metadata import version
from types import MappingProxyType
from typing import Final
from uuid import uuid4

from rwt.access.access import Access
from rwt.access.decisions import READS
from rwt.access.graph_view import GraphView
from rwt.access.roles import Role
from rwt.access.settings import CALL_SECONDS, LINGER_SECONDS
from rwt.extensions.foxglove.assets import Pages
from rwt.extensions.foxglove.catalogue import Catalogue, RoleListing
from rwt.extensions.foxglove.client import FoxgloveClient
from rwt.extensions.foxglove.files_in_transit import FilesInTransit
from rwt.extensions.foxglove.parameters import GET, ParameterFeed
from rwt.extensions.foxglove.playback import PlaybackState, state_frame, state_of
from rwt.extensions.foxglove.wire.payloads import encodings
from rwt.extensions.foxglove.wire.server_messages import server_info, time
from rwt.gateways.base import ConnectionGateway
from rwt.gateways.visitors import url_of
from rwt_graph.api import Graph
from rwt_graph.clock import Playback
from rwt_participant.timers import Timer
from rwt_protocol.frames import Frame
from rwt_transports.endpoint import Endpoint, PeerInfo, Sink
from rwt_transports.errors import Refused
from rwt_transports.http.routes import HttpExtension, HttpRequest

NODE: Final = "/foxglove_bridge"
"""Absolute name of the node as which all clients act."""

SUBPROTOCOLS: Final = ("foxglove.sdk.v1", "foxglove.websocket.v1")
"""WebSocket subprotocols; both names stand for the same protocol."""

_LOOK_SECONDS: Final = 0.1
"""Interval at which the gateway checks the graph for changes, in seconds."""

_MAX_SHARE: Final = 0.1
"""Maximum share of time for announcing changes of the graph; beyond it, announcements are delayed."""

TIME_HZ: Final = 20.0
"""Rate at which simulated time is sent to clients, in Hz."""


class FoxgloveGateway(ConnectionGateway[FoxgloveClient]):
    """Foxglove's WebSocket protocol in front of a graph, as the node `/foxglove_bridge`.

    Attributes by purpose:

    * Settings: ``call_timeout``, ``pages``, ``playback``.
    * Files of packages for all clients: ``files``.
    * Announcements: ``_catalogue`` (ids of channels and services), ``_listings`` (what each role sees),
      ``_seen`` (version of the graph that all clients know), ``_look_timer`` (runs while clients are
      connected).
    * Time and playback: ``_sent_time``, ``_sent_playback``, ``_time_timer`` (runs while clients are
      connected, unless the clock is the wall clock).
    * Parameters: ``_feed``.

    Args:
        graph: the robot.
        access: access rules of the server.
        call_timeout: seconds that a service call may take; None: no timeout.
        linger: seconds that a publisher outlives its last user among the clients.
        pages: answers requests for files of packages; None without files.
    """

    name = "foxglove"
    verbs = ("advertise", "publisher", *READS)
    log_prefix = "foxglove "

    def __init__(
        self,
        graph: Graph,
        access: Access,
        call_timeout: float | None = CALL_SECONDS,
        linger: float = LINGER_SECONDS,
        pages: Pages | None = None,
    ) -> None:
        super().__init__(graph, access, NODE, linger)
        self.call_timeout = call_timeout
        self.pages = pages
        self.files = FilesInTransit(graph.clock.sleep)
        self.playback: Playback | None = graph.clock.playback
        self.websockets = MappingProxyType(dict.fromkeys(SUBPROTOCOLS, self.accept))
        self.http = HttpExtension(section=_section)
        self._graph = graph
        self._clock = graph.clock
        self._session_id = uuid4().hex
        self._catalogue = Catalogue(NODE)
        self._listings: dict[Role, RoleListing] = {}
        self._seen = -1
        self._feed = ParameterFeed(self.shared, self._send_parameters)
        self._look_timer: Timer | None = None
        self._time_timer: Timer | None = None
        self._sent_time = -1
        self._sent_playback: PlaybackState | None = None

    def accept(self, sink: Sink, info: PeerInfo, *, loopback: bool) -> Endpoint:
        """Accept a new client, see :class:`~rwt.gateways.base.AcceptPeer`."""
        role = self.access.admission.admit(info, loopback=loopback)
        if role is None:
            raise Refused(401, "Foxglove's protocol has no `auth` op: connect with a token (auth.tokens)")
        began = self._clock.monotonic()
        listing = self.listing(role)
        client = self.join(
            role, info, lambda number, graph: FoxgloveClient(self, number, sink, info, graph, listing)
        )
        # First, because it names the encodings and capabilities on which all other messages depend.
        sink.send(self._server_info(role))
        for frame in listing.welcome:
            sink.send(frame)
        if self.playback is not None:
            sink.send(state_frame(self.playback, did_seek=False))
        self._start_looking()
        # The first client of a role causes the encoding of its listing.
        client.graph.work.add(self._clock.monotonic() - began, "messages")
        return client

    def _server_info(self, role: Role) -> Frame:
        playback = self.playback
        return server_info(
            f"Robot Web Tools {version('robot-web-tools')}",
            self._capabilities(role),
            encodings(self._graph.distro),
            {"ROS_DISTRO": self._graph.distro.name},
            self._session_id,
            None if playback is None else (playback.start_ns, playback.end_ns),
        )

    def _capabilities(self, role: Role) -> list[str]:
        has = {
            "clientPublish": bool(role.globs["publish"]),
            "parameters": bool(role.globs["get_param"]) and self._graph.service(GET) is not None,
            "parametersSubscribe": bool(role.globs["get_param"]),
            "time": not self._clock.is_real,
            "services": bool(role.globs["call"]),
            "connectionGraph": True,
            "assets": self.pages is not None,
            "playbackControl": self.playback is not None,
        }
        return [capability for capability, is_there in has.items() if is_there]

    # -- announcements -------------------------------------------------------------------------------------

    def listing(self, role: Role) -> RoleListing:
        """Return the current listing of a role."""
        listing = self._listings.get(role)
        if listing is None:
            view = self.access.view(role, self.access.nobody.work)
            listing = self._listings[role] = RoleListing(self._catalogue, view)
            listing.refresh()
        elif self._seen != self._graph.version:
            # Announced to its other clients as well, since all of a role share the listing.
            self._announce(listing)
        return listing

    def _announce(self, listing: RoleListing) -> None:
        """Refresh the listing of a role, and announce the changes to its clients."""
        change = listing.refresh()
        clients = [client for client in self._clients.values() if client.listing is listing]
        if change.frames:
            for client in clients:
                client.take_change(change)
        if any(client.connections is not None for client in clients):
            connections = listing.connections()
            for client in clients:
                client.send_connections(connections)

    def _look(self) -> None:
        """Announce changes of the graph since the last call."""
        self._look_timer = None
        began = self._clock.monotonic()
        version = self._graph.version
        if version != self._seen:
            shown = {client.listing for client in self._clients.values()}
            self._listings = {role: each for role, each in self._listings.items() if each in shown}
            for listing in self._listings.values():
                self._announce(listing)
            self._catalogue.keep(self._listings.values())
            self._seen = version
        if self._clients:
            worked = self._clock.monotonic() - began
            self._look_timer = self._clock.call_later(max(_LOOK_SECONDS, worked / _MAX_SHARE), self._look)

    def _start_looking(self) -> None:
        if self._look_timer is None:
            self._look_timer = self._clock.call_later(_LOOK_SECONDS, self._look)
        if self._time_timer is None and not self._clock.is_real:
            self._time_timer = self._clock.call_later(0.0, self._send_time)

    def _send_time(self) -> None:
        """Send all clients the time and the playback state if they have changed."""
        self._time_timer = None
        now = self._clock.time_ns()
        # Times before the epoch cannot be sent: the protocol's are unsigned.
        if now != self._sent_time and now >= 0:
            self._sent_time = now
            frame = time(now)
            for client in self._clients.values():
                client.time.send(frame)
        if self.playback is not None:
            state, told = state_of(self.playback), self._sent_playback
            if state != told:
                self._sent_playback = state
                # The first state is no seek: clients have received the position on connecting.
                frame = state_frame(self.playback, did_seek=told is not None and state[2] != told[2])
                for client in self._clients.values():
                    client.replies.send(frame)
        if self._clients:
            self._time_timer = self._clock.call_later(1 / TIME_HZ, self._send_time)

    # -- parameters ----------------------------------------------------------------------------------------

    def watched(self) -> None:
        """Update the feed after a client changed the parameters that it watches."""
        clients = [client.parameters for client in self._clients.values()]
        names = {name for each in clients for name in each.watched}
        self._feed.watch(names, everything=any(each.watches_all for each in clients))

    def _send_parameters(self, values: Mapping[str, object]) -> None:
        for client in self._clients.values():
            client.parameters.changed(values)

    # -- life cycle ----------------------------------------------------------------------------------------

    def left(self, client: FoxgloveClient) -> None:
        """Remove a client whose connection has ended."""
        # The client is removed first, so that parameters which only it watched leave the feed.
        super().left(client)
        self.watched()

    def close(self) -> None:
        """Leave the graph."""
        self._feed.close()
        for timer in (self._look_timer, self._time_timer):
            if timer is not None:
                timer.cancel()
        super().close()


def _section(request: HttpRequest, reader: GraphView) -> str:
    return (
        "<h2>Foxglove and Lichtblick</h2><p>Open a connection, choose <em>Foxglove WebSocket</em>, and enter"
        f"<pre>{html.escape(url_of(request, 'ws'))}</pre>"
    )
