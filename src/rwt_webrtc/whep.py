"""WHEP (draft-ietf-wish-whep): ``POST /whep?topic=…`` with an offer, and the topic comes as a video track.

The parameters are those of ``/stream``; `type` is `vp8` or `h264`, by default what the offer has, VP8 first.
"""

from __future__ import annotations

from collections.abc import Awaitable
from functools import partial
from typing import TYPE_CHECKING, Final, Never
from urllib.parse import parse_qsl, urlencode

from aiortc import RTCRtpCodecCapability, RTCRtpSender

from rwt_nodes.video.errors import RequestRefused
from rwt_nodes.video.stream_request import Video, read_request
from rwt_transports.errors import Refused
from rwt_transports.http import Audience, HttpResponse, Route
from rwt_transports.webrtc.sdp import BadDescription, read_description
from rwt_transports.webrtc.signalling import SDP, answering, opened, resource_routes
from rwt_webrtc.video_track import TopicTrack

if TYPE_CHECKING:
    from rwt_nodes.video import WebVideoServer
    from rwt_nodes.video.stream_request import StreamRequest
    from rwt_protocol.transport import PeerInfo, Sink
    from rwt_transports.http import HttpRequest, Reader
    from rwt_transports.webrtc.peer import Peer
    from rwt_transports.webrtc.sdp import Description
    from rwt_transports.webrtc.signalling import Peers

PATH: Final = "/whep"
BITRATE: Final = 1_500_000
"""Bits a second where none are asked for."""
KEY_EVERY: Final = 300
"""Pictures from one key picture to the next where none is asked for: receivers ask when they need one."""
CODECS: Final = {"vp8": "video/VP8", "h264": "video/H264"}


def video_routes(peers: Peers, server: WebVideoServer) -> tuple[Route, ...]:
    """The routes by which image topics are watched over WebRTC."""

    def page(request: HttpRequest, reader: Reader) -> Awaitable[HttpResponse]:
        return answering(request, SDP, partial(_offered, peers, server, reader))

    return (Route(PATH, page, Audience.ADMITTED, "POST"), *resource_routes(peers, PATH))


async def _offered(
    peers: Peers, server: WebVideoServer, reader: Reader, request: HttpRequest
) -> HttpResponse:
    description = read_description(request.body, peers.terms.candidates)
    if sorted(description.media) not in (["video"], ["audio", "video"]):
        raise BadDescription(
            f"sections {', '.join(description.media) or 'none'} are offered, where one of video is wanted"
        )
    try:
        stream = await server.find(read_query(request.query, description), reader)
        server.check_room(stream)
    except RequestRefused as refused:
        raise Refused(refused.status, str(refused)) from refused

    async def answer(peer: Peer) -> str:
        track = TopicTrack(server, stream, reader.work, peer.fail)
        sender = peer.connection.addTrack(track)
        track.follow(sender)
        (transceiver,) = peer.connection.getTransceivers()
        transceiver.setCodecPreferences(_codecs(stream.type))
        await peer.take_description(description, "offer")
        return await peer.describe()

    return opened(PATH, request, *await peers.open(_refuse, request.address, answer))


def _refuse(sink: Sink, info: PeerInfo) -> Never:
    raise Refused(403, "data channels are offered at /webrtc")


def read_query(query: str, description: Description) -> StreamRequest:
    """What a query asks for, with what the offer can take where it does not say.

    Raises:
        RequestRefused: 400, and the text says what is expected.
    """
    given = dict(parse_qsl(query, keep_blank_values=True))
    type_ = given.setdefault("type", "vp8" if "VP8/90000" in description.text else "h264")
    if type_ not in CODECS:
        raise RequestRefused(400, f"`type` must be one of {', '.join(CODECS)} here, got {type_!r:.100}")
    given.setdefault("bitrate", str(BITRATE))
    given.setdefault("gop", str(KEY_EVERY))
    request = read_request(urlencode(given))
    assert isinstance(request.coding, Video)
    return request


def _codecs(type_: str) -> list[RTCRtpCodecCapability]:
    """What aiortc may choose from: one codec, and its retransmission."""
    wanted = (CODECS[type_].lower(), "video/rtx")
    known = RTCRtpSender.getCapabilities("video").codecs
    return [codec for codec in known if codec.mimeType.lower() in wanted]
