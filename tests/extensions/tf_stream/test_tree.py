"""The mode without a target, which sends the tree's own transforms where they make a difference."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rwt.extensions.tf_stream.transform_filters import MissingFrames, Request, TreeFilter
from rwt_tf2 import Buffer, StampedTransform, Transform
from tests.extensions.tf_stream.conftest import Asking, Lab, places

LINEAR, ANGULAR = 0.01, 0.01
TREE = {
    "odom": "map",
    "base": "odom",
    "shoulder": "base",
    "elbow": "shoulder",
    "hand": "elbow",
    "camera": "base",
}
GOAL: dict[str, object] = {"angular_thres": ANGULAR, "trans_thres": LINEAR, "rate": 10.0}


def changes(*sources: str, linear: float = LINEAR, angular: float = ANGULAR) -> TreeFilter:
    missing = MissingFrames(lambda text: None, lambda: 0.0)
    return TreeFilter(Request("", sources, angular, linear, 0.1), missing)


def children(due: list[StampedTransform]) -> list[str]:
    return [each.child for each in due]


class Arm:
    """A robot of a few links of a metre each."""

    def __init__(self) -> None:
        self.buffer = Buffer()
        self._now = 0
        self.move({frame: Transform((1.0, 0.0, 0.0)) for frame in TREE})

    def move(self, transforms: dict[str, Transform]) -> None:
        self._now += 100_000_000
        for child, transform in transforms.items():
            self.buffer.set_transform(StampedTransform(TREE[child], child, self._now, transform))


@pytest.mark.anyio
async def test_a_goal_without_a_target_gets_the_tree(lab: Lab, page: Asking) -> None:
    await page.send_goal(GOAL)
    lab.publish_all([("map", "base", 1.0), ("base", "arm", 0.5)])
    lab.publish_fixed("base", "laser", 0.25)
    await lab.pass_time(0.1)
    lab.publish_all([("map", "base", 2.0), ("base", "arm", 0.5)])
    await lab.pass_time(0.1)
    first, second = page.feedback()
    assert places(first) == {"base": 1.0, "arm": 0.5, "laser": 0.25}
    assert {each["child_frame_id"]: each["header"]["frame_id"] for each in first} == {
        "base": "map",
        "arm": "base",
        "laser": "base",
    }
    assert places(second) == {"base": 2.0}


def test_what_is_far_out_is_as_exact_as_the_rest() -> None:
    """A turn too small to matter at the shoulder moves the hand, two metres out, by more than is allowed."""
    arm, filter_ = Arm(), changes()
    filter_.due(arm.buffer, 0)
    arm.move({"shoulder": Transform.from_rpy((1.0, 0.0, 0.0), 0.0, 0.0, 0.004)})
    assert children(filter_.due(arm.buffer, 0)) == []
    arm.move({"shoulder": Transform.from_rpy((1.0, 0.0, 0.0), 0.0, 0.0, 0.006)})
    assert children(filter_.due(arm.buffer, 0)) == ["shoulder"]


def test_small_changes_on_the_way_go_together() -> None:
    arm, filter_ = Arm(), changes()
    filter_.due(arm.buffer, 0)
    for frame in ("odom", "base"):
        arm.move({frame: Transform((1.004, 0.0, 0.0))})
        assert children(filter_.due(arm.buffer, 0)) == []
    arm.move({"shoulder": Transform((1.004, 0.0, 0.0))})
    assert children(filter_.due(arm.buffer, 0)) == ["odom", "base", "shoulder"]


def test_frames_asked_for_come_with_those_above_them() -> None:
    arm = Arm()
    assert children(changes("camera").due(arm.buffer, 0)) == ["odom", "base", "camera"]
    assert children(changes("map").due(arm.buffer, 0)) == []


def test_a_new_parent_is_a_change() -> None:
    arm, filter_ = Arm(), changes()
    filter_.due(arm.buffer, 0)
    arm.buffer.set_transform(StampedTransform("map", "camera", 10**9, Transform((1.0, 0.0, 0.0))))
    assert children(filter_.due(arm.buffer, 0)) == ["camera"]


def test_thresholds_of_zero_send_every_change_and_nothing_else() -> None:
    arm, filter_ = Arm(), changes(linear=0.0, angular=0.0)
    assert len(filter_.due(arm.buffer, 0)) == len(TREE)
    arm.move({"hand": Transform((1.0, 1e-9, 0.0)), "camera": Transform((1.0, 0.0, 0.0))})
    assert children(filter_.due(arm.buffer, 0)) == ["hand"]
    filter_.forget()
    assert len(filter_.due(arm.buffer, 0)) == len(TREE)


SMALL = st.floats(-0.02, 0.02)
STEPS = st.lists(
    st.dictionaries(
        st.sampled_from(sorted(TREE)), st.tuples(SMALL, SMALL, SMALL, SMALL, SMALL, SMALL), min_size=1
    ),
    min_size=1,
    max_size=6,
)


def poses(buffer: Buffer) -> Iterator[tuple[str, Transform]]:
    for frame in TREE:
        pose, at = Transform(), frame
        while (edge := buffer.latest(at)) is not None:
            pose, at = edge.transform @ pose, edge.parent
        yield frame, pose


@settings(max_examples=60)
@given(STEPS)
def test_a_client_is_never_off_by_more_than_the_thresholds(steps: list[dict[str, Any]]) -> None:
    arm, filter_, client = Arm(), changes(), Buffer()
    for step in [{}, *steps]:
        arm.move(
            {frame: Transform.from_rpy((1 + x, y, z), *turn) for frame, (x, y, z, *turn) in step.items()}
        )
        for stamped in filter_.due(arm.buffer, 0):
            client.set_transform(stamped)
        held = dict(poses(client))
        for frame, pose in poses(arm.buffer):
            assert pose.distance_to(held[frame]) <= LINEAR + 1e-9
            assert pose.angle_to(held[frame]) <= ANGULAR + 1e-9
