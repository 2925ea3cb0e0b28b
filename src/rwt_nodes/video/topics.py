"""Which topics hold pictures, and which of them a request means."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from rwt_nodes.video.errors import RequestRefused
from rwt_nodes.video.stream_request import StreamRequest

if TYPE_CHECKING:
    from rwt_graph.api import Graph
    from rwt_transports.http import Reader

RAW: Final = "sensor_msgs/Image"
COMPRESSED: Final = "sensor_msgs/CompressedImage"
INFO: Final = "sensor_msgs/CameraInfo"


def type_of(graph: Graph, topic: str) -> str | None:
    """A topic's type by its two-part name; None while there is no such topic, or it has no type."""
    info = graph.topic(topic)
    return info.type.name if info is not None and info.type is not None else None


def topics_of(graph: Graph, type: str, reader: Reader) -> list[str]:
    """The topics of a type that somebody may see, sorted."""
    return sorted(
        topic.name
        for topic in graph.topics()
        if topic.type is not None and topic.type.name == type and reader.may_subscribe(topic.name)
    )


def meant_topic(graph: Graph, stream: StreamRequest, reader: Reader) -> str | None:
    """The topic to listen to; None while there is none.

    As image_transport names them, a camera's compressed pictures are below its raw ones. They are taken when
    they are asked for, and when there are no others (web_video_server shows nothing then).

    Raises:
        RequestRefused: 403 for a topic that may not be seen, 400 for one that holds no pictures.
    """
    if not reader.may_subscribe(stream.topic):
        raise RequestRefused(403, f"you may not subscribe to {stream.topic}")
    own = type_of(graph, stream.topic)
    below = "compressedDepth" if stream.transport == "compressedDepth" else "compressed"
    compressed = f"{stream.topic}/{below}"
    has_compressed = type_of(graph, compressed) == COMPRESSED and reader.may_subscribe(compressed)
    wants_compressed = stream.prefers_compressed or stream.transport != "raw"
    if has_compressed and (wants_compressed or own is None):
        return compressed
    if own not in (RAW, COMPRESSED, None):
        raise RequestRefused(400, f"{stream.topic} is a {own}; pictures are {RAW} and {COMPRESSED}")
    return stream.topic if own is not None else None


def not_found(graph: Graph, topic: str, reader: Reader) -> RequestRefused:
    """That a topic is not there, and which are."""
    known = [*topics_of(graph, RAW, reader), *topics_of(graph, COMPRESSED, reader)]
    return RequestRefused(404, f"there is no topic {topic}; image topics are: {', '.join(known) or 'none'}")


def on_topic(graph: Graph, stream: StreamRequest, topic: str) -> StreamRequest:
    """The request with what the choice of the topic has settled, so that equal ones are equal."""
    passes_on = stream.prefers_compressed and type_of(graph, topic) == COMPRESSED
    return replace(stream, topic=topic, transport="raw", prefers_compressed=passes_on)
