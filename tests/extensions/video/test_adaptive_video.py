"""Bit rates of adaptive videos, which follow the viewers' links."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from rwt.media.encoders.encoded import Encoded
from rwt.media.encoders.video import KEY_PERCENT, VideoEncoder
from rwt.media.stream_request import StreamRequest, Video
from rwt_interfaces.payload import Payload
from tests.extensions.video.conftest import image, payload

BITS = 1_000_000
HZ = 20


def images(count: int) -> Iterator[Payload]:
    """Noisy images, which take any bit rate."""
    rng = np.random.default_rng(1)
    scene = rng.integers(60, 190, (15, 20, 3)).repeat(16, axis=0).repeat(16, axis=1)
    for number in range(count):
        pixels = (np.roll(scene, 2 * number, axis=1) + rng.normal(0, 12, scene.shape)).astype(np.uint8)
        yield payload(image(pixels, "rgb8"))


def encode(encoder: VideoEncoder, seconds: float, *, begin: float = 0.0) -> list[Encoded]:
    found = [
        encoder.encode(each, round(1000 * (begin + number / HZ)), key=False)
        for number, each in enumerate(images(round(seconds * HZ)))
    ]
    return [each for each in found if each is not None]


def rate(images: list[Encoded]) -> float:
    return 8 * sum(len(each.data) for each in images) * HZ / len(images)


def make(codec: str, scale: float = 1.0) -> VideoEncoder:
    preset, quality = ("ultrafast", "") if codec == "h264" else ("", "realtime")
    video = Video(codec, BITS, gop=300, adaptive=True, scale=scale, preset=preset, quality=quality)
    return VideoEncoder(StreamRequest("/camera", video), video, lambda pixels: None)


@pytest.mark.parametrize("codec", ["vp8", "h264"])
def test_the_bit_rate_follows_its_target(codec: str) -> None:
    encoder = make(codec)
    encoder.bitrate = BITS
    assert rate(encode(encoder, 3)[HZ:]) == pytest.approx(BITS, rel=0.3)
    encoder.bitrate = BITS // 3
    assert rate(encode(encoder, 3, begin=3)[HZ:]) == pytest.approx(BITS // 3, rel=0.3)


def test_x264_changes_its_bit_rate_without_key_frames() -> None:
    encoder, keys = make("h264"), 0
    for second in range(6):
        encoder.bitrate = BITS if second % 2 else BITS // 2
        keys += sum(each.key for each in encode(encoder, 1, begin=second))
    assert keys == 1


def test_small_changes_cost_no_key_frame_of_libvpx() -> None:
    encoder, keys = make("vp8"), 0
    for second in range(6):
        encoder.bitrate = round(BITS * (0.95 if second % 2 else 1.0))
        keys += sum(each.key for each in encode(encoder, 1, begin=second))
    assert keys == 1


def test_key_frames_are_small() -> None:
    encoder = make("vp8")
    encoder.bitrate = BITS
    largest = max(len(each.data) for each in encode(encoder, 3) if each.key)
    assert 8 * largest < 1.5 * KEY_PERCENT / 100 * BITS / HZ


def test_frames_that_are_left_out_do_not_make_the_others_larger() -> None:
    encoder = make("vp8")
    encoder.bitrate = BITS
    usual = rate(encode(encoder, 2)) / HZ
    sizes = [encoder.encode(each, 2000 + 300 * at, key=False) for at, each in enumerate(images(10))]
    assert np.mean([8 * len(each.data) for each in sizes if each]) < 2.0 * usual


def test_a_scaled_video_has_a_smaller_size() -> None:
    (made,) = encode(make("vp8", 0.5), 1 / HZ)
    assert made.track is not None
    assert (made.track.width, made.track.height) == (160, 120)
