"""Queries: what they mean, and what is said of those that mean nothing."""

from __future__ import annotations

from urllib.parse import quote, urlencode

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt.media.errors import RequestRefused
from rwt.media.stream_request import TYPES, Jpeg, Png, StreamRequest, Video, read_request
from rwt_participant.qos import BEST_AVAILABLE, SENSOR_DATA


def test_the_defaults_are_those_of_web_video_server() -> None:
    assert read_request("topic=/a") == StreamRequest("/a", Jpeg(None))
    assert read_request("topic=/a&type=png").coding == Png(3)
    assert read_request("topic=/a&type=vp8").coding == Video("vp8", 100_000, 10, 42, 25, quality="realtime")
    assert read_request("topic=/a&type=vp9").coding == Video("vp9", 100_000, 10, 42, 25)
    assert read_request("topic=/a&type=h264").coding == Video("h264", None, 10, 42, 25, preset="ultrafast")


def test_everything_can_be_said() -> None:
    request = read_request(
        "topic=a/b&type=h264&width=320&height=240&invert&bitrate=500000&qmin=2&qmax=50&gop=10&preset=medium"
        "&qos_profile=sensor_data&default_transport=compressed&token=abc&_=1"
    )
    video = Video("h264", 500_000, 2, 50, 10, preset="medium")
    assert request == StreamRequest("/a/b", video, 320, 240, True, "compressed", False, "sensor_data")
    assert request.qos == SENSOR_DATA
    assert read_request("topic=/a").qos == BEST_AVAILABLE


def test_what_does_not_matter_to_a_type_does_not_part_its_viewers() -> None:
    assert read_request("topic=/a&bitrate=5000&gop=3&preset=slow") == read_request("topic=a&type=mjpeg")
    assert read_request("topic=/a&type=vp8&preset=slow") == read_request("topic=/a&type=vp8&quality=realtime")


@pytest.mark.parametrize(
    "query", ["topic=/a&quality=80", "topic=/a&invert=", "topic=/a&width=3", "topic=/a&type=png"]
)
def test_what_changes_a_picture(query: str) -> None:
    assert read_request(query).changes_images
    assert not read_request("topic=/a&width=-1").changes_images


@pytest.mark.parametrize(
    ("query", "said"),
    [
        ("", "`topic` is missing"),
        ("topic=", "`topic` is missing"),
        ("topic=/a%20b", "`topic`: '/a b' is not a valid name: it contains ' '"),
        ("topic=/a&type=x", "`type` must be one of mjpeg, png, ros_compressed, vp8, vp9, h264, got 'x'"),
        ("topic=/a&width=0", "`width` must be a whole number from 1 to 4096, got '0'"),
        ("topic=/a&height=9999999", "`height` must be a whole number from 1 to 4096, got '9999999'"),
        ("topic=/a&width=4096&height=4096", "`width` 4096 by `height` 4096 is more than 4096000 pixels"),
        ("topic=/a&width=3_0", "`width` must be a whole number"),
        ("topic=/a&width=%D9%A3", "`width` must be a whole number"),
        ("topic=/a&quality=0", "`quality` must be a whole number from 1 to 100, got '0'"),
        ("topic=/a&type=png&quality=10", "`quality` must be a whole number from 0 to 9, got '10'"),
        ("topic=/a&type=vp8&quality=80", "`quality` must be one of realtime, good, best, got '80'"),
        ("topic=/a&type=vp8&bitrate=fast", "`bitrate` must be a whole number from 1000 to 100000000"),
        ("topic=/a&type=vp8&qmin=50", "`qmin` 50 is more than `qmax` 42"),
        ("topic=/a&type=h264&preset=quick", "`preset` must be one of ultrafast,"),
        ("topic=/a&qos_profile=best", "`qos_profile` must be one of default,"),
        ("topic=/a&default_transport=theora", "`default_transport` must be one of raw,"),
    ],
)  # fmt: skip
def test_a_wrong_query_is_told_what_is_right(query: str, said: str) -> None:
    with pytest.raises(RequestRefused) as refused:
        read_request(query)
    assert refused.value.status == 400
    assert said in str(refused.value)


@given(st.text())
def test_any_query_is_read_or_refused(query: str) -> None:
    try:
        assert read_request(query).topic.startswith("/")
    except RequestRefused as refused:
        assert refused.status == 400


_NUMBER = st.one_of(st.integers(-10, 10_000).map(str), st.text(max_size=6))
_QUERY = st.fixed_dictionaries(
    {"topic": st.just("/a"), "type": st.sampled_from(TYPES)},
    optional=dict.fromkeys(("width", "height", "quality", "bitrate", "qmin", "qmax", "gop"), _NUMBER),
)


@given(_QUERY)
def test_whatever_is_read_is_in_its_bounds(query: dict[str, str]) -> None:
    try:
        request = read_request(urlencode(query, quote_via=quote))
    except RequestRefused:
        return
    assert all(size is None or 1 <= size <= 4096 for size in (request.width, request.height))
    if isinstance(request.coding, Video):
        assert 0 <= request.coding.qmin <= request.coding.qmax <= 63
        assert request.coding.gop >= 1
    elif isinstance(request.coding, Png):
        assert 0 <= request.coding.level <= 9
    else:
        assert request.coding.quality is None or 1 <= request.coding.quality <= 100
