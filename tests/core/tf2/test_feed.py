"""Messages into a buffer, and out of one."""

from __future__ import annotations

import logging
from types import SimpleNamespace
from typing import Any

import pytest

from rwt_interfaces import DISTROS, Registry
from rwt_tf2 import Buffer, Feed, StampedTransform, Transform, read_transform, stamp_ns, write_transform

S = 1_000_000_000


def message(*transforms: tuple[str, str, float, float]) -> Any:
    """A message of (parent, child, seconds, x)."""
    return SimpleNamespace(
        transforms=[
            SimpleNamespace(
                header=SimpleNamespace(
                    frame_id=parent, stamp=SimpleNamespace(sec=int(seconds), nanosec=round(seconds % 1 * S))
                ),
                child_frame_id=child,
                transform=SimpleNamespace(
                    translation=SimpleNamespace(x=x, y=0.0, z=0.0),
                    rotation=SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0),
                ),
            )
            for parent, child, seconds, x in transforms
        ]
    )


@pytest.mark.parametrize("distro", sorted(DISTROS))
def test_messages_of_either_distribution_round_trip(distro: str) -> None:
    kind = Registry(DISTROS[distro]).message("geometry_msgs/TransformStamped")
    stamped = StampedTransform("map", "base", 12 * S + 34, Transform((1.5, -2.0, 3.0), (0.0, 0.6, 0.0, 0.8)))
    decoded: Any = kind.json.decode(
        kind.json.encode(kind.decode_leniently(write_transform(stamped), lambda: 0))
    )
    assert read_transform(decoded) == stamped


def test_either_spelling_of_a_time_is_read() -> None:
    assert stamp_ns(SimpleNamespace(sec=1, nanosec=2)) == S + 2
    assert stamp_ns(SimpleNamespace(secs=1, nsecs=2)) == S + 2


def test_one_bad_transform_does_not_stop_the_others(caplog: pytest.LogCaptureFixture) -> None:
    feed = Feed(Buffer())
    for _ in range(3):
        feed.take(message(("map", "map", 1, 0.0), ("map", "base", 1, 2.0)))
    assert feed.buffer.lookup_transform("map", "base").transform.translation[0] == 2.0
    assert (feed.taken, feed.refused) == (3, 3)
    assert [record.message for record in caplog.records] == [
        "transform rejected: map cannot be its own parent"
    ]


def test_time_set_back_is_noticed(caplog: pytest.LogCaptureFixture) -> None:
    feed = Feed(Buffer())
    feed.take(message(("base", "laser", 0, 0.1)), static=True)
    feed.take(message(("map", "base", 1000, 1.0)))
    for tick in range(5):
        feed.take(message(("map", "base", 1 + tick, float(tick))))
    found = feed.buffer.lookup_transform("map", "laser")
    assert found.stamp_ns == 5 * S
    assert found.transform.translation[0] == pytest.approx(4.1)
    assert "time jumped back" in caplog.text


def test_a_publisher_that_is_far_behind_does_not_clear_the_buffer(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING)
    feed = Feed(Buffer())
    feed.take(message(("map", "late", 1000, 0.0)))
    for tick in range(20):
        feed.take(message(("map", "base", 1000 + tick, float(tick))))
        feed.take(message(("map", "late", tick, 0.0)))
    assert feed.buffer.lookup_transform("map", "base", 1010 * S).transform.translation[0] == 10.0
    assert feed.refused == 20
    assert "set back" not in caplog.text
