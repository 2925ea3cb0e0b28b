"""The queue of one topic, without a network: batches end with their time, and lose nothing."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import pytest

from rwt.extensions.zenoh import receive_queue
from rwt.extensions.zenoh.link import ZenohLink
from rwt.extensions.zenoh.receive_queue import ReceiveQueue

SAMPLES = 1000


@pytest.mark.parametrize(("seconds_each", "most"), [(0.0, 256), (0.001, 16), (0.0001, 64)])
def test_a_batch_ends_with_its_time(monkeypatch: pytest.MonkeyPatch, seconds_each: float, most: int) -> None:
    now = 0.0
    calls: list[Callable[[], None]] = []
    handled: list[int] = []

    def on_sample(sample: Any) -> None:
        nonlocal now
        handled.append(sample.number)
        now += seconds_each

    monkeypatch.setattr(receive_queue, "perf_counter", lambda: now)
    received: list[Callable[[Any], None]] = []

    def declare_subscriber(key: str, handler: Any, **_: object) -> SimpleNamespace:
        received.append(handler.callback)
        return SimpleNamespace(undeclare=None)

    session = SimpleNamespace(declare_subscriber=declare_subscriber)
    link = cast("ZenohLink", SimpleNamespace(run_on_graph=calls.append, session=session))
    ReceiveQueue(link, "0/t", on_sample, history=False, prompt=False)
    for number in range(SAMPLES):
        received[0](SimpleNamespace(number=number, payload=b"x"))
    sizes = []
    while calls:
        before = len(handled)
        calls.pop(0)()
        sizes.append(len(handled) - before)
    assert handled == list(range(SAMPLES))
    assert max(sizes) == most
