"""Samples of one publisher on their way out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import zenoh
from zenoh.ext import CacheConfig, declare_advanced_publisher

from rwt_graph.memory.topics import KEEP_ALL_LIMIT
from rwt_graph.zenoh.rmw import attachment
from rwt_program.qos import History, QoS, Reliability

if TYPE_CHECKING:
    from rwt_graph.api import Sample
    from rwt_graph.memory.topics import MemoryPublisher
    from rwt_graph.zenoh.link import Link, Presence

_GID_SIZE = 16


class Outlet:
    """What a publisher's samples leave through; numbers them from 1, as rmw_zenoh does."""

    def __init__(self, link: Link, key: str, publisher: MemoryPublisher, presence: Presence) -> None:
        self._presence = presence
        self._gid = presence.gid
        self._sequence = 0
        # One of the two: a transient-local publisher's cache must have every sample, whoever listens.
        self._plain: zenoh.Publisher | None = None
        self._keeping: zenoh.ext.AdvancedPublisher | None = None
        if publisher.kept is None:
            self._plain = _plain(link.session, key, publisher.qos)
        else:
            self._keeping = _keeping(link.session, key, publisher.qos)
            for sample in publisher.kept.samples():
                self._send(self._keeping, sample)
        publisher.outward = self._take if self._plain is not None else self._take_and_keep

    def _take(self, sample: Sample) -> None:
        # Nobody elsewhere, no encoding.
        if self._plain is not None and self._plain.matching_status.matching:  # type: ignore[attr-defined] # The stub says bool.
            self._send(self._plain, sample)

    def _take_and_keep(self, sample: Sample) -> None:
        if self._keeping is not None:
            self._send(self._keeping, sample)

    def _send(self, publisher: zenoh.Publisher | zenoh.ext.AdvancedPublisher, sample: Sample) -> None:
        self._sequence = sequence = self._sequence + 1
        publisher.put(
            sample.payload.cdr(),
            attachment=attachment.pack(sequence, sample.stamp_ns, _GID_SIZE, self._gid),
        )

    def close(self) -> None:
        """Leave: the publisher, what it kept, and its being known."""
        self._presence.end()
        if self._plain is not None:
            self._plain.undeclare()
        if self._keeping is not None:
            self._keeping.undeclare()
        self._plain = self._keeping = None


def _flow(qos: QoS) -> tuple[zenoh.Reliability, zenoh.CongestionControl]:
    """As rmw_zenoh maps it: only who asked for every sample waits for slow receivers."""
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


def _keeping(session: zenoh.Session, key: str, qos: QoS) -> zenoh.ext.AdvancedPublisher:
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


__all__ = ["Outlet"]
