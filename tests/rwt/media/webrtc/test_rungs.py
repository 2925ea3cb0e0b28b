"""Which bit rate a viewer gets: by a line of a given width, on a clock of the test's own."""

from __future__ import annotations

import pytest

from rwt.media.webrtc.bitrate_ladder import MOST_PATIENCE_SECONDS, PATIENCE_SECONDS, BitrateLadder

RATES = (1_500_000, 525_000, 180_000)


class Line:
    """A line and a receiver at its end, which says twice a second what it estimates, as libwebrtc does: a
    little above what comes, and below that when the line is full."""

    def __init__(self, bits: int, uses: float = 1.0) -> None:
        self.bits = bits
        self.chooser = BitrateLadder(RATES)
        self.now = 100.0
        self._uses = uses
        self.history: list[int] = []

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 20)):
            self.now += 0.05
            rate = RATES[self.chooser.rung] * self._uses
            self.chooser.sent(round(rate * 0.05 / 8), self.now)
            if round(self.now * 20) % 10 == 0:
                arriving = min(rate, self.bits)
                estimate = 0.85 * self.bits if rate > self.bits else min(1.5 * arriving, self.bits)
                self.chooser.estimated(round(estimate), self.now)
            self.history.append(self.chooser.rung)


def test_a_wide_line_keeps_the_best() -> None:
    line = Line(10_000_000)
    line.run(60)
    assert set(line.history) == {0}


def test_a_picture_that_needs_little_is_not_lowered_by_an_estimate_that_follows_it() -> None:
    line = Line(10_000_000, uses=0.05)
    line.run(60)
    assert set(line.history) == {0}


@pytest.mark.parametrize(("bits", "rung"), [(1_000_000, 1), (500_000, 2), (100_000, 2)])
def test_a_line_that_is_cut_gets_less_within_two_seconds(bits: int, rung: int) -> None:
    line = Line(10_000_000)
    line.run(5)
    line.bits = bits
    line.run(2)
    assert line.chooser.rung == rung


def test_a_line_that_has_recovered_gets_the_best_again() -> None:
    line = Line(400_000)
    line.run(10)
    assert line.chooser.rung == 2
    line.bits = 10_000_000
    line.run(4 * (2 * PATIENCE_SECONDS + 5))
    assert line.chooser.rung == 0


def test_what_does_not_hold_is_tried_less_and_less_often() -> None:
    line = Line(800_000)
    line.run(600)
    tries = sum(one > two for one, two in zip(line.history, line.history[1:], strict=False))
    assert 3 <= tries <= 600 / MOST_PATIENCE_SECONDS + 6


def test_loss_lowers_by_one() -> None:
    chooser = BitrateLadder(RATES)
    chooser.lost(0.05, 10.0)
    assert chooser.rung == 0
    chooser.lost(0.2, 11.0)
    chooser.lost(0.2, 11.5)  # Of what was sent before.
    assert chooser.rung == 1
    chooser.lost(0.2, 14.0)
    chooser.lost(0.2, 17.0)
    assert chooser.rung == 2


def test_who_asks_for_key_pictures_without_end_gets_less_and_no_longer_shares_with_others() -> None:
    chooser = BitrateLadder(RATES)
    for moment in range(40):  # As a receiver asks for one picture, until it is there.
        chooser.asked_for_key(10.0 + moment / 100)
    for moment in range(5):
        chooser.asked_for_key(20.0 + 10.0 * moment)
    assert chooser.rung == 0
    for moment in range(7):
        chooser.asked_for_key(100.0 + moment)
    assert chooser.rung == 1
    for moment in range(1000):
        chooser.asked_for_key(107.0 + moment / 100)
    assert chooser.rung == 2
