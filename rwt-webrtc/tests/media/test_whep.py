"""Image topics as video tracks, with plain aiortc as the viewer's side."""

from __future__ import annotations

from struct import pack

import pytest
from aiortc.rtp import (
    RTCP_PSFB_APP,
    RTCP_RTPFB,
    RTCP_RTPFB_NACK,
    RtcpPsfbPacket,
    RtcpRtpfbPacket,
    pack_remb_fci,
    pack_rtcp_packet,
)

from rwt.access.settings import AuthSettings, RoleSettings
from rwt.media.encoders.encoded import Encoded
from rwt.media.encoders.video import VideoEncoder
from rwt_interfaces.payload import Payload
from rwt_webrtc.upstream.rtp_sender import PacedSender
from tests.waiting import until
from tests.webrtc.watching import HEIGHT, TOPIC, WIDTH, camera, metric, near, watchers

pytestmark = pytest.mark.anyio


@pytest.mark.parametrize("codec", ["vp8", "h264"])
async def test_a_topic_comes_as_video(codec: str) -> None:
    async with camera() as (source, url), watchers() as (watcher,):
        await watcher.connect(f"{url}/whep?topic={TOPIC}&type={codec}&bitrate=3000000")
        await until(lambda: watcher.frames)
        assert (watcher.frames[0].width, watcher.frames[0].height) == (WIDTH, HEIGHT)
        await until(lambda: near(watcher.colour(), (200, 30, 30)))
        source.colour = (30, 30, 200)
        await until(lambda: near(watcher.colour(), (30, 30, 200)))


async def test_all_viewers_share_an_encoder_and_the_last_one_ends_it() -> None:
    async with camera() as (source, url), watchers(4) as everybody:
        for each in everybody:
            await each.connect(f"{url}/whep?topic={TOPIC}")
        await until(lambda: all(len(each.frames) >= 10 for each in everybody))
        sent = metric(source.server, "rwt_video_sent_pictures_total")
        assert sent > 2 * metric(source.server, "rwt_video_encoded_pictures_total")
        for each in everybody:
            await each.connection.close()
        await until(lambda: metric(source.server, "rwt_video_viewers") == 0)


async def test_who_lost_a_picture_gets_a_key_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    keys: list[bool] = []
    encode = VideoEncoder.encode

    def noted(self: VideoEncoder, payload: Payload, at_ms: int, *, key: bool) -> Encoded | None:
        keys.append(key)
        return encode(self, payload, at_ms, key=key)

    monkeypatch.setattr(VideoEncoder, "encode", noted)
    async with camera() as (_, url), watchers() as (watcher,):
        await watcher.connect(f"{url}/whep?topic={TOPIC}")
        await until(lambda: len(watcher.frames) >= 20)
        begun = sum(keys)
        # What a receiver sends by itself when it cannot show what it has (RFC 4585 section 6.3.1).
        (receiver,) = watcher.connection.getReceivers()
        await receiver._send_rtcp_pli(watcher.source())
        await until(lambda: sum(keys) > begun)


async def test_what_a_receiver_lies_hurts_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lines that carry nothing or everything, losses that never were, half an estimate."""
    resent = 0
    retransmit = PacedSender._retransmit

    async def noted(self: PacedSender, sequence_number: int) -> None:
        nonlocal resent
        resent += 1
        await retransmit(self, sequence_number)

    monkeypatch.setattr(PacedSender, "_retransmit", noted)
    async with camera() as (_, url), watchers(2) as (liar, other):
        for each in (liar, other):
            await each.connect(f"{url}/whep?topic={TOPIC}")
        await until(lambda: len(liar.frames) >= 10 and len(other.frames) >= 10)
        (receiver,) = liar.connection.getReceivers()
        ssrc = liar.source()
        estimates = [pack_remb_fci(0, [ssrc]), pack_remb_fci(10**12, [ssrc]), b"REMB"]
        for moment in range(50):
            for fci in estimates:
                estimate = RtcpPsfbPacket(fmt=RTCP_PSFB_APP, ssrc=1, media_ssrc=0, fci=fci)
                await receiver._send_rtcp(estimate)
            nack = RtcpRtpfbPacket(fmt=RTCP_RTPFB_NACK, ssrc=1, media_ssrc=ssrc)
            nack.lost = list(range(moment * 1000, moment * 1000 + 200))
            await receiver._send_rtcp(nack)
            await receiver._send_rtcp_pli(ssrc)
        seen, seen_by_liar = len(other.frames), len(liar.frames)
        # The liar's own connection goes on as well: nothing of this breaks it.
        await until(lambda: len(other.frames) > seen + 20 and len(liar.frames) > seen_by_liar)
        assert 0 < resent < 1000, resent
        # Half an estimate would end aiortc's task that receives.
        half = RtcpPsfbPacket(fmt=RTCP_PSFB_APP, ssrc=1, media_ssrc=0, fci=b"REMB\xff\x00\x00\x01")
        await receiver._send_rtcp(half)
        again = pack("!LL", 1, ssrc) + pack("!HH", 40, 0xFFFF) * 80
        resent = 0
        await receiver.transport._send_rtp(pack_rtcp_packet(RTCP_RTPFB, RTCP_RTPFB_NACK, again))
        seen, seen_by_liar = len(other.frames), len(liar.frames)
        await until(lambda: len(other.frames) > seen + 20 and len(liar.frames) > seen_by_liar + 20)
        assert resent <= 17, "each packet once"


async def test_refusals() -> None:
    async with camera() as (_, url), watchers() as (watcher,):
        for query, status, why in (
            ("", 400, "`topic` is missing"),
            ("topic=/camera/image_raw&type=mjpeg", 400, "`type` must be one of vp8, h264 here"),
            ("topic=/camera/image_raw&bitrate=1", 400, "`bitrate` must be a whole number from 1000"),
            ("topic=/rosout", 400, "pictures are sensor_msgs/Image"),
        ):
            got = await watcher.offer(f"{url}/whep?{query}")
            assert (got[0], why in got[1]) == (status, True), got


async def test_a_role_sees_what_it_may_subscribe_to() -> None:
    roles = {"guest": RoleSettings(subscribe=("/odom",))}
    settings = {"auth": AuthSettings(default_role="guest"), "roles": roles}
    async with camera(**settings) as (_, url), watchers() as (watcher,):
        status, text = await watcher.offer(f"{url}/whep?topic={TOPIC}")
        assert (status, text) == (403, f"you may not subscribe to {TOPIC}\n")
