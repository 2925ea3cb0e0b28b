"""Repetition of packets by the paced sender."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest
from aiortc import RTCRtpSender
from aiortc.rtp import RtpPacket

from rwt_transports.background import ignore
from rwt_webrtc.congestion.controller import CongestionController
from rwt_webrtc.congestion.feedback import Feedback
from rwt_webrtc.congestion.pacing import AHEAD_SECONDS, RateMeter
from rwt_webrtc.upstream import rtp_sender
from rwt_webrtc.upstream.rtp_sender import PacedSender


@pytest.fixture
def anyio_backend() -> str:
    return "asyncio"  # aiortc needs it.


class Link:
    """Sender of packets of 1,000 bytes, and the numbers of those that it sent."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 10.0
        self.sent: list[int] = []
        monkeypatch.setattr(rtp_sender, "monotonic", lambda: self.now)
        transport = SimpleNamespace(state="new", _stats_id="transport")
        sender = RTCRtpSender("video", cast("Any", transport))
        controller = CongestionController(100_000, 100_000, 100_000, self.now)
        self.controller = controller
        self.keys_asked = 0
        self.sender = PacedSender(sender, controller, ignore, self._ask)
        monkeypatch.setattr(self.sender, "_send_packet", self._send)
        for number in range(3):
            self.sender._count(RtpPacket(sequence_number=number, payload=bytes(1000)))

    async def _send(self, packet: RtpPacket) -> None:
        self.sent.append(packet.sequence_number)

    def _ask(self) -> None:
        self.keys_asked += 1

    def owe(self, seconds: float) -> None:
        """Make the next frame wait for so long."""
        self.sender._pacer.sent(round((AHEAD_SECONDS + seconds) * 100_000 / 8), 100_000, self.now)


@pytest.mark.anyio
async def test_a_repetition_waits_for_the_link_and_precedes_the_next_frame(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    link = Link(monkeypatch)
    link.owe(0.2)
    await link.sender._retransmit(1)
    assert link.sent == []
    link.now += 0.25
    await link.sender._frame_room()
    assert link.sent == [1]


@pytest.mark.anyio
@pytest.mark.parametrize("is_browser", [True, False])
async def test_a_key_frame_replaces_repetitions_that_have_waited_too_long(
    monkeypatch: pytest.MonkeyPatch, is_browser: bool
) -> None:
    link = Link(monkeypatch)
    if is_browser:
        link.controller.acknowledged(Feedback(0, 0, (0.0,)), link.now)
    link.owe(0.4)
    await link.sender._retransmit(1)
    link.now += 2 * rtp_sender.STALE_SECONDS
    await link.sender._retransmit(1)
    await link.sender._retransmit(2)
    link.now += 1
    await link.sender._frame_room()
    assert link.keys_asked == is_browser
    assert link.sent == ([] if is_browser else [1, 2])


@pytest.mark.anyio
@pytest.mark.parametrize("is_browser", [True, False])
async def test_packets_before_a_key_frame_are_not_repeated(
    monkeypatch: pytest.MonkeyPatch, is_browser: bool
) -> None:
    link = Link(monkeypatch)
    if is_browser:
        link.controller.acknowledged(Feedback(0, 0, (0.0,)), link.now)
    link.sender.begin_anew()
    link.sender._count(RtpPacket(sequence_number=3, payload=bytes(1000)))
    for number in (2, 3):
        await link.sender._retransmit(number)
    assert link.sent == ([3] if is_browser else [2, 3])
    assert not link.keys_asked


@pytest.mark.anyio
async def test_a_packet_is_repeated_once_within_its_travel_time(monkeypatch: pytest.MonkeyPatch) -> None:
    link = Link(monkeypatch)
    for _ in range(3):
        await link.sender._retransmit(2)
    assert link.sent == [2]
    link.now += 2 * rtp_sender.REPEAT_SECONDS
    await link.sender._retransmit(2)
    assert link.sent == [2, 2]
    await link.sender._retransmit(77)
    assert link.sent == [2, 2], "an unknown packet"


def test_the_rate_of_repetitions_decays() -> None:
    meter = RateMeter()
    meter.add(1000, 5.0)
    assert meter.rate(5.0) == 1000
    assert 300 < meter.rate(6.0) < 400
