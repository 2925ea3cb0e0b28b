"""The service `/republish_tfs` and its topics, and the action over topics."""

from __future__ import annotations

from typing import Any

import pytest

from rwt.extensions.tf_stream.streams import FEEDBACK_TIMEOUT
from tests.extensions.tf_stream.conftest import Asking, Lab, places, settle

pytestmark = pytest.mark.anyio

REQUEST: dict[str, object] = {
    "source_frames": ["base"],
    "target_frame": "map",
    "angular_thres": 0.01,
    "trans_thres": 0.01,
    "rate": 10.0,
    "timeout": {"secs": 2, "nsecs": 0},
}


async def topic_of(page: Asking, **fields: object) -> str:
    answer = await page.call({**REQUEST, **fields})
    assert answer["result"] is True, answer
    return str(answer["values"]["topic_name"])


def exists(lab: Lab, topic: str) -> bool:
    info = lab.graph.topic(topic)
    return info is not None and bool(info.publishers)


async def test_each_call_gets_a_topic_of_its_own(lab: Lab, page: Asking) -> None:
    names = [await topic_of(page) for _ in range(3)]
    assert names == [f"/tf2_web_republisher/tf_repub_{number}" for number in range(3)]
    assert all(exists(lab, name) for name in names)


async def test_a_topic_carries_what_moved(lab: Lab, page: Asking) -> None:
    name = await topic_of(page)
    lab.publish("map", "base", 1.0)
    await lab.pass_time(0.5)
    page.client.say("subscribe", topic=name, type="tf2_web_republisher/TFArray")
    heard = []
    for x in (1.0, 1.005, 2.0):
        lab.publish("map", "base", x)
        await lab.pass_time(0.1)
        heard += [places(message["transforms"]) for message in page.client.heard_of(name)]
    assert heard == [{"base": 1.0}, {"base": 2.0}]


@pytest.mark.parametrize(
    ("said", "seconds"), [({"secs": 2}, 2.0), ({"secs": 0}, 10.0), ({}, 10.0)], ids=["given", "zero", "none"]
)
async def test_the_topic_goes_when_nobody_comes(
    lab: Lab, page: Asking, said: dict[str, int], seconds: float
) -> None:
    name = await topic_of(page, timeout=said)
    await lab.pass_time(seconds - 0.2)
    assert exists(lab, name)
    await lab.pass_time(0.4)
    assert not exists(lab, name)
    assert not lab.ticking


async def test_the_topic_stays_while_somebody_listens_and_goes_after(lab: Lab, page: Asking) -> None:
    name = await topic_of(page)
    page.client.say("subscribe", topic=name, type="tf2_web_republisher/TFArray", id="s")
    await lab.pass_time(30.0)
    assert exists(lab, name)
    page.client.say("unsubscribe", topic=name, id="s")
    await lab.pass_time(1.0)
    page.client.say("subscribe", topic=name, type="tf2_web_republisher/TFArray", id="s")
    await lab.pass_time(1.5)
    page.client.say("unsubscribe", topic=name, id="s")
    await lab.pass_time(1.9)
    assert exists(lab, name)
    await lab.pass_time(0.2)
    assert not exists(lab, name)


async def test_who_subscribes_gets_everything(lab: Lab, page: Asking) -> None:
    name = await topic_of(page)
    lab.publish("map", "base", 1.0)
    first: list[Any] = []
    lab.robot.subscribe(name, first.append)
    await lab.pass_time(0.5)
    second: list[Any] = []
    lab.robot.subscribe(name, second.append)
    second.clear()  # what the topic keeps for those who come late
    await lab.pass_time(0.1)
    assert [len(heard) for heard in (first, second)] == [2, 1]
    assert second[0].transforms[0].child_frame_id == "base"


async def test_a_negative_timeout_is_refused(page: Asking) -> None:
    answer = await page.call({**REQUEST, "timeout": {"secs": -1}})
    assert answer["result"] is False
    assert "timeout must not be negative, got -1 s" in answer["values"]


# -- the action over topics, as roslib's TFClient speaks it


def begin(page: Asking, id: str, **fields: object) -> None:
    goal = {key: value for key, value in REQUEST.items() if key != "timeout"}
    client = page.client
    client.say(
        "advertise", topic="/tf2_web_republisher/goal", type="tf2_web_republisher/TFSubscriptionActionGoal"
    )
    client.say("advertise", topic="/tf2_web_republisher/cancel", type="actionlib_msgs/GoalID")
    client.say(
        "subscribe",
        topic="/tf2_web_republisher/feedback",
        type="tf2_web_republisher/TFSubscriptionActionFeedback",
    )
    message = {"goal_id": {"stamp": {"secs": 0, "nsecs": 0}, "id": id}, "goal": {**goal, **fields}}
    client.say("publish", topic="/tf2_web_republisher/goal", msg=message)


async def test_goals_run_over_topics(lab: Lab, page: Asking) -> None:
    begin(page, "goal_1")
    await settle()
    lab.publish("map", "base", 1.0)
    await lab.pass_time(0.1)
    [feedback] = page.client.heard_of("/tf2_web_republisher/feedback")
    assert feedback["status"]["goal_id"]["id"] == "goal_1"
    assert feedback["status"]["status"] == 1
    assert places(feedback["feedback"]["transforms"]) == {"base": 1.0}
    page.client.say("publish", topic="/tf2_web_republisher/cancel", msg={"id": "goal_1"})
    results: list[Any] = []
    lab.robot.subscribe("/tf2_web_republisher/result", results.append)
    await settle()
    assert [result.status.status for result in results] == [2]
    lab.publish("map", "base", 9.0)
    await lab.pass_time(1.0)
    assert page.client.heard_of("/tf2_web_republisher/feedback") == []


async def test_a_bad_goal_over_topics_is_rejected_with_the_reason(lab: Lab, page: Asking) -> None:
    results: list[Any] = []
    lab.robot.subscribe("/tf2_web_republisher/result", results.append)
    begin(page, "goal_1", rate=-2)
    await settle()
    [result] = results
    assert (result.status.status, result.status.text) == (5, "rate must not be negative, got -2")


async def test_goals_over_topics_that_nobody_hears_end(lab: Lab, page: Asking) -> None:
    begin(page, "goal_1")
    await lab.pass_time(1.0)
    page.client.leave()
    await lab.pass_time(FEEDBACK_TIMEOUT + 1)
    assert not lab.ticking
