"""The action, as ROS 2's clients use it: when which transform is sent."""

from __future__ import annotations

from typing import Any

import pytest

from rwt.extensions.tf_stream.republisher import MOST_STREAMS
from rwt.extensions.tf_stream.streams import FEEDBACK_TIMEOUT
from rwt_tf2 import Transform
from tests.conftest import START_NS
from tests.extensions.tf_stream.conftest import Asking, Lab, places, settle

pytestmark = pytest.mark.anyio


def goal(
    *sources: str, target: str = "map", angular: float = 0.01, linear: float = 0.01, rate: float = 10.0
) -> Any:
    return {
        "source_frames": list(sources),
        "target_frame": target,
        "angular_thres": angular,
        "trans_thres": linear,
        "rate": rate,
    }


def turned(yaw: float) -> Transform:
    return Transform.from_rpy((0.0, 0.0, 0.0), 0.0, 0.0, yaw)


@pytest.mark.parametrize("package", ["interfaces", "msgs"])
async def test_a_goal_gets_what_it_asked_for_in_either_spelling(lab: Lab, page: Asking, package: str) -> None:
    await page.send_goal(goal("/base", "laser", target="/map"), package=package)
    lab.publish("map", "base", 1.5)
    lab.publish_fixed("base", "laser", 0.25)
    await lab.pass_time(0.1)
    [message] = page.heard()
    assert message["values"] == {
        "transforms": [
            {
                "header": {"stamp": {"sec": START_NS // 10**9, "nanosec": 100_000_000}, "frame_id": "map"},
                "child_frame_id": child,
                "transform": {
                    "translation": {"x": x, "y": 0.0, "z": 0.0},
                    "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
                },
            }
            for child, x in (("base", 1.5), ("laser", 1.75))
        ]
    }


async def test_only_what_moved_beyond_the_threshold_since_it_was_sent_is_sent_again(
    lab: Lab, page: Asking
) -> None:
    await page.send_goal(goal("slow", "fast", linear=1.0))
    seen = []
    for step in range(6):
        lab.publish_all([("map", "slow", 0.5 * step), ("map", "fast", 2.0 * step)])
        await lab.pass_time(0.1)
        seen.append([places(each) for each in page.feedback()])
    # A distance of exactly the threshold is not beyond it.
    assert seen == [
        [{"slow": 0.0, "fast": 0.0}],
        [{"fast": 2.0}],
        [{"fast": 4.0}],
        [{"slow": 1.5, "fast": 6.0}],
        [{"fast": 8.0}],
        [{"fast": 10.0}],
    ]


@pytest.mark.parametrize(("angular", "linear"), [(0.0, 5.0), (5.0, 0.0)])
async def test_a_threshold_of_zero_sends_everything_every_time(
    lab: Lab, page: Asking, angular: float, linear: float
) -> None:
    await page.send_goal(goal("base", angular=angular, linear=linear))
    lab.publish("map", "base", 1.0)
    for _ in range(5):
        await lab.pass_time(0.1)
    assert len(page.feedback()) == 5


async def test_angles_are_measured_as_half_of_the_rotation(lab: Lab, page: Asking) -> None:
    await page.send_goal(goal("base", angular=0.1))
    sent = []
    for yaw in (0.0, 0.19, 0.21, 0.4, 0.42):
        lab.publish("map", "base", turned(yaw))
        await lab.pass_time(0.1)
        sent.append(len(page.feedback()))
    assert sent == [1, 0, 1, 0, 1]


async def test_the_clients_default_of_2_radians_hears_no_rotation_until_the_quaternion_flips(
    lab: Lab, page: Asking
) -> None:
    await page.send_goal(goal("base", angular=2.0))
    sent = []
    for yaw in (0.0, 1.5, 3.1):
        lab.publish("map", "base", turned(yaw))
        await lab.pass_time(0.1)
        sent.append(len(page.feedback()))
    x, y, z, w = turned(0.1).rotation
    lab.publish("map", "base", Transform(rotation=(-x, -y, -z, -w)))
    await lab.pass_time(0.1)
    assert sent == [1, 0, 0]
    assert len(page.feedback()) == 1


async def test_numbers_are_rounded_to_a_micrometre(lab: Lab, page: Asking) -> None:
    await page.send_goal(goal("base"))
    lab.publish("map", "base", Transform.from_rpy((1 / 3, 0.0, 0.0), 0.0, 0.0, 1.0))
    await lab.pass_time(0.1)
    [[sent]] = page.feedback()
    assert sent["transform"]["translation"]["x"] == 0.333333
    assert sent["transform"]["rotation"] == {"x": 0.0, "y": 0.0, "z": 0.479426, "w": 0.877583}


async def test_frames_that_cannot_be_had_are_left_out_and_told_of_once(
    lab: Lab, page: Asking, caplog: pytest.LogCaptureFixture
) -> None:
    await page.send_goal(goal("base", "ghost"))
    lab.publish("map", "base", 1.0)
    await lab.pass_time(1.0)
    assert caplog.messages == []
    await lab.pass_time(5.0)
    assert [places(each) for each in page.feedback()] == [{"base": 1.0}]
    said = [message for message in caplog.messages if "ghost" in message]
    assert len(said) == 1 and 'frame "ghost" is not known; known are base, map' in said[0]
    lab.publish("map", "ghost", 2.0)
    await lab.pass_time(0.1)
    assert [places(each) for each in page.feedback()] == [{"ghost": 2.0}]


async def test_several_goals_run_at_once_each_at_its_own_rate(lab: Lab, page: Asking) -> None:
    await page.send_goal(goal("base", linear=0.0, rate=10), "quick")
    await page.send_goal(goal("base", linear=0.0, rate=2), "slow")
    await page.send_goal(goal("map", target="base", linear=0.0, rate=0), "default")
    lab.publish("map", "base", 1.0)
    for _ in range(20):
        await lab.pass_time(0.1)
    frames = page.heard()
    counts = {id: sum(frame["id"] == id for frame in frames) for id in ("quick", "slow", "default")}
    assert counts == {"quick": 20, "slow": 4, "default": 20}


async def test_a_cancel_ends_the_goal(lab: Lab, page: Asking) -> None:
    await page.send_goal(goal("base"))
    page.cancel()
    await settle()
    [result] = page.heard()
    assert (result["op"], result["status"], result["result"], result["values"]) == (
        "action_result",
        5,
        True,
        {},
    )
    lab.publish("map", "base", 1.0)
    await lab.pass_time(1.0)
    assert page.heard() == []


async def test_what_was_told_once_before_the_goal_is_known(lab: Lab, page: Asking) -> None:
    lab.publish("map", "base", 1.0)
    await lab.pass_time(30.0)
    await page.send_goal(goal("base"))
    await lab.pass_time(1.0)
    assert [places(each) for each in page.feedback()] == [{"base": 1.0}]


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"rate": -1.0}, "rate must not be negative, got -1"),
        ({"trans_thres": None}, "trans_thres must be a finite number, got nan"),
        ({"source_frames": ["f"] * 1001}, "at most 1000 source_frames, got 1001; none means all"),
    ],
)
async def test_what_cannot_be_served_is_refused_with_a_reason(
    page: Asking, fields: dict[str, object], words: str
) -> None:
    asked = {**goal("base"), **fields}
    await page.send_goal(asked)
    [refusal] = page.heard()
    assert refusal["result"] is False
    assert words in refusal["values"]
    answer = await page.call(asked)
    assert answer["result"] is False and words in answer["values"]


async def test_the_smallest_rate_has_a_period_still(lab: Lab, page: Asking) -> None:
    await page.send_goal(goal("base", rate=5e-324))
    assert (await page.call(goal("base", rate=5e-324)))["result"] is True
    assert not page.heard()


async def test_a_goal_whose_page_was_closed_ends_after_a_while(lab: Lab, page: Asking) -> None:
    await page.send_goal(goal("base"))
    page.client.leave()
    await lab.pass_time(FEEDBACK_TIMEOUT - 1)
    assert lab.ticking
    await lab.pass_time(2.0)
    assert not lab.ticking


async def test_of_too_many_goals_the_oldest_ends(lab: Lab, page: Asking) -> None:
    for number in range(MOST_STREAMS + 2):
        await page.send_goal(goal("base", linear=0.0), f"g{number}")
    ended = [frame for frame in page.heard() if frame["op"] == "action_result"]
    assert sorted(frame["id"] for frame in ended) == ["g0", "g1"]
    assert {frame["status"] for frame in ended} == {6}
    lab.publish("map", "base", 1.0)
    await lab.pass_time(0.1)
    assert len({frame["id"] for frame in page.heard()}) == MOST_STREAMS


async def test_all_frames_may_be_asked_for(lab: Lab, page: Asking) -> None:
    await page.send_goal(goal(target="base"))
    lab.publish_all([("map", "base", 1.0), ("base", "arm", 0.5)])
    await lab.pass_time(0.1)
    assert [places(each) for each in page.feedback()] == [{"map": -1.0, "arm": 0.5}]


async def test_it_follows_time_set_back(lab: Lab, page: Asking) -> None:
    await page.send_goal(goal("base"))
    lab.publish("map", "base", 1.0)
    await lab.pass_time(0.1)
    lab.clock.set_time(START_NS - 1000 * 10**9)
    for _ in range(4):
        lab.publish("map", "base", 7.0)
    await lab.pass_time(0.1)
    assert [places(each) for each in page.feedback()] == [{"base": 1.0}, {"base": 7.0}]
