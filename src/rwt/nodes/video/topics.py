"""Image topics: those that a reader may subscribe to, and the one that a request means."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from rwt.media.errors import RequestRefused
from rwt.media.stream_request import COMPRESSED, RAW, StreamRequest
from rwt_graph.api import Graph
from rwt_transports.http.routes import Reader

INFO: Final = "sensor_msgs/CameraInfo"


class VisibleTopics:
    """Topics of a graph that one reader may subscribe to.

    The pages of this package have no other access to the graph, so they cannot reveal a hidden topic.
    """

    def __init__(self, graph: Graph, reader: Reader) -> None:
        self._graph = graph
        self.reader = reader

    def of_types(self, *types: str) -> list[str]:
        """Return the topics of some types (two-part names), sorted."""
        return sorted(
            topic.name
            for topic in self._graph.topics()
            if topic.type is not None and topic.type.name in types and self.reader.may_subscribe(topic.name)
        )

    def type_of(self, topic: str) -> str | None:
        """Return the two-part type name of a topic; None if it is hidden, unknown or without a type."""
        info = self._graph.topic(topic) if self.reader.may_subscribe(topic) else None
        return info.type.name if info is not None and info.type is not None else None

    def require(self, topic: str) -> None:
        """Check that the reader may subscribe to a topic, whether it exists or not.

        Raises:
            RequestRefused: the reader may not (403).
        """
        if not self.reader.may_subscribe(topic):
            raise RequestRefused(403, f"you may not subscribe to {topic}")

    def resolve(self, request: StreamRequest) -> StreamRequest | None:
        """Return the request with the topic to subscribe to; None if there is none yet.

        Compressed images have a topic below the raw ones, as in image_transport. It is used on request, and
        if there is no raw topic (where web_video_server shows nothing).

        Raises:
            RequestRefused: the topic has no images (400).
        """
        own = self.type_of(request.topic)
        below = "compressedDepth" if request.transport == "compressedDepth" else "compressed"
        compressed = f"{request.topic}/{below}"
        has_compressed = self.type_of(compressed) == COMPRESSED
        wants_compressed = request.prefers_compressed or request.transport != "raw"
        if has_compressed and (wants_compressed or own is None):
            return replace(request, topic=compressed, transport="raw")
        if own is None:
            return None
        if own not in (RAW, COMPRESSED):
            raise RequestRefused(400, f"{request.topic} is a {own}; pictures are {RAW} and {COMPRESSED}")
        passes_on = request.prefers_compressed and own == COMPRESSED
        return replace(request, transport="raw", prefers_compressed=passes_on)

    def not_found(self, topic: str) -> RequestRefused:
        """Return the error for a missing topic, with the topics that exist."""
        known = ", ".join(self.of_types(RAW, COMPRESSED)) or "none"
        return RequestRefused(404, f"there is no topic {topic}; image topics are: {known}")
