"""Microphones of clients as topics, with plain aiortc as the microphone's side."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from av import AudioFrame

from rwt import Server
from rwt.access.settings import AuthSettings, RoleSettings
from rwt_webrtc.media.audio import audio_limit
from tests.waiting import until
from tests.webrtc.cameras import Picture, media_server, whip_url
from tests.webrtc.sounds import Singer, pitch
from tests.webrtc.watching import media_peer

pytestmark = pytest.mark.anyio

TOPIC = "/operator/voice"


class Ear:
    """Messages on the two topics of a microphone."""

    def __init__(self, server: Server) -> None:
        self.pieces: list[bytes] = []
        self.told: list[Any] = []
        node = server.node("robot")
        node.subscribe(
            TOPIC, lambda said: self.pieces.append(bytes(said.data)), "audio_common_msgs/AudioData"
        )
        node.subscribe(f"{TOPIC}_info", self.told.append, "audio_common_msgs/AudioInfo")

    @property
    def samples(self) -> np.ndarray[Any, np.dtype[np.int16]]:
        return np.frombuffer(b"".join(self.pieces), "<i2")


@pytest.mark.parametrize(("rate", "channels"), [(48_000, 1), (16_000, 1), (48_000, 2)])
async def test_a_tone_arrives_as_that_tone(rate: int, channels: int) -> None:
    async with media_server() as server, media_peer(Singer()) as peer:
        ear = Ear(server)
        await peer.connect(whip_url(server, f"audio={TOPIC}&rate={rate}&channels={channels}"))
        await until(lambda: len(ear.pieces) >= 14)
        # Not the first ones: a codec begins softly.
        left = ear.samples[::channels][4 * rate // 20 :]
        assert pitch(left, rate) == pytest.approx(440, abs=5)
        assert 4000 < np.abs(left).max() < 12_000
        assert {len(each) for each in ear.pieces} == {2 * channels * rate // 20}
        info = ear.told[0]
        assert (info.channels, info.sample_rate, info.bitrate) == (channels, rate, 16 * channels * rate)
        assert (info.sample_format, info.coding_format) == ("S16LE", "WAVE")


async def test_a_camera_and_a_microphone_come_together_and_end_together() -> None:
    async with media_server() as server, media_peer(Picture(), Singer()) as peer:
        ear = Ear(server)
        pictures: list[Any] = []
        server.node("viewer").subscribe("/operator/camera", pictures.append, "sensor_msgs/CompressedImage")
        await peer.connect(whip_url(server, f"topic=/operator/camera&audio={TOPIC}"))
        await until(lambda: pictures and ear.pieces)
        assert (await peer.connection.getStats()) is not None
        await peer.connection.close()
        graph = server.node("robot").graph
        await until(lambda: not any(each.publishers for each in graph.topics() if each.name == TOPIC))


async def test_sound_that_nobody_asked_for_is_not_taken() -> None:
    async with media_server() as server, media_peer(Picture(), Singer()) as peer:
        pictures: list[Any] = []
        server.node("viewer").subscribe("/operator/camera", pictures.append, "sensor_msgs/CompressedImage")
        await peer.connect(whip_url(server, "topic=/operator/camera"))
        await until(lambda: pictures)
        directions = {each.kind: each.currentDirection for each in peer.connection.getTransceivers()}
        assert directions == {"video": "sendonly", "audio": "inactive"}
        assert not any(each.type and "audio" in each.type.name for each in server.node("r").graph.topics())


@pytest.mark.parametrize("allowed", [(TOPIC,), (f"{TOPIC}_info",), ("/operator/camera",)])
async def test_a_role_needs_both_topics(allowed: tuple[str, ...]) -> None:
    auth = AuthSettings(default_role="guest")
    roles = {"guest": RoleSettings(publish=allowed)}
    async with media_server(auth=auth, roles=roles) as server, media_peer(Singer()) as peer:
        status, text = await peer.offer(whip_url(server, f"audio={TOPIC}"))
        assert (status, "roles.guest.publish" in text) == (403, True)


@pytest.mark.parametrize(
    ("query", "status", "why"),
    [
        ("", 400, "/whip?audio=/operator/voice for sound"),
        (
            f"audio={TOPIC}&rate=44100",
            400,
            "`rate` must be one of 8000, 12000, 16000, 24000, 48000, got '44100'",
        ),
        (f"audio={TOPIC}&channels=3", 400, "`channels` must be 1 or 2, got '3'"),
        (f"topic=/operator/camera&audio={TOPIC}", 400, "one of audio and one of video is wanted"),
        ("audio=/rosout", 409, "rcl_interfaces"),
    ],
)
async def test_refusals(query: str, status: int, why: str) -> None:
    async with media_server() as server, media_peer(Singer()) as peer:
        got = await peer.offer(whip_url(server, query))
        assert got[0] == status
        assert why in got[1]


async def test_an_offer_without_opus_is_refused() -> None:
    async with media_server() as server, media_peer(Singer()) as peer:
        (transceiver,) = peer.connection.getTransceivers()
        known = transceiver.sender.getCapabilities("audio").codecs
        transceiver.setCodecPreferences([each for each in known if each.mimeType == "audio/PCMU"])
        assert await peer.offer(whip_url(server, f"audio={TOPIC}")) == (
            400,
            "the sound that is offered has no opus/48000/2 (RFC 7587), the one codec here\n",
        )


def test_no_more_sound_is_taken_than_time_has_passed_for() -> None:
    now = 100.0
    limit = audio_limit()
    assert sum(limit.take(now, 62.5) for _ in range(1000)) == 16  # a second at once
    now += 0.5
    assert sum(limit.take(now, 62.5) for _ in range(1000)) == 8
    now += 1000
    assert sum(limit.take(now, 62.5) for _ in range(1000)) == 16


async def test_what_waits_too_long_is_left_out_from_its_beginning() -> None:
    from rwt_webrtc.media.microphone import Microphone, MicrophoneRequest

    class Client:
        """A client's graph that is asked for publishers alone."""

        def publisher(self, topic: str, type: str) -> None:
            return None

    ended: list[str] = []
    microphone = Microphone(
        Client(),  # type: ignore[arg-type]  # Microphone only requests a publisher
        MicrophoneRequest(TOPIC),
        ended.append,
        lambda: 0.0,
    )
    frames = []
    for number in range(40):
        frame = AudioFrame.from_ndarray(np.full((1, 960), number, np.int16), format="s16", layout="mono")
        frame.sample_rate = 48_000
        frames.append(frame)
        microphone.put(frame)
    assert [each.to_ndarray()[0][0] for each in microphone._waiting] == list(range(15, 40))
    long = AudioFrame.from_ndarray(np.zeros((1, 48_000), np.int16), format="s16", layout="mono")
    long.sample_rate = 48_000
    microphone.put(long)
    assert microphone._waiting[-1] is frames[-1]
