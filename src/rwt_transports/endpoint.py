"""Contract between a transport and the protocol above it: endpoints, sinks and flows."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from time import time_ns
from typing import Protocol, runtime_checkable

from rwt_protocol.frames import Burst, Frame
from rwt_transports.shared_pool import Holder


class DropReason(StrEnum):
    """Reason why a message of the data lane was not sent."""

    QUEUE = "queue"
    """The subscription's own queue is full."""
    BACKLOG = "backlog"
    """The peer reads too slowly: the queue of all its topics together is full."""
    LIFESPAN = "lifespan"
    """The message is older than its lifespan."""
    SIZE = "size"
    """The message exceeds the client's size limit."""
    THROTTLE = "throttle"
    """The subscriber's throttle rate does not allow it yet."""


@dataclass(frozen=True, slots=True)
class FlowRules:
    """Rules for the messages of one topic while the peer reads too slowly.

    Attributes:
        depth: messages that may wait, the newest stay; None: as many as the data lane has room for.
        keep_all: True if messages of topics without this are dropped first.
        notes: True for a few small messages of the server itself, which never displace other topics.
    """

    depth: int | None = None
    keep_all: bool = False
    notes: bool = False


AS_MANY_AS_FIT = FlowRules()


class Flow(Protocol):
    """Messages of one topic to one peer, in the data lane: in order; the oldest are dropped.

    After the end of the connection, every method is a no-op.
    """

    def send(self, frame: Frame) -> None:
        """Queue one message of one frame."""

    def join(self, burst: Burst) -> bool:
        """Queue the frames of a burst, also later ones until it is sealed. Returns False, without effect, if
        each frame must be sent separately.
        """

    def send_message(self, pieces: Sequence[Frame], expires_ns: int = 0) -> None:
        """Queue one message of one or more frames: all of them are sent, or none.

        Args:
            pieces: the frames, in order; messages of other flows may come between them.
            expires_ns: the time on the flow's clock after which the message is dropped if its first frame
                still waits; 0 for never.
        """

    def configure(self, rules: FlowRules) -> None:
        """Replace the rules; the queue is cut to the new depth."""

    def close(self) -> None:
        """Stop reporting drops. Queued messages are still sent."""


class Feed(Flow, Protocol):
    """Flow to several clients behind one line: each message crosses the line once."""

    def set_period(self, seconds: float) -> None:
        """Announce the minimum time between two messages; 0.0 if all are sent."""


class Membership(Protocol):
    """Membership of one client in a feed.

    Attributes:
        feed: feed of all members with the same key behind the same line.
    """

    feed: Feed

    def wish(self, throttle: float, queue: int, *, apart: bool) -> None:
        """State what the client wants; applies to the messages sent afterwards.

        Args:
            throttle: minimum seconds between two messages, which the far end of the line ensures.
            queue: messages that wait for the throttle.
            apart: True to deliver only what is sent through the client's own flow.
        """

    def leave(self) -> None:
        """End the membership."""


@runtime_checkable
class FeedFlow(Protocol):
    """Flow of a client behind a line that other clients share, such as the uplink to a hub."""

    def enter(self, key: Hashable, gap: bytes = b"") -> Membership | None:
        """Become a member of the feed of that key; None if there is no place for it.

        From then on, what is sent through this flow follows the feed's own messages.

        Args:
            gap: what fills the gap of each :class:`~rwt_protocol.frames.GapFrame`.
        """


@dataclass(frozen=True, slots=True)
class PeerInfo:
    """Peer of a connection, as known when it opens.

    Attributes:
        transport: URL scheme, for example ``ws``.
        address: the peer's address without its port; empty if it has none.
        port: the peer's port; 0 if it has none.
        path: path and query of the request, for transports that have one.
        headers: request headers, names in lower case, for transports that have them.
        max_message_size: bytes of the largest message that the transport can carry to this peer; 0 for any.
        subprotocol: agreed subprotocol of the WebSocket; empty if none.
    """

    transport: str
    address: str = ""
    port: int = 0
    path: str = "/"
    headers: Mapping[str, str] = field(default_factory=dict)
    max_message_size: int = 0
    subprotocol: str = ""


@dataclass(frozen=True, slots=True)
class Traffic:
    """Counters of a connection: sent, queued and dropped.

    Attributes:
        messages: frames handed to the writer.
        bytes: bytes handed to the network, including those of the wire's protocol.
        queued_messages: messages queued in the lanes.
        queued_bytes: bytes queued in the lanes and in front of them.
        dropped: messages of the data lane that were dropped, by reason.
        received_bytes: bytes received, including those of the wire's protocol.
    """

    messages: int = 0
    bytes: int = 0
    queued_messages: int = 0
    queued_bytes: int = 0
    dropped: Mapping[DropReason, int] = field(default_factory=dict)
    received_bytes: int = 0


class Sink(Protocol):
    """Output of an endpoint: one control lane, and a data lane with one flow per topic.

    Methods are synchronous, do not block, and are called on the loop's thread.
    """

    def send(self, frame: Frame) -> None:
        """Queue one frame in the control lane: replies, requests, goals, status.

        Frames are never dropped; too many end the connection with a reason. No-op after :meth:`close` or
        connection loss.
        """

    def flow(
        self,
        topic: str,
        rules: FlowRules = AS_MANY_AS_FIT,
        *,
        on_drop: Callable[[DropReason], None] | None = None,
        time_ns: Callable[[], int] = time_ns,
    ) -> Flow:
        """Return a flow of the data lane for samples: slow readers lose the oldest of the same topic.

        Args:
            topic: name of the flow.
            rules: rules of its queue while the reader is slow.
            on_drop: called for each message that is dropped.
            time_ns: clock of `expires_ns`.
        """

    def close(self, code: int = 1000, reason: str = "") -> None:
        """Close the connection after sending the control lane. RFC 6455 section 7.4 lists the codes."""

    def hand_over(self, endpoint: Endpoint) -> None:
        """Replace the current endpoint by `endpoint` from the next message on.

        The replaced endpoint is not called again, not even its `closed`. If the connection has ended,
        `endpoint` is closed at once. Not for use within the accept function, which returns an endpoint.
        """

    def count_for(self, holder: Holder) -> None:
        """Count the connection, and its incomplete messages from now on, to another client."""

    @property
    def received(self) -> int:
        """Number of received bytes, including the whole current read; identifies the read of a message."""

    @property
    def backlog(self) -> int:
        """Bytes queued and not yet handed to the network."""

    @property
    def traffic(self) -> Traffic:
        """Counts since the connection began."""


class Endpoint(Protocol):
    """Receiver of one peer's messages. Its methods are called on the event loop's thread and do not block."""

    def receive(self, data: bytes, binary: bool) -> None:
        """Process one whole message, in order. Never raises."""

    def closed(self, code: int, reason: str) -> None:
        """Called exactly once, last, when the connection has ended. Never raises."""


Accept = Callable[[Sink, PeerInfo], Endpoint]
"""Called by a listener for each new connection, before its first frame."""

Admit = Callable[[PeerInfo], Awaitable[Accept]]
"""Coroutine function that decides about a WebSocket before it opens, and returns the accept function for it;
raises :exc:`~rwt_transports.errors.Refused`."""

Identify = Callable[[PeerInfo], str | None]
"""Returns the name of the credential that a connection or request presents; empty if it needs none. None: it
is not admitted without another."""


def anonymous(info: PeerInfo) -> str:
    """Return an empty name: no credentials are needed. The default :data:`Identify`."""
    return ""
