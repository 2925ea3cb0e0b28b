"""`python -m bench.network.webrtc_video`: its viewers see the camera, and the time in a picture is read."""

from __future__ import annotations

import time

import anyio
import numpy as np

from bench.network.webrtc_video import Seen, count_colour, encoder_seconds
from bench.paper.camera import mark


def test_viewers_see_the_camera_and_the_encoder_is_timed() -> None:
    assert anyio.run(encoder_seconds, 2, 0.3) > 0


def test_the_age_of_a_picture_is_read_from_it() -> None:
    picture = np.zeros((480, 640, 3), np.uint8)
    mark(picture, 7, time.time_ns() // 1_000_000 - 5_000)
    seen: Seen = []
    count_colour(seen, picture)
    ((_, age),) = seen
    assert 5.0 <= age < 60.0
