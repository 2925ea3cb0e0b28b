"""A camera of 640x480 at 30 Hz behind the server under test: `python -m bench.paper.camera`.

It drives in a circle through the demo's house, ten seconds a round. The pictures are drawn once, with the
noise that a sensor has, and kept in a file; playing them costs next to nothing. Each carries its number and
the time of its publishing in a row of black and white squares, which every codec leaves readable.
"""

from __future__ import annotations

import math
import time
from functools import partial
from pathlib import Path
from typing import Any, Final

import anyio
import numpy as np
from numpy.typing import NDArray

from rwt import Server
from rwt.extensions.demo.world.lens import Lens
from rwt.extensions.demo.world.map import Pose, house
from rwt.extensions.demo.world.view import View
from rwt_graph import Node
from rwt_transports.http.routes import Audience, HttpExtension, HttpRequest, HttpResponse, Reader, Route
from rwt_webrtc.settings import WebRtcSettings

Picture = NDArray[np.uint8]

RATE: Final = 30
PICTURES: Final = 10 * RATE
TOPIC: Final = "/camera/image_raw"
CACHE: Final = Path("build/paper/camera.npy")
NOISE: Final = 2.0
"""Standard deviation of every value, of 255."""
_SQUARE: Final = 16
_NUMBER_BITS: Final = 12
_BITS: Final = 40
MARKED_ROWS: Final = _SQUARE
"""Rows that hold the squares and are no part of the picture."""


def pictures() -> NDArray[np.uint8]:
    """All pictures of a round, from the file, which is made the first time."""
    if not CACHE.exists():
        CACHE.parent.mkdir(parents=True, exist_ok=True)
        half_made = CACHE.with_suffix(".part.npy")
        np.save(half_made, _drawn())
        half_made.rename(CACHE)
    loaded: NDArray[np.uint8] = np.load(CACHE, mmap_mode="r")
    return loaded


def _drawn() -> NDArray[np.uint8]:
    view, rng = View(house(), Lens(), 0.3), np.random.default_rng(1)
    drawn = np.empty((PICTURES, 480, 640, 3), np.uint8)
    for number in range(PICTURES):
        angle = math.tau * number / PICTURES
        pose = Pose(0.7 + math.cos(angle), -1.9 + math.sin(angle), angle + math.pi / 2)
        clean = view.colours(view.cast_rays(pose))
        noise = rng.normal(0, NOISE, clean.shape)
        drawn[number] = np.clip(clean + noise + 0.5, 0, 255)
    return drawn


def mark(picture: Picture, number: int, milliseconds: int) -> None:
    """Write a picture's number and the time into its first rows."""
    bits = (milliseconds % (1 << (_BITS - _NUMBER_BITS))) << _NUMBER_BITS | number
    row = np.array([255 if bits >> at & 1 else 0 for at in range(_BITS)], np.uint8).repeat(_SQUARE)
    picture[:_SQUARE] = row[None, :, None]


def read_mark(picture: Picture) -> tuple[int, int]:
    """The number, and the milliseconds that have passed since the time in a picture."""
    middles = picture[_SQUARE // 2, _SQUARE // 2 :: _SQUARE, 1]
    bits = sum(1 << at for at, value in enumerate(middles) if value > 127)
    wrap = 1 << (_BITS - _NUMBER_BITS)
    return bits % (1 << _NUMBER_BITS), (time.time_ns() // 1_000_000 - (bits >> _NUMBER_BITS)) % wrap


async def play(node: Node) -> None:
    """Publish for ever, at the rate, to those who listen."""
    topic = node.advertise(TOPIC, "sensor_msgs/Image")
    sequence = pictures()
    begun, count = anyio.current_time(), 0
    while True:
        count += 1
        await anyio.sleep_until(begun + count / RATE)
        if topic.subscriber_count:
            topic.publish(_message(sequence, count % PICTURES))


def _message(sequence: NDArray[np.uint8], number: int) -> dict[str, Any]:
    picture = np.array(sequence[number])
    now = time.time_ns()
    mark(picture, number, now // 1_000_000)
    seconds, nanoseconds = divmod(now, 1_000_000_000)
    return {
        "header": {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": "camera"},
        "width": 640,
        "height": 480,
        "encoding": "rgb8",
        "step": 1920,
        "data": picture.tobytes(),
    }


def _latency_page(request: HttpRequest, reader: Reader) -> HttpResponse:
    """Return the page that measures the age of images, for :mod:`bench.page.latency`."""
    return HttpResponse(
        Path(__file__).with_name("latency.html").read_bytes(), content_type="text/html; charset=utf-8"
    )


LATENCY_PAGE: Final = HttpExtension((Route("/latency.html", _latency_page, Audience.ADMITTED),))


def main() -> None:
    peers = WebRtcSettings(enabled=True)
    nodes = ("web_video_server", "rosapi")
    server = Server("ws://127.0.0.1:0", http=[LATENCY_PAGE], nodes=nodes, webrtc=peers)
    camera = server.node("camera")
    server.graph.spawn(partial(play, camera), "camera")
    server.run()


if __name__ == "__main__":
    main()
