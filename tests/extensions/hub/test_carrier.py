"""Turns of the connection between a robot and a hub, whose frames are those of many clients."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import pytest

from rwt.extensions.hub.uplink.carrier import PIECE_BYTES, READ_SECONDS, Carrier
from rwt.extensions.hub.uplink.frames import (
    FeedHead,
    Hello,
    Join,
    Lane,
    encode_ack,
    encode_credit,
    encode_end,
    encode_feed,
    encode_hello,
    encode_join,
    encode_leave,
    encode_ping,
    encode_sample,
    is_sequenced,
)
from rwt.extensions.hub.uplink.uplink import MAX_ORDERS, Uplink
from rwt_protocol.frames import Burst, Frame
from rwt_transports import Limits
from rwt_transports.background import ignore
from rwt_transports.endpoint import Endpoint, Flow, Traffic
from rwt_transports.scheduler import WRITING, Scheduler
from rwt_transports.shared_pool import Holder

LIMITS = Limits()
LOOK_SECONDS = 0.0005
"""Time that each look at the clock takes."""


@dataclass(eq=False)
class Line:
    """Connection that keeps what is sent, and its flow control."""

    sent: list[bytes] = field(default_factory=list)
    is_paused: bool = False
    received: int = 0
    backlog: int = 0
    traffic: Traffic = field(default_factory=Traffic)

    def send(self, frame: Frame) -> None:
        self.sent.append(frame.data)

    def close(self, code: int = 1000, reason: str = "") -> None:
        raise AssertionError(f"closed: {code} {reason}")

    def flow(self, *given: object, **named: object) -> Flow:
        raise AssertionError("not expected")

    def hand_over(self, endpoint: Endpoint) -> None:
        raise AssertionError("not expected")

    def count_for(self, holder: Holder) -> None:
        raise AssertionError("not expected")

    def join(self, burst: Burst) -> bool:
        return False

    def pause(self) -> None:
        self.is_paused = True

    def resume(self) -> None:
        self.is_paused = False

    def when_empty(self, callback: Callable[[], None]) -> None:
        raise AssertionError("not expected")


class Side(Carrier):
    """Carrier of a given uplink."""

    def __init__(self, line: Line, scheduler: Scheduler, uplink: Uplink) -> None:
        super().__init__(line, scheduler)
        self._given = uplink
        self.set_flow_control(line)

    def greeted(self, hello: Hello) -> None:
        self.carry(self._given, 0)

    def gone(self, code: int, reason: str) -> None:
        raise AssertionError(f"gone: {code} {reason}")


class Turns:
    """One side, whose turns of the event loop the test takes."""

    def __init__(self, *, at_robot: bool) -> None:
        self.calls: list[Callable[[], None]] = []
        seconds = itertools.count(0, LOOK_SECONDS)
        scheduler = Scheduler(WRITING, self.calls.append, lambda _, call: call(), lambda: next(seconds))
        self.line = Line()
        self.uplink = Uplink(
            "s",
            LIMITS,
            LIMITS.receive_pool(),
            lambda: self.side.wake(),
            repeats=at_robot,
            opened=ignore if at_robot else None,
            fed=None if at_robot else ignore,
        )
        self.side = Side(self.line, scheduler, self.uplink)
        self.side.receive(encode_hello(Hello()), True)

    def next(self) -> None:
        calls, self.calls[:] = tuple(self.calls), ()
        for call in calls:
            call()


FROM_ROBOT = {
    "CREDIT": encode_credit(1, 1),
    "END": encode_end(1, 1000, ""),
    "FEED": encode_feed(1, FeedHead("/odom")),
    "JOIN": encode_join(1, Join(1)),
    "LEAVE": encode_leave(1, 1),
    "PING": encode_ping(),
    "SAMPLE": encode_sample(1, Lane.SMALL, memoryview(b""), binary=True, is_last=True),
    "unknown": bytes((50, 0, 0, 0, 0, 1)),
}
FROM_HUB = {name: FROM_ROBOT[name] for name in ("CREDIT", "END", "PING", "unknown")}


@pytest.mark.parametrize(
    ("at_robot", "name"),
    [*((True, name) for name in FROM_HUB), *((False, name) for name in FROM_ROBOT)],
)
def test_the_frames_of_one_read_are_processed_in_several_turns(at_robot: bool, name: str) -> None:
    turns, processed, most = Turns(at_robot=at_robot), 0, 0
    turns.line.received += 1  # All of them are of one read.
    for _ in range(200):
        in_turn = 0
        while not turns.line.is_paused and processed < 1000:
            turns.side.receive(FROM_ROBOT[name], True)
            processed += 1
            in_turn += 1
        most = max(most, in_turn)
        turns.next()
    assert processed == 1000
    assert most <= READ_SECONDS / LOOK_SECONDS + 1


def test_very_many_small_frames_are_sent_in_several_turns() -> None:
    turns, arrived, most = Turns(at_robot=False), 0, 0
    for _ in range(40):
        while turns.uplink.waiting_orders < MAX_ORDERS:
            turns.uplink.order(encode_credit(1, 1))
        before = len(turns.line.sent)
        turns.next()
        sent = sum(len(frame) for frame in turns.line.sent[before:] if is_sequenced(frame))
        most, arrived = max(most, sent), arrived + sent
        # The window grows, as everything arrives at once.
        turns.uplink.receive(encode_ack(arrived), time.monotonic())
    looks = WRITING.share / LOOK_SECONDS + 1
    assert 2 * PIECE_BYTES < most <= looks * (PIECE_BYTES + 100)
