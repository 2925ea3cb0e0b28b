"""Which topics hold images, which of them a reader may see, and which one a request means."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from rwt.media.errors import RequestRefused
from rwt.media.stream_request import COMPRESSED, RAW

if TYPE_CHECKING:
    from rwt.media.stream_request import StreamRequest
    from rwt_graph.api import Graph
    from rwt_transports.http.routes import Reader

INFO: Final = "sensor_msgs/CameraInfo"


class VisibleTopics:
    """The topics of a graph that one reader may subscribe to.

    The pages of this package know the graph's topics by this alone, so none of them can show a hidden one.

    Attributes:
        reader: who that is.
    """

    def __init__(self, graph: Graph, reader: Reader) -> None:
        self._graph = graph
        self.reader = reader

    def of_types(self, *types: str) -> list[str]:
        """The topics of these types, two-part names, sorted."""
        return sorted(
            topic.name
            for topic in self._graph.topics()
            if topic.type is not None and topic.type.name in types and self.reader.may_subscribe(topic.name)
        )

    def type_of(self, topic: str) -> str | None:
        """A topic's type by its two-part name; None for one that is hidden, not there, or without a type."""
        info = self._graph.topic(topic) if self.reader.may_subscribe(topic) else None
        return info.type.name if info is not None and info.type is not None else None

    def require(self, topic: str) -> None:
        """Refuse a request for a topic that the reader may not see, whether it is there or not.

        Raises:
            RequestRefused: with status 403.
        """
        if not self.reader.may_subscribe(topic):
            raise RequestRefused(403, f"you may not subscribe to {topic}")

    def resolve(self, request: StreamRequest) -> StreamRequest | None:
        """The request with the topic to listen to; None while there is none. Equal ones then are equal.

        As image_transport names them, a camera's compressed images are below its raw ones. They are taken
        when they are asked for, and when there are no others (web_video_server shows nothing then).

        Raises:
            RequestRefused: 400 for a topic that holds no images.
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
        """That a topic is not there, and which are."""
        known = ", ".join(self.of_types(RAW, COMPRESSED)) or "none"
        return RequestRefused(404, f"there is no topic {topic}; image topics are: {known}")
