"""Metrics of streams, for `/metrics`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from rwt_transports.http.routes import MetricFamily

#: Maximum number of topics and types with counters of their own.
MAX_STREAMS = 1000
_OTHERS = ("", "")


@dataclass(slots=True)
class Counts:
    """Totals of one topic and type since the start.

    Attributes:
        skipped: number of messages not encoded: no viewer had room, or the codec left them out.
        dropped: number of encoded images that a viewer did not receive.
        failed: number of messages that could not be encoded.
        sent_bytes: number of bytes sent to viewers.
        complaint: last error that was logged.
    """

    encoded: int = 0
    skipped: int = 0
    dropped: int = 0
    failed: int = 0
    sent: int = 0
    sent_bytes: int = 0
    complaint: str = ""


class StreamMetrics:
    """Totals of every stream since the start."""

    def __init__(self) -> None:
        self._counts: dict[tuple[str, str], Counts] = {}

    def of(self, topic: str, type: str) -> Counts:
        """Return the counters of a stream; beyond :data:`MAX_STREAMS` streams, shared ones."""
        key = (topic, type)
        if key not in self._counts and len(self._counts) >= MAX_STREAMS:
            key = _OTHERS
        return self._counts.setdefault(key, Counts())

    def families(self, running: Iterable[tuple[str, str, int]]) -> Iterator[MetricFamily]:
        """Return the metric families: present viewers and encoders, and the totals.

        Args:
            running: topic, type and number of viewers of each running encoder.
        """
        viewers: Counter[tuple[str, str]] = Counter()
        encoders: Counter[tuple[str, str]] = Counter()
        for topic, type_, count in running:
            viewers[topic, type_] += count
            encoders[topic, type_] += 1
        for name, help_, now in (
            ("viewers", "Viewers of a topic's pictures now.", viewers),
            ("encoders", "Encoders of a topic's pictures now.", encoders),
        ):
            yield MetricFamily(f"rwt_video_{name}", "gauge", help_, _samples(now))
        for name, help_, attribute in (
            ("encoded_pictures", "Pictures encoded: once for all viewers who want the same.", "encoded"),
            ("skipped_messages", "Messages not encoded, for no viewer had room.", "skipped"),
            ("dropped_pictures", "Encoded pictures that a slow viewer did not get.", "dropped"),
            ("failed_messages", "Messages whose picture could not be encoded.", "failed"),
            ("sent_pictures", "Pictures handed to viewers' connections.", "sent"),
            ("sent_bytes", "Bytes handed to viewers' connections.", "sent_bytes"),
        ):
            counts = {key: getattr(count, attribute) for key, count in self._counts.items()}
            yield MetricFamily(f"rwt_video_{name}_total", "counter", help_, _samples(counts))


def _samples(values: dict[tuple[str, str], int]) -> list[tuple[Mapping[str, str], float]]:
    return [({"topic": topic, "type": type_}, value) for (topic, type_), value in sorted(values.items())]
