"""Pacing of packets and frames."""

from __future__ import annotations

from rwt_webrtc.congestion.pacing import FACTOR, Pacer


def test_packets_leave_at_two_and_a_half_times_the_rate() -> None:
    pacer, now = Pacer(), 10.0
    for _ in range(100):
        now += pacer.packet_delay(now)
        pacer.sent(1250, 1e6, now)
    assert 100 * 10_000 / (now - 10.0) < 1.05 * FACTOR * 1e6


def test_frames_leave_at_the_rate() -> None:
    pacer, now = Pacer(), 10.0
    for _ in range(50):
        now += pacer.frame_delay(1e6, now)
        pacer.sent(12_500, 1e6, now)
    assert 0.9e6 < 50 * 100_000 / (now - 10.0) < 1.1e6


def test_a_large_frame_delays_the_next_by_a_second_at_most() -> None:
    pacer = Pacer()
    pacer.sent(1_000_000, 1e5, 10.0)
    assert pacer.frame_delay(1e5, 10.0) < 1.0


def test_a_lower_rate_does_not_make_the_wait_for_earlier_frames_longer() -> None:
    pacer = Pacer()
    pacer.sent(40_000, 2e6, 10.0)
    assert pacer.frame_delay(1e5, 10.0) < 0.1
    assert pacer.frame_delay(2e6, 10.0) < 0.01
