"""Sound topics as Opus, with plain aiortc as the listener's side."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt import Server
from rwt.access.settings import AuthSettings, RoleSettings
from rwt_interfaces import JAZZY
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_webrtc.media import audio_topics
from rwt_webrtc.media.audio import DATA, INFO, SAMPLE_FORMATS, AudioFormat, AudioUnreadable, read_info
from rwt_webrtc.media.opus_encoder import OpusEncoder
from rwt_webrtc.settings import WebRtcSettings
from tests.page_readers import CountedWork
from tests.waiting import until
from tests.webrtc.sounds import pitch, tone
from tests.webrtc.watching import Camera, media_peer

pytestmark = pytest.mark.anyio

TOPIC = "/microphone"


class Robot:
    """A robot whose microphone hears a tone."""

    def __init__(self, server: Server, rate: int, info: dict[str, Any]) -> None:
        self.url = f"{server.urls[0].replace('ws', 'http', 1)}/whep"
        self.server = server
        self.graph = server.node("robot").graph
        self.node = server.node("microphone")
        self.rate = rate
        self.hertz = 440
        self.info = {
            "channels": 1,
            "sample_rate": rate,
            "sample_format": "S16LE",
            "bitrate": 16 * rate,
            "coding_format": "WAVE",
            **info,
        }

    async def run(self) -> None:
        """As the robot's page does it: twenty messages a second, and how to read them now and then."""
        data, told = self.node.advertise(TOPIC, DATA), self.node.advertise(f"{TOPIC}_info", INFO)
        count = self.rate // 20
        number = 0
        while True:
            if number % 10 == 0:
                told.publish(self.info)
            data.publish({"data": tone(self.rate, count, number * count, self.hertz).tobytes()})
            number += 1
            await asyncio.sleep(0.05)


@asynccontextmanager
async def robot(
    rate: int = 48_000, info: dict[str, Any] | None = None, **settings: Any
) -> AsyncIterator[Robot]:
    async with Server("ws://127.0.0.1:0", webrtc=WebRtcSettings(enabled=True), **settings) as server:
        made = Robot(server, rate, info or {})
        running = asyncio.create_task(made.run())
        try:
            await until(lambda: made.graph.topic(TOPIC))
            yield made
        finally:
            running.cancel()


@pytest.mark.parametrize("rate", [44_100, 48_000])
async def test_a_tone_arrives_as_that_tone(rate: int) -> None:
    async with robot(rate) as made, media_peer(receives=["audio"]) as peer:
        await peer.connect(f"{made.url}?audio={TOPIC}")
        await until(lambda: len(peer.heard) >= 40)
        heard = np.concatenate(peer.heard[10:])
        assert pitch(heard, 48_000) == pytest.approx(440, abs=5)
        assert 4000 < np.abs(heard).max() < 12_000


async def test_all_listeners_share_an_encoder_and_the_last_one_ends_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made_encoders: list[OpusEncoder] = []
    begin = OpusEncoder.__init__

    def noted(self: OpusEncoder, *args: Any) -> None:
        made_encoders.append(self)
        begin(self, *args)

    monkeypatch.setattr(OpusEncoder, "__init__", noted)
    async with (
        robot() as made,
        media_peer(receives=["audio"]) as one,
        media_peer(receives=["audio"]) as other,
    ):
        await one.connect(f"{made.url}?audio={TOPIC}")
        await other.connect(f"{made.url}?audio={TOPIC}")
        await until(lambda: len(one.heard) >= 5 and len(other.heard) >= 5)
        assert len(made_encoders) == 1

        def listening() -> bool:
            topic = made.graph.topic(TOPIC)
            return topic is not None and bool(topic.subscribers)

        assert listening()
        await one.connection.close()
        await other.connection.close()
        await until(lambda: not listening())


async def test_pictures_and_sound_come_together() -> None:
    async with robot() as made, media_peer(receives=["audio", "video"]) as peer:
        running = asyncio.create_task(Camera(made.server).run())
        try:
            await peer.connect(f"{made.url}?topic=/camera/image_raw&audio={TOPIC}")
            await until(lambda: peer.heard and peer.frames)
        finally:
            running.cancel()


async def test_refusals(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(audio_topics, "PATIENCE", 0.2)
    async with robot() as made, media_peer(receives=["audio"]) as peer:
        made.node.advertise("/alone", DATA)
        for query, status, why in (
            ("audio=/nowhere", 404, "there is no topic /nowhere; sound topics are: /alone, /microphone"),
            ("audio=/rosout", 400, "/rosout is a rcl_interfaces/Log; sound is audio_common_msgs/AudioData"),
            ("audio=/a%20b", 400, "/a b"),
            ("audio=/alone", 504, "no audio_common_msgs/AudioInfo came on /alone_info within 0.2 s"),
            (f"topic=/camera/image_raw&audio={TOPIC}", 400, "one of audio and one of video is wanted"),
        ):
            got = await peer.offer(f"{made.url}?{query}")
            assert (got[0], why in got[1]) == (status, True), got


async def test_sound_that_cannot_be_decoded_is_refused_with_the_reason() -> None:
    async with robot(info={"coding_format": "mp3"}) as made, media_peer(receives=["audio"]) as peer:
        assert await peer.offer(f"{made.url}?audio={TOPIC}") == (
            422,
            "/microphone: `coding_format` 'mp3' cannot be decoded here, only 'WAVE'\n",
        )


async def test_sound_that_cannot_be_decoded_any_more_ends() -> None:
    async with robot() as made, media_peer(receives=["audio"]) as peer:
        await peer.connect(f"{made.url}?audio={TOPIC}")
        await until(lambda: peer.heard)
        made.info["channels"] = 8
        await until(lambda: peer.connection.connectionState in ("closed", "failed"))


@pytest.mark.parametrize("allowed", [(TOPIC,), (f"{TOPIC}_info",), ("/odom",)])
async def test_a_role_hears_what_it_may_subscribe_to(allowed: tuple[str, ...]) -> None:
    auth, roles = AuthSettings(default_role="guest"), {"guest": RoleSettings(subscribe=allowed)}
    async with robot(auth=auth, roles=roles) as made, media_peer(receives=["audio"]) as peer:
        status, text = await peer.offer(f"{made.url}?audio={TOPIC}")
        assert (status, "you may not subscribe to /microphone" in text) == (403, True)


# Without a network


def _info(**changed: Any) -> Payload:
    told = {
        "channels": 1,
        "sample_rate": 16_000,
        "sample_format": "S16LE",
        "coding_format": "wave",
        **changed,
    }
    return Payload.from_value(Registry(JAZZY).message(INFO), told)


def _data(data: bytes) -> Payload:
    return Payload.from_value(Registry(JAZZY).message(DATA), {"data": data})


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"coding_format": ""}, "`coding_format` ''"),
        ({"sample_format": "S24LE"}, "`sample_format` 'S24LE' cannot be decoded here, only S8, U8, S16LE"),
        ({"channels": 0}, "0 channels, where 1 or 2"),
        ({"channels": 3}, "3 channels, where 1 or 2"),
        ({"sample_rate": 7999}, "`sample_rate` 7999, where 8000 to 192000"),
        ({"sample_rate": 192_001}, "`sample_rate` 192001"),
    ],
)
def test_what_cannot_be_decoded_says_why(changed: dict[str, Any], why: str) -> None:
    with pytest.raises(AudioUnreadable, match=why):
        read_info(_info(**changed).value())


def test_every_format_of_samples_gives_the_same_sound() -> None:
    wanted = tone(16_000, 800)
    as_bytes: dict[str, Callable[[], bytes]] = {
        "S8": lambda: (wanted >> 8).astype("i1").tobytes(),
        "U8": lambda: ((wanted >> 8) + 128).astype("u1").tobytes(),
        "S16LE": lambda: wanted.astype("<i2").tobytes(),
        "S16BE": lambda: wanted.astype(">i2").tobytes(),
        "S32LE": lambda: (wanted.astype("<i4") << 16).tobytes(),
        "S32BE": lambda: (wanted.astype("<i4") << 16).astype(">i4").tobytes(),
        "F32LE": lambda: (wanted / 32768).astype("<f4").tobytes(),
        "F32BE": lambda: (wanted / 32768).astype(">f4").tobytes(),
    }
    assert set(as_bytes) == set(SAMPLE_FORMATS)
    for name, make in as_bytes.items():
        frame = AudioFormat(16_000, 1, name).read(make())
        assert frame is not None
        near = 256 if name.endswith("8") else 1
        assert np.abs(frame.to_ndarray()[0].astype(int) - wanted).max() <= near, name


@given(
    st.binary(max_size=300),
    st.sampled_from(sorted(SAMPLE_FORMATS)),
    st.sampled_from([1, 2]),
)
def test_any_bytes_are_sound_or_refused(data: bytes, samples: str, channels: int) -> None:
    try:
        frame = AudioFormat(8000, channels, samples).read(data)
    except AudioUnreadable as error:
        assert "whole number of samples" in str(error)
    else:
        assert (frame is None) == (not data)


def test_a_message_of_more_than_a_second_is_refused() -> None:
    with pytest.raises(AudioUnreadable, match=r"a message of 1.5 s; the most is 1 s"):
        AudioFormat(8000, 1, "U8").read(bytes(12_000))


def test_time_goes_on_where_a_topic_is_silent_and_is_even_where_it_is_not() -> None:
    now = 1000.0
    encoder = OpusEncoder(AudioFormat(48_000, 1, "S16LE"), lambda: now)
    piece = _data(tone(48_000, 4800).tobytes())
    first = [packet.at for packet in encoder.encode([(now, piece), (now + 0.1, piece)])]
    assert first == [48_000_000 + 960 * number for number in range(len(first))]
    assert len(first) >= 9
    now += 60
    (later, *_) = encoder.encode([(now, piece)])
    assert later.at == 48_000 * 1060


def test_a_topic_that_brings_too_much_is_heard_no_faster_than_sound_is() -> None:
    encoder = OpusEncoder(AudioFormat(8000, 1, "U8"), lambda: 1000.0)
    packets = encoder.encode([(1000.0, _data(bytes([128]) * 1000))] * 100)
    assert 40 <= len(packets) <= 50


def test_a_message_that_cannot_be_read_is_left_out_once_some_could_be() -> None:
    bad, good = _data(b"abc"), _data(bytes(3200))
    with pytest.raises(AudioUnreadable, match="3 bytes are no whole number of samples of 1 x S16LE"):
        OpusEncoder(AudioFormat(16_000, 1, "S16LE")).encode([(0.0, bad)])
    encoder = OpusEncoder(AudioFormat(16_000, 1, "S16LE"))
    assert encoder.encode([(0.0, good), (0.1, bad), (0.1, good)])
    assert "3 bytes" in str(encoder.complaint)
    with pytest.raises(AudioUnreadable, match="9 channels"):
        encoder.encode([(0.2, _info(channels=9))])


async def test_listeners_do_not_hold_the_type_of_a_topic_against_the_robot() -> None:
    async with Server("ws://127.0.0.1:0") as server:
        graph = server.graph
        clients = graph.participant("/rosbridge_websocket", for_clients=True)
        held = clients.subscribe("/t", lambda _: None, graph.registry.message(DATA))
        topics = audio_topics.AudioTopics(graph)
        listener = topics.listen("/t", AudioFormat(48_000, 1, "S16LE"), CountedWork())
        robot = server.node("robot")
        for name in ("/t", "/t_info"):
            robot.advertise(name, "std_msgs/String")
        robot.publish("/t", {"data": "no sound"})
        assert await listener.next() is None
        assert str(listener.failure) == f"/t is a std_msgs/String now, not a {DATA}"
        assert held.type is None
        topics.close()
