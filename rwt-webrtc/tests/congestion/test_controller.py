"""Rates of the congestion controller over simulated links."""

from __future__ import annotations

import pytest

from rwt_webrtc.congestion.controller import CongestionController
from rwt_webrtc.congestion.feedback import Feedback
from tests.webrtc.simulated_link import Link, Simulation

SEEDS = range(5)


def _cut(now: float) -> float:
    return 5e5 if 20 <= now < 50 else 2e6


@pytest.mark.parametrize("seed", SEEDS)
def test_a_cut_lowers_the_rate_within_two_seconds_and_its_end_raises_it_within_fifteen(seed: int) -> None:
    run = Simulation(Link(_cut), seed=seed).run(80)
    assert min(run.targets_of(15, 20)) > 1.2e6
    assert max(run.targets_of(22, 50)) < 1.2 * 5e5
    assert run.rate(22, 50) > 0.7 * 5e5
    assert run.pause(20, 50) < 0.7
    assert max(run.ages(24, 50)) < 0.5
    assert max(run.targets_of(50, 65)) > 1.6e6
    assert run.rate(65, 80) > 1.4e6


@pytest.mark.parametrize("seed", SEEDS)
def test_a_cut_is_noticed_by_what_is_in_flight(seed: int) -> None:
    run = Simulation(Link(_cut, delay=0.02, queue=0.5), seed=seed).run(30)
    # More than the link carries in that time, and its queue, is lost.
    assert run.rate(20, 21) < 1e6
    assert run.rate(20.4, 20.9) < 5e5


@pytest.mark.parametrize("seed", SEEDS)
def test_an_unlimited_link_keeps_the_best_rate(seed: int) -> None:
    run = Simulation(Link(lambda now: 1e8), seed=seed).run(60)
    assert min(run.targets_of(2, 60)) == 2e6
    assert run.pause(0, 60) < 0.2


def test_an_encoder_that_uses_little_does_not_lower_the_rate() -> None:
    run = Simulation(Link(lambda now: 5e6, uses=lambda now: 0.1 if now < 40 else 1)).run(60)
    assert min(run.targets_of(5, 60)) > 1.4e6


@pytest.mark.parametrize("delay", [0.01, 0.1, 0.3])
@pytest.mark.parametrize("bits", [2e5, 1e6])
def test_the_rate_stays_close_to_the_capacity(bits: float, delay: float) -> None:
    run = Simulation(Link(lambda now: bits, delay=delay)).run(60)
    assert 0.7 * bits < run.rate(20, 60) < 1.05 * bits
    ages = run.ages(20, 60)
    assert ages[int(0.95 * len(ages))] < delay + 0.4


@pytest.mark.parametrize("loss", [0.03, 0.1])
def test_loss_without_congestion_lowers_the_rate_for_a_moment_at_most(loss: float) -> None:
    run = Simulation(Link(lambda now: 1e7, loss=loss)).run(60)
    assert run.rate(20, 60) > 1.9e6


def test_a_short_queue_that_drops_packets_lowers_the_rate() -> None:
    run = Simulation(Link(lambda now: 5e5, queue=0.05)).run(60)
    assert 0.5 * 5e5 < run.rate(10, 60) < 1.1 * 5e5


def test_jitter_alone_does_not_lower_the_rate() -> None:
    run = Simulation(Link(lambda now: 1e7, jitter=0.04)).run(40)
    assert min(run.targets_of(15, 40)) == 2e6


def test_cross_traffic_takes_its_share_and_leaves_it() -> None:
    link = Link(lambda now: 2e6, cross=lambda now: 1.2e6 if 20 <= now < 40 else 0)
    run = Simulation(link).run(60)
    assert run.rate(24, 40) < 1.1 * 8e5
    assert run.rate(50, 60) > 1.4e6
    assert max(run.ages(24, 60)) < 0.6


def test_an_outage_ends_without_old_frames() -> None:
    run = Simulation(Link(lambda now: 0 if 20 <= now < 25 else 2e6)).run(60)
    assert run.pause(0, 60) < 5.5
    assert run.rate(21, 25) < 2e5
    assert max(run.ages(25, 60)) < 0.5
    assert run.rate(40, 60) > 1.4e6


def test_stalls_of_a_radio_link_do_not_keep_the_rate_low() -> None:
    run = Simulation(Link(lambda now: 2e5 if now % 2 < 0.15 else 5e6)).run(60)
    assert run.rate(20, 60) > 8e5


@pytest.mark.parametrize("seconds", [0.4, 0.8, 1.2])
def test_a_busy_sender_does_not_lower_the_rate(seconds: float) -> None:
    run = Simulation(Link(lambda now: 1e8, stalled=lambda now: 0 < now % 7 < seconds), start=1e6).run(60)
    assert min(run.targets_of(10, 60)) == 2e6
    assert all(run.rate(at + seconds, at + seconds + 1) > 1.5e6 for at in range(14, 56, 7))


@pytest.mark.parametrize("seconds", [0.4, 0.8, 1.2])
def test_a_busy_receiver_does_not_lower_the_rate_for_long(seconds: float) -> None:
    def held_until(now: float) -> float:
        return now - now % 10 + seconds if now > 10 and now % 10 < seconds else 0.0

    run = Simulation(Link(lambda now: 1e8, held_until=held_until), start=1e6).run(60)
    assert min(run.targets_of(8, 60)) > 1.9e6
    assert all(run.rate(at + seconds + 0.3, at + seconds + 1.3) > 1.5e6 for at in range(20, 51, 10))


def test_a_receiver_s_estimate_counts_only_without_feedback() -> None:
    controller = CongestionController(5e5, 5e4, 2e6, 0.0)
    controller.estimated(1e6, 0.1)
    assert controller.target == 1e6
    controller.estimated(1e9, 0.2)
    assert controller.target == 2e6
    number = controller.sent(1200, 0.3)
    controller.acknowledged(Feedback(number, 10, (0.0,)), 0.4)
    controller.estimated(1e5, 0.5)
    assert controller.target == 2e6


def test_feedback_about_packets_that_were_never_sent_is_ignored() -> None:
    controller = CongestionController(5e5, 5e4, 2e6, 0.0)
    for moment in range(100):
        controller.acknowledged(
            Feedback(moment * 600, (moment * 99_999) % 2**24, (0.0, None) * 500), moment / 10
        )
    assert controller.target == 5e5
