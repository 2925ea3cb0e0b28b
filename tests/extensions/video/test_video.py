"""Videos are what an independent decoder shows, from whichever key picture they begin at."""

from __future__ import annotations

import io
from typing import Any

import av
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt.extensions.video.responses import container_of
from rwt.media.encoders.encoded import Encoded
from rwt.media.encoders.image import ImageEncoder
from rwt.media.encoders.mp4 import Mp4, units
from rwt.media.encoders.video import VideoEncoder
from rwt.media.encoders.webm import Webm
from rwt.media.stream_request import Jpeg, Png, Video, read_request
from tests.extensions.video.conftest import image, payload, scene

CODECS = ["vp8", "vp9", "h264"]


def _video(
    query: str, pictures: list[Any], keys: tuple[int, ...] = (0,), encoding: str = "rgb8"
) -> list[Encoded]:
    request = read_request(f"topic=/a&{query}")
    assert isinstance(request.coding, Video)
    encoder = VideoEncoder(request, request.coding, lambda pixels: None)
    made = [
        encoder.encode(payload(image(picture, encoding)), 1000 + 40 * number, key=number in keys)
        for number, picture in enumerate(pictures)
    ]
    assert all(made)
    return [picture for picture in made if picture is not None]


def _written(video: list[Encoded]) -> bytes:
    assert video[0].track is not None
    container, began = container_of(video[0].track), video[0].at_ms
    parts = [container.frame(each.data, each.at_ms - began, key=each.key) for each in video]
    return container.header() + b"".join(parts)


def _decoded(data: bytes) -> list[tuple[float | None, Any]]:
    with av.open(io.BytesIO(data), "r") as file:
        return [(frame.time, frame.to_ndarray(format="rgb24")) for frame in file.decode(video=0)]


@pytest.mark.parametrize("codec", CODECS)
def test_every_picture_comes_at_its_time_and_looks_right(codec: str) -> None:
    pictures = [scene(2 * number) for number in range(12)]
    video = _video(f"type={codec}&bitrate=2000000&qmax=20", pictures)
    decoded = _decoded(_written(video))
    assert [time for time, _ in decoded] == pytest.approx([0.04 * number for number in range(12)])
    for (_, shown), picture in zip(decoded, pictures, strict=True):
        assert np.abs(shown.astype(int) - picture).mean() < 10


@pytest.mark.parametrize("codec", CODECS)
def test_no_picture_is_kept_back(codec: str) -> None:
    """Each is complete in the bytes up to itself, without waiting for the next."""
    video = _video(f"type={codec}", [scene(number) for number in range(4)])
    for count in range(1, 5):
        assert len(_decoded(_written(video[:count]))) == count


@pytest.mark.parametrize("codec", CODECS)
def test_a_video_can_be_entered_at_any_key_picture(codec: str) -> None:
    pictures = [scene(3 * number) for number in range(10)]
    video = _video(f"type={codec}&bitrate=2000000&qmax=20", pictures, keys=(0, 6))
    assert [each.key for each in video[5:8]] == [False, True, False]
    decoded = _decoded(_written(video[6:]))
    assert [time for time, _ in decoded] == pytest.approx([0.0, 0.04, 0.08, 0.12])
    assert np.abs(decoded[0][1].astype(int) - pictures[6]).mean() < 10


@pytest.mark.parametrize("codec", CODECS)
def test_gaps_as_slow_viewers_have_them_keep_time(codec: str) -> None:
    video = _video(f"type={codec}", [scene(number) for number in range(9)], keys=(0, 5))
    times = [time for time, _ in _decoded(_written([*video[:2], *video[5:]]))]
    assert times == pytest.approx([0.0, 0.04, 0.2, 0.24, 0.28, 0.32])


@pytest.mark.parametrize("codec", CODECS)
def test_odd_sizes_greys_and_alpha(codec: str) -> None:
    odd = scene(width=65, height=49)
    (time, shown), *_ = _decoded(_written(_video(f"type={codec}&bitrate=2000000&qmax=20", [odd])))
    assert (time, shown.shape) == (0.0, (48, 64, 3))
    grey = scene()[:, :, 0]
    ((_, shown),) = _decoded(_written(_video(f"type={codec}&qmax=20", [grey], encoding="mono8")))
    assert np.abs(shown[:, :, 1].astype(int) - grey).mean() < 10
    alpha = np.dstack((scene(), grey))
    ((_, shown),) = _decoded(_written(_video(f"type={codec}&qmax=20", [alpha], encoding="rgba8")))
    assert shown.shape == (48, 64, 3)


def test_the_size_of_the_first_picture_stays() -> None:
    video = _video("type=vp8&height=24", [scene(), scene(width=100, height=10)])
    assert [shown.shape for _, shown in _decoded(_written(video))] == [(24, 64, 3)] * 2


@pytest.mark.parametrize("quality", ["realtime", "good", "best"])
def test_the_qualities_of_vp8(quality: str) -> None:
    assert _video(f"type=vp8&quality={quality}&gop=3", [scene(n) for n in range(5)])[3].key


def test_a_lower_bitrate_makes_a_smaller_video() -> None:
    rng = np.random.default_rng(1)
    noise = [rng.integers(0, 255, (48, 64, 3), np.uint8) for _ in range(30)]
    low, high = (
        sum(len(each.data) for each in _video(f"type=vp8&qmax=63&bitrate={rate}", noise))
        for rate in (50_000, 3_000_000)
    )
    assert low < high / 2


# -- the containers ----------------------------------------------------------------------------------------


def test_webm_byte_by_byte() -> None:
    webm = Webm("vp8", 640, 480)
    header = webm.header()
    assert header.startswith(bytes.fromhex("1a45dfa3") + b"\x10\x00\x00")
    assert b"\x42\x82\x10\x00\x00\x04webm" in header
    assert bytes.fromhex("18538067 01ffffffffffffff") in header
    assert bytes.fromhex("b010000002 0280 ba10000002 01e0") in header
    # A cluster of unknown size at 5 ms, and in it a block of track 1 that can be shown by itself.
    key = webm.frame(b"abc", 5, key=True)
    assert key == bytes.fromhex("1f43b675 01ffffffffffffff e710000001 05 a310000007 81 0000 80") + b"abc"
    assert webm.frame(b"d", 45, key=False) == bytes.fromhex("a310000005 81 0028 00") + b"d"
    # 16 bits of milliseconds end: another cluster.
    assert webm.frame(b"d", 40_000, key=False).startswith(bytes.fromhex("1f43b675"))


def test_an_mp4_fragment_byte_by_byte() -> None:
    (sps,) = units(b"\0\0\0\1\x67\x42\xc0\x0a\x01")
    mp4 = Mp4(64, 48, b"\0\0\0\1" + sps + b"\0\0\1\x68\xce")
    header = mp4.header()
    assert header[4:8] == b"ftyp"
    assert b"avcC\x01\x42\xc0\x0a\xff\xe1\x00\x05" + sps + b"\x01\x00\x02\x68\xce" in header
    fragment = mp4.frame(b"\0\0\1\x65\x01\x02", 7, key=True)
    expected = (
        "00000064 6d6f6f66"
        " 00000010 6d666864 00000000 00000001"
        " 0000004c 74726166"
        " 00000010 74666864 00020000 00000001"
        " 00000014 74666474 01000000 0000000000000007"
        " 00000020 7472756e 00000701 00000001 0000006c 00000021 00000007 02000000"
        " 0000000f 6d646174 00000003 650102"
    )
    assert fragment == bytes.fromhex(expected)


@given(
    st.lists(
        st.binary(min_size=1, max_size=20).filter(lambda unit: b"\0\0" not in unit and unit[-1] != 0),
        max_size=5,
    )
)
def test_units_are_found_whatever_their_start_codes(contents: list[bytes]) -> None:
    contents = [unit for unit in contents if not unit.startswith(b"\0")]
    for code in (b"\0\0\1", b"\0\0\0\1"):
        assert units(b"".join(code + unit for unit in contents)) == contents


# -- pictures by themselves --------------------------------------------------------------------------------


def _still(query: str, message: dict[str, Any]) -> Encoded:
    request = read_request(f"topic=/a&{query}")
    assert isinstance(request.coding, Jpeg | Png)
    return ImageEncoder(request, request.coding).encode(payload(message), 0, key=True)


def _shown(encoded: Encoded) -> Any:
    from PIL import Image

    return np.asarray(Image.open(io.BytesIO(encoded.data)))


def test_a_jpeg_is_near_and_better_with_quality() -> None:
    errors = {}
    for quality in (20, 95):
        encoded = _still(f"quality={quality}", image(scene(), "rgb8"))
        assert encoded.media_type == "image/jpeg"
        assert encoded.stamp_ns == 12_345_678_901
        errors[quality] = np.abs(_shown(encoded).astype(int) - scene()).mean()
    assert errors[95] < 2 < errors[20]
    default = _still("", image(scene(), "rgb8"))
    assert default.data == _still("quality=95", image(scene(), "rgb8")).data


def test_a_png_is_exact_and_keeps_alpha() -> None:
    alpha = np.dstack((scene(), scene()[:, :, 1]))
    for message, pixels in ((image(scene(), "rgb8"), scene()), (image(alpha, "rgba8"), alpha)):
        encoded = _still("type=png", message)
        assert encoded.media_type == "image/png"
        assert np.array_equal(_shown(encoded), pixels)
    levels = [len(_still(f"type=png&quality={level}", image(scene(), "rgb8")).data) for level in (0, 9)]
    assert levels[0] > levels[1]


def test_a_compressed_picture_is_passed_on_untouched_or_changed_as_asked() -> None:
    jpeg = _still("quality=50", image(scene(), "rgb8")).data
    png = _still("type=png", image(scene(), "rgb8")).data
    assert _still("", {"format": "rgb8; jpeg compressed bgr8", "data": jpeg}).data == jpeg
    assert _still("type=ros_compressed", {"format": "jpg", "data": jpeg}).data == jpeg
    passed = _still("type=ros_compressed", {"format": "png", "data": png})
    assert (passed.data, passed.media_type) == (png, "image/png")
    made = _still("", {"format": "png", "data": png})
    assert made.media_type == "image/jpeg"
    assert np.abs(_shown(made).astype(int) - scene()).mean() < 2
    turned = _still("type=ros_compressed&invert", {"format": "jpeg", "data": jpeg})
    assert np.abs(_shown(turned).astype(int) - np.rot90(scene(), 2)).mean() < 8


def test_jpeg_without_simplejpeg(monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    from rwt.media.encoders import jpeg

    monkeypatch.setitem(sys.modules, "simplejpeg", None)
    jpeg.load_encoder.cache_clear()
    try:
        for pixels in (scene(), scene()[:, :, 0]):
            encoded = Encoded(jpeg.encode_jpeg(pixels, 95), 0, 0)
            assert np.abs(_shown(encoded).astype(int) - pixels).mean() < 2
    finally:
        jpeg.load_encoder.cache_clear()
