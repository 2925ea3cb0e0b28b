"""Bodies of HTTP responses: multipart streams of images, videos, and HTML pages."""

from __future__ import annotations

from collections.abc import AsyncGenerator, Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from html import escape
from typing import TYPE_CHECKING, Final
from urllib.parse import parse_qsl, urlencode

from rwt.media.broadcast import Viewer
from rwt.media.encoders.encoded import Encoded, Track
from rwt.media.stream_request import Jpeg, StreamRequest
from rwt_transports.errors import Refused

if TYPE_CHECKING:
    from rwt.media.encoders.mp4 import Mp4
    from rwt.media.encoders.webm import Webm

BOUNDARY: Final = "boundarydonotcross"
MULTIPART: Final = f"multipart/x-mixed-replace;boundary={BOUNDARY}"
MP4: Final = "video/mp4"
WEBM: Final = "video/webm"


async def multipart(
    join: Callable[[StreamRequest, Viewer | None], Viewer], ladder: QualityLadder, now: Callable[[], float]
) -> AsyncGenerator[bytes, None]:
    """Send images as parts (RFC 2046 section 5.1), in a quality for the viewer's connection.

    The boundary after a part is sent with it, not with the next: browsers show a part at its end.

    Args:
        join: adds a viewer, in place of another if one is given; raises `Refused` if there is no room for a
            further encoder.
        now: returns the seconds of a steady clock.
    """
    request = ladder.request
    viewer = join(request, None)
    try:
        yield f"--{BOUNDARY}\r\n".encode()
        while (image := await viewer.next()) is not None:
            part = _part(image)
            viewer.count_sent(len(part))
            began = now()
            yield part
            ladder.delivered(now() - began, now())
            if ladder.request != request:
                with suppress(Refused):
                    joined = join(ladder.request, viewer)
                    viewer.leave()
                    viewer, request = joined, ladder.request
    finally:
        viewer.leave()


def _part(image: Encoded) -> bytes:
    head = (
        f"Content-type: {image.media_type}\r\n"
        f"X-Timestamp: {timestamp(image)}\r\n"
        f"Content-Length: {len(image.data)}\r\n\r\n"
    )
    return b"".join((head.encode(), image.data, f"\r\n--{BOUNDARY}\r\n".encode()))


def timestamp(image: Encoded) -> str:
    """Return the time of the message in seconds, with six decimals as in web_video_server."""
    seconds, rest = divmod(image.stamp_ns // 1000, 1_000_000)
    return f"{seconds}.{rest:06d}"


async def video_stream(join: Callable[[], Viewer]) -> AsyncGenerator[bytes, None]:
    """Send a video that begins with the viewer's first image, at time 0. Frames that are late when the
    connection can take them are left out.
    """
    viewer = join()
    try:
        container: Webm | Mp4 | None = None
        began = 0
        while (image := await viewer.next()) is not None:
            opening = b""
            if container is None:
                assert image.track is not None  # Videos are made of nothing else.
                container, began = container_of(image.track), image.at_ms
                opening = container.header()
            part = opening + container.frame(image.data, image.at_ms - began, key=image.key)
            viewer.count_sent(len(part))
            yield part
            viewer.skip_late()
    finally:
        viewer.leave()


def container_of(track: Track) -> Webm | Mp4:
    """Return the container of a video, whose module few servers need."""
    if track.codec == "h264":
        from rwt.media.encoders.mp4 import Mp4

        return Mp4(track.width, track.height, track.parameters)
    from rwt.media.encoders.webm import Webm

    return Webm(track.codec, track.width, track.height)


_VIEWER = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<title>{topic}</title>
<style>body {{ font: 16px/1.5 system-ui, sans-serif; margin: 1rem }} img, video {{ max-width: 100% }}</style>
<h1>{topic}</h1>
{element}
"""

_VIDEO = """<video src="{source}" autoplay muted playsinline></video>
<p role="status"></p>
<script>{script}</script>"""

VIDEO_SCRIPT = """
// autoplay alone waits until the player believes that it could play to the end: of a live video that is late.
// A browser gathers some seconds before it begins, and would stay behind: play faster until caught up.
const video = document.querySelector("video");
video.oncanplay = () => video.play();
video.onprogress = video.ontimeupdate = () => {
  const parts = video.buffered;
  const behind = parts.length ? parts.end(parts.length - 1) - video.currentTime : 0;
  video.playbackRate = behind > 1 ? 2 : behind > 0.4 ? 1.2 : 1;
};
// How far the video is behind its fastest arrival. It forgets 0.1 ms per second, since clocks differ.
let fastest = Infinity;
setInterval(() => {
  const parts = video.buffered;
  if (!parts.length) return;
  const now = performance.now() / 1000;
  fastest = Math.min(fastest + 0.25e-4, now - parts.end(parts.length - 1));
  const age = now - fastest - video.currentTime;
  const isOld = age > 1;
  video.style.filter = isOld ? "grayscale(1) opacity(0.5)" : "";
  document.querySelector("p").textContent = isOld ? `The image is ${age.toFixed(1)} s old` : "";
}, 250);
"""
"""The script of the page that shows a video. Images older than a second are grey, and show their age."""


def viewer_page(topic: str, query: str, *, video: bool) -> bytes:
    """Return the page of `/stream_viewer`, which shows `/stream` with the same query."""
    source = escape(f"stream?{query}")
    element = (
        _VIDEO.format(source=source, script=VIDEO_SCRIPT)
        if video
        else f'<img src="{source}" alt="{escape(topic)}">'
    )
    return _VIEWER.format(topic=escape(topic), element=element).encode()


def topic_list(topics: Iterable[str], infos: Sequence[str], query: str) -> str:
    """Return the image topics with links as HTML, grouped by camera.

    Args:
        query: query of the enclosing page: its token is added to the links.
    """
    bases = [info.removesuffix("camera_info") for info in infos if info.endswith("/camera_info")]
    cameras: dict[str, list[str]] = {}
    for topic in topics:
        # The longest: /camera/depth/ has its own info, and is below /camera/.
        base = max((base for base in bases if topic.startswith(base)), key=len, default="")
        cameras.setdefault(base, []).append(topic)
    items = "".join(_camera(base, its, query) for base, its in sorted(cameras.items()))
    return f"<h2>Image topics</h2><ul>{items or '<li>none'}</ul>"


def _camera(base: str, topics: list[str], query: str) -> str:
    links = "".join(_links(topic, topic.removeprefix(base), query) for topic in topics)
    return f"<li>{escape(base)}<ul>{links}</ul>" if base else links


def _links(topic: str, shown: str, query: str) -> str:
    token = [pair for pair in parse_qsl(query) if pair[0] == "token"]
    asked = escape(urlencode([("topic", topic), *token], safe="/"))
    return (
        f'<li><a href="stream_viewer?{asked}">{escape(shown)}</a>'
        f' (<a href="stream?{asked}">Stream</a>) (<a href="snapshot?{asked}">Snapshot</a>)'
    )


RUNGS: Final = (Jpeg(), Jpeg(60), Jpeg(40, 0.75), Jpeg(25, 0.5), Jpeg(15, 0.5))
"""Images for slower and slower connections. Viewers on the same rung share an encoder."""
SLOW_SECONDS: Final = 0.2
"""Delivery time of an image above which smaller ones are sent."""
VERY_SLOW_SECONDS: Final = 0.6
FAST_SECONDS: Final = 0.07
"""Delivery time below which larger ones are tried."""
PATIENCE_SECONDS: Final = 4.0
"""Time of fast deliveries before that."""
MAX_PATIENCE_SECONDS: Final = 32.0


class QualityLadder:
    """Quality ladder of one viewer.

    Args:
        request: request of the viewer. A quality or size that it names is kept, and so are messages that it
            wants unchanged.
        now: time in seconds of a steady clock.

    Attributes:
        rung: index of the present request.
    """

    def __init__(self, request: StreamRequest, now: float) -> None:
        is_free = (
            request.coding == Jpeg()
            and request.width is None
            and request.height is None
            and not request.prefers_compressed
        )
        self._requests = tuple(replace(request, coding=each) for each in RUNGS) if is_free else (request,)
        self.rung = 0
        self._fast_since = now
        self._raised_at: float | None = None
        self._patience = PATIENCE_SECONDS

    @property
    def request(self) -> StreamRequest:
        """Present request."""
        return self._requests[self.rung]

    def delivered(self, seconds: float, now: float) -> None:
        """Handle the delivery time of an image."""
        if seconds > SLOW_SECONDS:
            if self._raised_at is not None and now - self._raised_at < self._patience:
                self._patience = min(2 * self._patience, MAX_PATIENCE_SECONDS)
            self._raised_at = None
            step = 2 if seconds > VERY_SLOW_SECONDS else 1
            self.rung = min(self.rung + step, len(self._requests) - 1)
            self._fast_since = now
        elif seconds > FAST_SECONDS:
            self._fast_since = now
        elif self.rung and now - self._fast_since >= self._patience:
            if self._raised_at is not None:
                self._patience = PATIENCE_SECONDS  # The last step up lasted.
            self.rung -= 1
            self._fast_since = self._raised_at = now
