"""The buffer: what tf2's documentation promises, case by case."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rwt_tf2 import (
    Buffer,
    ConnectivityError,
    ExtrapolationError,
    InvalidTransform,
    LoopRefused,
    StaleTransform,
    StampedTransform,
    Transform,
    UnknownFrame,
)
from rwt_tf2.buffer import MOST_FRAMES
from tests.held import held

S = 1_000_000_000


def moved(x: float, y: float = 0.0, z: float = 0.0) -> Transform:
    return Transform((x, y, z))


def given(parent: str, child: str, seconds: float, transform: Transform | float = 0.0) -> StampedTransform:
    moves = transform if isinstance(transform, Transform) else moved(transform)
    return StampedTransform(parent, child, round(seconds * S), moves)


def filled(*stamped: StampedTransform) -> Buffer:
    buffer = Buffer()
    for each in stamped:
        buffer.set_transform(each)
    return buffer


def x_of(buffer: Buffer, target: str, source: str, seconds: float = 0) -> float:
    return buffer.lookup_transform(target, source, round(seconds * S)).transform.translation[0]


# -- which way round


def test_a_lookup_takes_points_of_the_source_to_the_target() -> None:
    quarter = Transform.from_rpy((1.0, 2.0, 0.0), 0.0, 0.0, math.pi / 2)
    buffer = filled(given("map", "base", 1, quarter))
    found = buffer.lookup_transform("map", "base")
    assert (found.parent, found.child, found.stamp_ns) == ("map", "base", S)
    assert found.transform.apply((1.0, 0.0, 0.0)) == pytest.approx((1.0, 3.0, 0.0))
    assert buffer.lookup_transform("base", "map").transform.apply((1.0, 3.0, 0.0)) == pytest.approx(
        (1.0, 0.0, 0.0)
    )


def test_a_leading_slash_is_removed_everywhere() -> None:
    buffer = filled(given("/map", "/base", 1, 1.0))
    assert buffer.frames() == ("base", "map")
    assert x_of(buffer, "/map", "base") == 1.0
    assert buffer.has_frame("/map") and not buffer.has_frame("//map")


def test_a_frame_seen_from_itself_is_the_identity_known_or_not() -> None:
    buffer = filled(given("map", "base", 1, 1.0))
    assert buffer.lookup_transform("base", "base") == StampedTransform("base", "base", S, Transform())
    assert buffer.lookup_transform("base", "base", 99 * S).stamp_ns == 99 * S
    assert buffer.lookup_transform("ghost", "/ghost") == StampedTransform("ghost", "ghost", 0, Transform())


# -- time


def test_what_comes_late_is_sorted_in_and_the_same_time_again_replaces() -> None:
    buffer = filled(given("map", "base", 1, 1.0), given("map", "base", 3, 3.0), given("map", "base", 2, 20.0))
    assert x_of(buffer, "map", "base", 2) == 20.0
    assert x_of(buffer, "map", "base", 1.5) == 10.5
    buffer.set_transform(given("map", "base", 2, 2.0))
    assert x_of(buffer, "map", "base", 2) == 2.0
    assert x_of(buffer, "map", "base", 2.5) == 2.5


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (0.5, "the past: its earliest is 0.500000000 s younger, at 1.000000000 s"),
        (2.25, "the future: its latest is 0.250000000 s older, at 2.000000000 s"),
    ],
)
def test_nothing_is_extrapolated(seconds: float, words: str) -> None:
    buffer = filled(given("map", "base", 1), given("map", "base", 2))
    buffer.set_transform(given("base", "tool", 0), static=True)
    with pytest.raises(ExtrapolationError) as failure:
        buffer.lookup_transform("map", "tool", round(seconds * S))
    asked = f"map <- tool at {seconds:.9f} s"
    assert str(failure.value) == f"{asked} needs map <- base extrapolated into {words}"
    assert (failure.value.parent, failure.value.child) == ("map", "base")
    assert failure.value.future == (seconds > 2)


def test_a_gap_above_the_way_does_not_matter() -> None:
    buffer = filled(given("map", "base", 1), given("base", "arm", 5, 1.0), given("base", "tool", 5, 3.0))
    assert x_of(buffer, "arm", "tool", 5) == 2.0
    assert x_of(buffer, "base", "tool", 5) == 3.0


def test_the_latest_common_time_is_the_oldest_of_the_latest_on_the_way() -> None:
    buffer = filled(
        given("map", "odom", 1, 1.0),
        given("map", "odom", 4, 4.0),
        given("odom", "base", 2, 2.0),
        given("odom", "base", 3, 3.0),
    )
    buffer.set_transform(given("base", "laser", 99, 0.5), static=True)
    assert buffer.latest_common_time("map", "laser") == 3 * S
    found = buffer.lookup_transform("map", "laser")
    assert found.stamp_ns == 3 * S
    assert found.transform.translation == pytest.approx((3.0 + 3.0 + 0.5, 0.0, 0.0))
    assert buffer.latest_common_time("base", "laser") == 0


def test_no_common_time_is_an_extrapolation() -> None:
    buffer = filled(given("map", "odom", 1), given("odom", "base", 9))
    with pytest.raises(ExtrapolationError, match=r"needs odom <- base extrapolated into the past"):
        buffer.lookup_transform("map", "base")


def test_the_cache_forgets_what_is_older_than_it_keeps() -> None:
    buffer = Buffer(cache_ns=2 * S)
    for second in range(1, 6):
        buffer.set_transform(given("map", "base", second, float(second)))
    assert x_of(buffer, "map", "base", 3) == 3.0
    assert not buffer.can_transform("map", "base", round(2.9 * S))
    with pytest.raises(StaleTransform, match=r"map <- base at 2\.9.* is more than 2 s older .* of 5\.0"):
        buffer.set_transform(given("map", "base", 2.9))
    buffer.set_transform(given("map", "base", 3.5, 99.0))
    assert x_of(buffer, "map", "base", 3.5) == 99.0


def test_a_long_stream_is_kept_at_the_length_of_the_cache() -> None:
    buffer = Buffer(cache_ns=S)
    for tick in range(5000):
        buffer.set_transform(given("map", "base", 1 + tick / 100, tick / 100))
    assert x_of(buffer, "map", "base", 50.5) == pytest.approx(49.5)
    assert x_of(buffer, "map", "base", 49.99) == pytest.approx(48.99)
    assert not buffer.can_transform("map", "base", round(49.98 * S))
    # A second at a hundred transforms a second, and a bounded number of dead ones.
    assert held(buffer, kind=int) < 300


# -- static transforms


def test_a_static_transform_holds_at_all_times() -> None:
    buffer = Buffer()
    buffer.set_transform(given("base", "laser", 5, 0.2), static=True)
    for seconds in (0, 1, 1e6):
        assert x_of(buffer, "base", "laser", seconds) == 0.2
    assert buffer.is_static("laser") and not buffer.is_static("base")
    buffer.set_transform(given("base", "laser", 1, 0.3), static=True)
    assert x_of(buffer, "base", "laser") == 0.3


def test_the_kind_of_a_frame_is_that_of_its_last_transform() -> None:
    buffer = Buffer()
    buffer.set_transform(given("base", "laser", 5, 0.2), static=True)
    buffer.set_transform(given("base", "laser", 1, 0.3))
    assert not buffer.is_static("laser")
    assert not buffer.can_transform("base", "laser", 5 * S)
    buffer.set_transform(given("base", "laser", 1, 0.4), static=True)
    assert x_of(buffer, "base", "laser", 99) == 0.4


def test_clearing_keeps_what_is_static() -> None:
    buffer = filled(given("map", "base", 1))
    buffer.set_transform(given("base", "laser", 0, 0.2), static=True)
    buffer.clear()
    assert buffer.frames() == ("base", "laser")
    buffer.set_transform(given("map", "base", 0.5, 1.0))
    assert x_of(buffer, "map", "laser") == 1.2


# -- the tree


def test_two_trees_are_not_joined() -> None:
    buffer = filled(given("map", "base", 1), given("world", "camera", 1), given("camera", "lens", 1))
    with pytest.raises(ConnectivityError) as failure:
        buffer.lookup_transform("lens", "base")
    assert str(failure.value) == (
        "no chain of transforms joins lens and base: the tree of lens ends at world, that of base at map"
    )
    assert not buffer.can_transform("lens", "base", S)
    assert buffer.can_transform("lens", "base").reason == str(failure.value)


def test_a_frame_may_change_its_parent() -> None:
    """A gripper takes a box from a table: before, in between and after."""
    buffer = filled(
        given("world", "table", 1, 10.0),
        given("world", "table", 9, 10.0),
        given("world", "gripper", 1, 20.0),
        given("world", "gripper", 9, 20.0),
        given("table", "box", 2, 1.0),
        given("table", "box", 3, 3.0),
        given("gripper", "box", 5, 5.0),
        given("gripper", "box", 7, 7.0),
    )
    assert x_of(buffer, "world", "box", 2.5) == 12.0
    assert x_of(buffer, "world", "box", 4) == 13.0  # the table's holds until the gripper's
    assert x_of(buffer, "world", "box", 6) == 26.0
    assert buffer.parent("box") == "gripper"


@pytest.mark.parametrize("static", [False, True])
def test_loops_are_refused(static: bool) -> None:
    buffer = filled(given("a", "b", 1), given("b", "c", 1))
    with pytest.raises(LoopRefused) as failure:
        buffer.set_transform(given("c", "a", 1), static=static)
    assert str(failure.value) == "c <- a would close a loop: a <- b <- c <- a"
    assert buffer.parent("a") is None
    buffer.set_transform(given("x", "b", 2))
    buffer.set_transform(given("b", "c", 2))
    buffer.set_transform(given("c", "a", 2))
    assert buffer.can_transform("x", "a")


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (given("", "base", 1), "no parent"),
        (given("map", "/", 1), "no child"),
        (given("map", "/map", 1), "map cannot be its own parent"),
        (given("map", "base", 1, math.nan), "not finite"),
        (given("map", "base", 1, Transform(rotation=(0, 0, math.inf, 1))), "not finite"),
        (given("map", "base", 1, Transform(rotation=(0, 0, 0, 0))), "not a unit quaternion; its length is 0"),
        (given("map", "base", 1, Transform(rotation=(0, 0, 0, 1.01))), "its length is 1.01"),
        (given("map", "b" * 300, 1), "longer than 256"),
    ],
)
def test_what_is_no_transform_is_refused(wrong: StampedTransform, words: str) -> None:
    buffer = Buffer()
    with pytest.raises(InvalidTransform, match=words):
        buffer.set_transform(wrong)
    assert buffer.frames() == ()


def test_a_rotation_that_is_nearly_a_unit_is_made_one() -> None:
    buffer = filled(given("map", "base", 1, Transform(rotation=(0.0, 0.0, 0.0, 1.004))))
    assert buffer.lookup_transform("map", "base").transform.rotation == (0.0, 0.0, 0.0, 1.0)


def test_the_number_of_frames_is_bounded() -> None:
    buffer = Buffer()
    for number in range(MOST_FRAMES - 1):
        buffer.set_transform(given("map", f"frame{number}", 1), static=True)
    with pytest.raises(InvalidTransform, match="there are 10000 frames already"):
        buffer.set_transform(given("map", "one_more", 1))
    buffer.set_transform(given("frame1", "frame2", 1))


@pytest.mark.slow
def test_a_deep_tree_is_no_problem() -> None:
    buffer = filled(*(given(f"f{depth}", f"f{depth + 1}", 1, 1.0) for depth in range(2000)))
    assert x_of(buffer, "f0", "f2000") == 2000.0
    assert len(buffer.tree().splitlines()) == 2001


# -- the advanced lookup


def test_one_time_seen_from_another_through_a_fixed_frame() -> None:
    """Where is now what the camera saw two seconds ago?"""
    buffer = filled(
        given("world", "base", 1, 1.0), given("world", "base", 3, 3.0), given("base", "camera", 1, 0.5)
    )
    buffer.set_transform(given("base", "camera", 3, 0.5))
    found = buffer.lookup_transform_full("base", 3 * S, "camera", 1 * S, "world")
    assert (found.parent, found.child, found.stamp_ns) == ("base", "camera", 3 * S)
    assert found.transform.translation == pytest.approx((1.0 + 0.5 - 3.0, 0.0, 0.0))
    assert buffer.can_transform_full("base", 3 * S, "camera", 1 * S, "world")
    assert "into the future" in buffer.can_transform_full("base", 4 * S, "camera", 1 * S, "world").reason


# -- many times


@pytest.mark.parametrize("reparent", [False, True])
def test_many_times_at_once_are_as_one_by_one(reparent: bool) -> None:
    buffer = Buffer()
    for second in range(1, 8):
        yaw = Transform.from_rpy((second, second**2, 0.5), 0.1 * second, 0.2, 2.9 * second)
        buffer.set_transform(given("map", "base", second, yaw))
        buffer.set_transform(given("map", "other", second, 1.0))
        parent = "other" if reparent and second > 4 else "base"
        buffer.set_transform(given(parent, "arm", second, Transform.from_rpy((1, 0, 0), second, 0, 0)))
    buffer.set_transform(given("map", "fixed", 0, Transform.from_rpy((1, 2, 3), 1, 0, 0)), static=True)
    times = np.array([5, 1, 1.5, 3.25, 7, 6.999]) * S
    moved, turned = buffer.lookup_many("fixed", "arm", times.astype(np.int64))
    for time, translation, rotation in zip(times, moved, turned, strict=True):
        one = buffer.lookup_transform("fixed", "arm", int(time)).transform
        assert translation == pytest.approx(one.translation)
        assert Transform(rotation=tuple(rotation)).angle_to(one) < 1e-7
    with pytest.raises(ExtrapolationError):
        buffer.lookup_many("fixed", "arm", [S, 9 * S])
    assert buffer.lookup_many("fixed", "arm", [])[0].shape == (0, 3)


def test_many_times_of_a_frame_that_was_said_once() -> None:
    buffer = filled(given("map", "base", 1, 2.0))
    moved, turned = buffer.lookup_many("map", "base", [S, S])
    assert moved.tolist() == [[2.0, 0.0, 0.0]] * 2
    assert turned.tolist() == [[0.0, 0.0, 0.0, 1.0]] * 2


# -- listings


def small() -> Buffer:
    buffer = filled(given("map", "odom", 1), given("map", "odom", 1.5), given("odom", "base", 2))
    buffer.set_transform(given("base", 'a "laser"', 0), static=True)
    return buffer


YAML = """\
"a \\"laser\\"":
  parent: "base"
  static: true
  rate: 0.000
  most_recent_transform: 0.000000000
  oldest_transform: 0.000000000
  buffer_length: 0.000
"base":
  parent: "odom"
  static: false
  rate: 0.000
  most_recent_transform: 2.000000000
  oldest_transform: 2.000000000
  buffer_length: 0.000
"odom":
  parent: "map"
  static: false
  rate: 2.000
  most_recent_transform: 1.500000000
  oldest_transform: 1.000000000
  buffer_length: 0.500
"""

DOT = """\
digraph frames {
  "base" -> "a \\"laser\\"" [label="static"];
  "odom" -> "base" [label="once"];
  "map" -> "odom" [label="2.0 Hz"];
}
"""

TREE = """\
map
└─ odom (2.0 Hz)
   ├─ base (once)
   │  └─ a "laser" (static)
   └─ ghost (static)
"""


def test_the_tree_is_listed() -> None:
    buffer = small()
    assert buffer.all_frames_as_yaml() == YAML
    assert buffer.all_frames_as_dot() == DOT
    buffer.set_transform(given("odom", "ghost", 0), static=True)
    assert buffer.tree() == TREE


def test_an_empty_buffer_is_listed_too() -> None:
    assert (Buffer().all_frames_as_yaml(), Buffer().tree()) == ("{}\n", "")
    with pytest.raises(UnknownFrame, match='frame "map" is not known; known are none'):
        Buffer().parent("map")


def test_questions_about_one_frame() -> None:
    buffer = small()
    assert buffer.parent("odom") == "map"
    assert buffer.latest("odom") == given("map", "odom", 1.5)
    assert buffer.latest("map") is None
    assert [buffer.rate(frame) for frame in ("odom", "base", "map")] == [2.0, 0.0, 0.0]
