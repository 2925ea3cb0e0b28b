"""Sending of a local publisher's samples to other processes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import zenoh
from zenoh.ext import CacheConfig, declare_advanced_publisher

from rwt.extensions.zenoh.rmw import attachment
from rwt_graph.backend import KEEP_ALL_LIMIT, MemoryPublisher
from rwt_participant.qos import History, Reliability

if TYPE_CHECKING:
    from rwt.extensions.zenoh.link import Presence, ZenohLink
    from rwt.extensions.zenoh.rmw.tokens import TokenEndpoint
    from rwt_graph.api import Sample

_GID_SIZE = 16


class ZenohPublisher:
    """Sender of a publisher's samples over Zenoh, numbered from 1 as in rmw_zenoh."""

    def __init__(
        self, link: ZenohLink, end: TokenEndpoint, publisher: MemoryPublisher, presence: Presence
    ) -> None:
        self._presence = presence
        self._gid = presence.gid
        self._sequence = 0
        self._publisher = publisher
        self._sender = _declare(link, end, is_cached=publisher.cache is not None)
        publisher.connect_remote(self._send, self._send_if_matched)

    def _send_if_matched(self, sample: Sample) -> None:
        if self._sender.matching_status.matching:  # type: ignore[union-attr]  # zenoh returns a MatchingStatus, its stub says bool
            self._send(sample)

    def _send(self, sample: Sample) -> None:
        self._sequence = sequence = self._sequence + 1
        self._sender.put(
            sample.payload.cdr(), attachment=attachment.pack(sequence, sample.stamp_ns, _GID_SIZE, self._gid)
        )

    def close(self) -> None:
        """Undeclare the publisher with its cache and its token."""
        self._publisher.on_publish_remote = None
        self._presence.end()
        self._sender.undeclare()  # type: ignore[no-untyped-call]  # zenoh's stubs lack its return type


def _declare(
    link: ZenohLink, end: TokenEndpoint, *, is_cached: bool
) -> zenoh.Publisher | zenoh.ext.AdvancedPublisher:
    session, key, qos = link.session, end.data_key(link.domain), end.qos
    # As in rmw_zenoh: only keep-all waits for slow receivers.
    reliability, congestion = zenoh.Reliability.RELIABLE, zenoh.CongestionControl.DROP
    if qos.reliability is Reliability.BEST_EFFORT:
        reliability = zenoh.Reliability.BEST_EFFORT
    elif qos.history is History.KEEP_ALL:
        congestion = zenoh.CongestionControl.BLOCK
    remote = zenoh.Locality.REMOTE
    if not is_cached:
        return session.declare_publisher(
            key, reliability=reliability, congestion_control=congestion, allowed_destination=remote
        )
    return declare_advanced_publisher(
        session,
        key,
        reliability=reliability,
        congestion_control=congestion,
        allowed_destination=remote,
        cache=CacheConfig(KEEP_ALL_LIMIT if qos.history is History.KEEP_ALL else max(1, qos.depth)),
        publisher_detection=True,
    )
