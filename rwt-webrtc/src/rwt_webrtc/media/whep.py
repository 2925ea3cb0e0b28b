"""WHEP (draft-ietf-wish-whep): ``POST /whep?topic=…`` with an offer returns an image topic as a video track.

``audio=…``, alone or with `topic`, adds an audio topic as Opus. The parameters of images are those of
``/stream``; `type` is `vp8` or `h264`, by default what the offer has, VP8 first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Final
from urllib.parse import parse_qsl, urlencode

from aiortc import MediaStreamTrack, RTCRtpCodecCapability, RTCRtpSender
from aiortc.mediastreams import MediaStreamError
from av import Packet

from rwt.extensions.video import WebVideoServer
from rwt.media.broadcast import Listener
from rwt.media.errors import RequestRefused
from rwt.media.stream_request import StreamRequest, Video, read_request
from rwt_transports.errors import Refused
from rwt_transports.http.routes import HttpRequest, HttpResponse, Reader, Route
from rwt_webrtc.media.audio import AudioFormat
from rwt_webrtc.media.audio_topics import AudioTopics, topics_of
from rwt_webrtc.media.opus import check_sections, only_opus
from rwt_webrtc.media.opus_encoder import RATE, OpusPacket
from rwt_webrtc.media.video_track import TopicTrack
from rwt_webrtc.transport.peer import Peer
from rwt_webrtc.transport.sdp import Description, read_description
from rwt_webrtc.transport.signalling import Peers, offer_routes, refuse_channels

BITRATE: Final = 1_500_000
"""Default bit rate in bits per second."""
KEY_EVERY: Final = 300
"""Default interval of key frames, in frames: receivers request one when they need it."""
CODECS: Final = {"vp8": "video/VP8", "h264": "video/H264"}


def watch_routes(
    peers: Peers, video: WebVideoServer | None, audio: AudioTopics | None
) -> tuple[Route[Reader], ...]:
    """Return the routes of WHEP.

    Args:
        video: server with the image encoders; None if images are not served.
        audio: audio topics; None if audio is not served.
    """
    return offer_routes(peers, "whep", Sources(peers, video, audio).offered)


@dataclass(frozen=True, slots=True)
class Sources:
    """Sources of video and audio tracks; attributes as for :func:`watch_routes`."""

    peers: Peers
    video: WebVideoServer | None
    audio: AudioTopics | None

    async def offered(self, reader: Reader, request: HttpRequest) -> HttpResponse:
        """Answer an offer."""
        description = read_description(request.body, self.peers.terms.candidates)
        given = dict(parse_qsl(request.query, keep_blank_values=True))
        audio = given.pop("audio", "")
        wants_video = not audio or "topic" in given
        check_sections(description, video=wants_video, audio=bool(audio))
        try:
            stream = await self._find_video(given, description, reader) if wants_video else None
            heard = await self._find_audio(audio, reader) if audio else None
        except RequestRefused as refused:
            raise Refused(refused.status, str(refused)) from refused
        topics: tuple[str, ...] = () if heard is None else topics_of(heard[0])
        if stream is not None:
            topics = (stream.topic, *topics)

        async def answer(peer: Peer) -> str:
            peer.when_ended(reader.while_allowed(topics, peer.fail))
            track = self._show(peer, stream, reader) if stream is not None else None
            if heard is not None:
                self._play(peer, heard, reader)
            await peer.take_description(description, "offer")
            if track is not None:
                track.follow(peer.connection.getTransceivers()[0], peer)
            return await peer.describe()

        return await self.peers.open(request, reader.holder, refuse_channels, answer)

    async def _find_video(
        self, given: dict[str, str], description: Description, reader: Reader
    ) -> StreamRequest:
        if self.video is None:
            raise RequestRefused(404, "no pictures are served here: `nodes` of the settings has no video")
        return await self.video.find(_read_query(given, description), reader)

    async def _find_audio(self, topic: str, reader: Reader) -> tuple[str, AudioFormat]:
        if self.audio is None:
            raise RequestRefused(404, "no sound is served here")
        return await self.audio.find(topic, reader)

    def _show(self, peer: Peer, stream: StreamRequest, reader: Reader) -> TopicTrack:
        assert self.video is not None  # It found the topic.
        track = TopicTrack(self.video, stream, reader, peer.fail)
        peer.connection.addTrack(track)
        (transceiver,) = peer.connection.getTransceivers()
        transceiver.setCodecPreferences(_codecs(stream.type))
        return track

    def _play(self, peer: Peer, heard: tuple[str, AudioFormat], reader: Reader) -> None:
        assert self.audio is not None  # It found the topic.
        track = AudioTrack(self.audio.listen(*heard, reader.work), peer.fail)
        # Also for a peer that never connects: its sender never calls recv().
        peer.when_ended(track.stop)
        peer.connection.addTrack(track)
        only_opus(peer.connection.getTransceivers()[-1])


_SAMPLE: Final = Fraction(1, RATE)


class AudioTrack(MediaStreamTrack):
    """Audio track of a topic for one listener, from the encoder that all listeners share.

    Args:
        on_end: called once with the reason when the audio has ended.
    """

    kind = "audio"

    def __init__(self, listener: Listener[OpusPacket], on_end: Callable[[str], None]) -> None:
        super().__init__()
        self._listener = listener
        self._on_end = on_end

    async def recv(self) -> Packet[Any]:
        """Wait for the next 20 ms, encoded; raises MediaStreamError at the end of the audio."""
        if self.readyState != "live":
            raise MediaStreamError
        encoded = await self._listener.next()
        if encoded is None:
            self.stop()
            self._on_end(str(self._listener.failure or "the topic's sound has ended"))
            raise MediaStreamError
        packet = Packet(encoded.data)
        packet.pts = encoded.at
        packet.time_base = _SAMPLE
        return packet

    def stop(self) -> None:
        """Stop listening."""
        super().stop()
        self._listener.leave()


def _read_query(given: dict[str, str], description: Description) -> StreamRequest:
    """Read the parameters of a query; the codec defaults to one of the offer.

    Raises:
        RequestRefused: a value is invalid (400); the text says what is expected.
    """
    type_ = given.setdefault("type", "vp8" if "VP8/90000" in description.text else "h264")
    if type_ not in CODECS:
        raise RequestRefused(400, f"`type` must be one of {', '.join(CODECS)} here, got {type_!r:.100}")
    given.setdefault("bitrate", str(BITRATE))
    given.setdefault("gop", str(KEY_EVERY))
    request = read_request(urlencode(given))
    assert isinstance(request.coding, Video)
    return request


def _codecs(type_: str) -> list[RTCRtpCodecCapability]:
    """Return the capabilities for aiortc: one codec, and its retransmission."""
    wanted = (CODECS[type_].lower(), "video/rtx")
    known = RTCRtpSender.getCapabilities("video").codecs
    return [codec for codec in known if codec.mimeType.lower() in wanted]
