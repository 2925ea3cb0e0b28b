"""Sending of a local publisher's samples to other processes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import zenoh
from zenoh.ext import CacheConfig, declare_advanced_publisher

from rwt_graph.memory.topics import KEEP_ALL_LIMIT
from rwt_graph.zenoh.rmw import attachment
from rwt_participant.qos import History, QoS, Reliability

if TYPE_CHECKING:
    from rwt_graph.api import Sample
    from rwt_graph.memory.topics import MemoryPublisher
    from rwt_graph.zenoh.link import Link, Presence

_GID_SIZE = 16


class RemotePublisher:
    """Sender of a publisher's samples over Zenoh, numbered from 1 as in rmw_zenoh."""

    def __init__(self, link: Link, key: str, publisher: MemoryPublisher, presence: Presence) -> None:
        self._presence = presence
        self._gid = presence.gid
        self._sequence = 0
        # Only one is declared: a cache needs every sample, with and without subscribers.
        self._plain: zenoh.Publisher | None = None
        self._caching: zenoh.ext.AdvancedPublisher | None = None
        if publisher.cache is None:
            self._plain = _plain(link.session, key, publisher.qos)
        else:
            self._caching = _caching(link.session, key, publisher.qos)
            for sample in publisher.cache.samples():
                self._send(self._caching, sample)
        publisher.on_publish_remote = self._publish if self._plain is not None else self._publish_and_cache

    def _publish(self, sample: Sample) -> None:
        # Encode only for remote subscribers.
        if self._plain is not None and self._plain.matching_status.matching:  # type: ignore[attr-defined] # The stub says bool.
            self._send(self._plain, sample)

    def _publish_and_cache(self, sample: Sample) -> None:
        if self._caching is not None:
            self._send(self._caching, sample)

    def _send(self, publisher: zenoh.Publisher | zenoh.ext.AdvancedPublisher, sample: Sample) -> None:
        self._sequence = sequence = self._sequence + 1
        publisher.put(
            sample.payload.cdr(),
            attachment=attachment.pack(sequence, sample.stamp_ns, _GID_SIZE, self._gid),
        )

    def close(self) -> None:
        """Undeclare the publisher with its cache and its token."""
        self._presence.end()
        if self._plain is not None:
            self._plain.undeclare()
        if self._caching is not None:
            self._caching.undeclare()
        self._plain = self._caching = None


def _flow(qos: QoS) -> tuple[zenoh.Reliability, zenoh.CongestionControl]:
    """Return reliability and congestion control as in rmw_zenoh: only keep-all waits for slow receivers."""
    if qos.reliability is Reliability.BEST_EFFORT:
        return zenoh.Reliability.BEST_EFFORT, zenoh.CongestionControl.DROP
    if qos.history is History.KEEP_ALL:
        return zenoh.Reliability.RELIABLE, zenoh.CongestionControl.BLOCK
    return zenoh.Reliability.RELIABLE, zenoh.CongestionControl.DROP


def _plain(session: zenoh.Session, key: str, qos: QoS) -> zenoh.Publisher:
    reliability, congestion = _flow(qos)
    return session.declare_publisher(
        key,
        reliability=reliability,
        congestion_control=congestion,
        allowed_destination=zenoh.Locality.REMOTE,
    )


def _caching(session: zenoh.Session, key: str, qos: QoS) -> zenoh.ext.AdvancedPublisher:
    reliability, congestion = _flow(qos)
    depth = KEEP_ALL_LIMIT if qos.history is History.KEEP_ALL else max(1, qos.depth)
    return declare_advanced_publisher(
        session,
        key,
        reliability=reliability,
        congestion_control=congestion,
        allowed_destination=zenoh.Locality.REMOTE,
        cache=CacheConfig(depth),
        publisher_detection=True,
    )
