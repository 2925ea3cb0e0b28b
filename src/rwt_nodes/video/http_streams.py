"""The bodies of HTTP responses: a multipart stream of pictures, or a video."""

from __future__ import annotations

from collections.abc import AsyncGenerator, Callable
from typing import Final

from rwt_nodes.video.broadcast import Viewer
from rwt_nodes.video.encoders.encoded import Encoded, Track
from rwt_nodes.video.encoders.mp4 import Mp4
from rwt_nodes.video.encoders.webm import Webm
from rwt_nodes.video.stream_metrics import Counts

BOUNDARY: Final = "boundarydonotcross"
MULTIPART: Final = f"multipart/x-mixed-replace;boundary={BOUNDARY}"

Join = Callable[[], Viewer]


async def multipart(join: Join, counts: Counts) -> AsyncGenerator[bytes, None]:
    """Pictures as parts (RFC 2046 section 5.1).

    The boundary after a part goes out with it, not with the next: browsers show a part when they see its end.
    """
    viewer = join()
    try:
        yield f"--{BOUNDARY}\r\n".encode()
        while (picture := await viewer.next()) is not None:
            part = _part(picture)
            counts.sent += 1
            counts.sent_bytes += len(part)
            yield part
    finally:
        viewer.leave()


def _part(picture: Encoded) -> bytes:
    head = (
        f"Content-type: {picture.media_type}\r\n"
        f"X-Timestamp: {timestamp(picture)}\r\n"
        f"Content-Length: {len(picture.data)}\r\n\r\n"
    )
    return b"".join((head.encode(), picture.data, f"\r\n--{BOUNDARY}\r\n".encode()))


def timestamp(picture: Encoded) -> str:
    """The message's time in seconds, with six decimals, as web_video_server writes it."""
    seconds, rest = divmod(picture.stamp_ns // 1000, 1_000_000)
    return f"{seconds}.{rest:06d}"


async def video_stream(join: Join, counts: Counts) -> AsyncGenerator[bytes, None]:
    """A video that begins with the viewer's first picture, at its time 0."""
    viewer = join()
    try:
        container: Webm | Mp4 | None = None
        began = 0
        while (picture := await viewer.next()) is not None:
            opening = b""
            if container is None:
                assert picture.track is not None  # Videos are made of nothing else.
                container, began = _container(picture.track), picture.at_ms
                opening = container.header()
            part = opening + container.picture(picture.data, picture.at_ms - began, key=picture.key)
            counts.sent += 1
            counts.sent_bytes += len(part)
            yield part
    finally:
        viewer.leave()


def _container(track: Track) -> Webm | Mp4:
    if track.codec == "h264":
        return Mp4(track.width, track.height, track.parameters)
    return Webm(track.codec, track.width, track.height)
