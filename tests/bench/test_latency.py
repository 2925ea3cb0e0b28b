"""`python -m bench.page.latency`: what counts as late. That pictures are seen is a test of tests/browser."""

from __future__ import annotations

from bench.page.latency import Seen, missed


def test_the_bounds_are_on_the_medians_of_mjpeg_and_webrtc() -> None:
    quick = Seen("type=mjpeg", [40, 45, 60, 400, 500])
    slow = Seen("type=mjpeg&quality=95", [40, 45, 61, 62, 63])
    video = Seen("type=vp8", [1500, 1600, 1700])
    assert quick.median == 60
    element = Seen("element=WebRTC", [79, 81, 90])
    assert missed([quick, slow, video, element]) == [
        "type=mjpeg&quality=95: median 61 ms, bound 60 ms",
        "element=WebRTC: median 81 ms, bound 80 ms",
    ]
