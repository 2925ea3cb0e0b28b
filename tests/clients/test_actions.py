"""Actions of ROS 2 both ways, and actionlib of ROS 1 over topics."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.clients.conftest import Program

pytestmark = pytest.mark.clients

FIBONACCI = [0, 1, 1, 2, 3, 5, 8, 13, 21, 34, 55]
COUNTING = [FIBONACCI[:3], FIBONACCI[:4], FIBONACCI[:5]]

jazzy = pytest.mark.parametrize("distro", ["jazzy"], indirect=True)
noetic = pytest.mark.parametrize("distro", ["noetic"], indirect=True)

#: What actionlib calls the states of a goal.
ACTIVE, PREEMPTED, SUCCEEDED, ABORTED = 1, 2, 3, 4


def was_canceled(text: str) -> bool:
    return text.startswith('GoalError: Action was canceled: {"sequence":[0,1')


# -- ROS 2


@jazzy
def test_a_goal_succeeds_with_feedback(roslib2: Program) -> None:
    observed = roslib2.observe("action_goal")
    assert observed == {"values": {"sequence": FIBONACCI[:5]}, "feedback": COUNTING}


@jazzy
def test_a_goal_succeeds_with_feedback_in_roslibpy(roslibpy: Program) -> None:
    observed = roslibpy.observe("action_goal")
    assert observed == {"result": {"sequence": FIBONACCI[:5]}, "status": 4, "feedback": COUNTING}


@jazzy
def test_a_goal_is_canceled(roslib2: Program) -> None:
    observed = roslib2.observe("action_cancel")
    assert was_canceled(observed["failed"])
    assert 1 <= len(observed["feedback"]) < 10


@jazzy
def test_a_goal_is_canceled_in_roslibpy(roslibpy: Program) -> None:
    observed = roslibpy.observe("action_cancel")
    assert observed["status"] == 5
    assert observed["result"]["sequence"][:3] == [0, 1, 1]


@jazzy
def test_all_goals_are_canceled_at_once(roslib2: Program) -> None:
    both, complaints = roslib2.answer("action_cancel_all")
    assert len(both) == 2
    assert all(was_canceled(reason) for reason in both)
    # The library calls the action's cancel service without an id, and wonders at the answer that has none.
    assert complaints == ["Received service response without ID"]


@jazzy
def test_goals_that_cannot_run_are_refused(roslib2: Program) -> None:
    observed = roslib2.observe("action_refused")
    for case, word in {
        "unknown": "/no_such_action",
        "bad_field": "bogus",
        "wrong_type": "many",
        "unknown_type": "no_such_msgs/Thing",
        "by_the_server": "47",
    }.items():
        reason = observed[case]["failed"]
        assert reason.startswith("GoalError: Action status unknown: ")
        assert word in reason
        assert observed[case]["feedback"] == []


@jazzy
def test_goals_that_cannot_run_are_refused_in_roslibpy(roslibpy: Program) -> None:
    observed = roslibpy.observe("action_refused")
    for case, word in {"unknown": "/no_such_action", "bad_field": "bogus", "by_the_server": "47"}.items():
        assert observed[case]["status"] == 0
        assert word in observed[case]["failed"]


@jazzy
def test_a_client_provides_an_action(roslib2: Program) -> None:
    observed = roslib2.observe("action_provided")
    assert observed["succeeded"] == {"values": {"sequence": [0, 1, 7]}, "feedback": [[0], [0, 1]]}
    assert observed["aborted"] == {
        "failed": 'GoalError: Action was aborted: {"sequence":[]}',
        "feedback": [[0]],
    }
    assert observed["canceled"] == {
        "failed": 'GoalError: Action was canceled: {"sequence":[0,5]}',
        "feedback": [[0]],
    }
    assert observed["seen"] == {"goals": [{"order": 7}, {"order": -1}, {"order": 100}], "cancels": 1}


@jazzy
def test_goals_of_one_action_run_side_by_side(roslib2: Program) -> None:
    observed = roslib2.observe("action_several_goals")
    canceled = {"failed": 'GoalError: Action was canceled: {"sequence":[0,5]}', "feedback": [[0]]}
    assert observed["ends"] == [
        canceled,
        {"values": {"sequence": [0, 1, 1]}, "feedback": [[0], [0, 1]]},
        canceled,
        {"values": {"sequence": [0, 1, 2]}, "feedback": [[0], [0, 1]]},
    ]
    assert observed["cancels"] == 2


@jazzy
@pytest.mark.parametrize(
    ("scenario", "name"), [("action_provider_disconnects", "dies"), ("action_unadvertised", "leaves")]
)
def test_a_provider_that_leaves_aborts_its_goals(roslib2: Program, scenario: str, name: str) -> None:
    observed = roslib2.observe(scenario)
    assert observed["during"]["failed"].startswith("GoalError: Action was aborted")
    assert observed["during"]["feedback"] == [[0]]
    afterwards = observed["afterwards"]["failed"]
    assert afterwards.startswith("GoalError: Action status unknown: ")
    assert f"/roslib2/{name}" in afterwards


@jazzy
def test_the_robot_drives_itself_to_a_goal(roslib2: Program) -> None:
    observed = roslib2.observe("navigate")
    assert observed["near"] == "succeeded"
    assert observed["feedback"] >= 1
    assert observed["moved"] == pytest.approx(0.4, abs=0.15)
    assert observed["far"].startswith("GoalError: Action was aborted")


# -- ROS 1


@noetic
def test_an_actionlib_goal_succeeds(client: Program) -> None:
    observed = client.observe("actionlib_goal")
    # The tutorial's server goes one number further than those of ROS 2.
    assert observed["result"] == FIBONACCI[:6]
    assert observed["status"] == SUCCEEDED
    assert observed["feedback"] == [*COUNTING, FIBONACCI[:6]]
    assert ACTIVE in observed["statuses"]


@noetic
@pytest.mark.parametrize("scenario", ["actionlib_cancel", "actionlib_cancel_all"])
def test_an_actionlib_goal_is_canceled(client: Program, scenario: str) -> None:
    observed = client.observe(scenario)
    assert observed["status"] == PREEMPTED
    assert observed["result"][:3] == FIBONACCI[:3]


@noetic
def test_a_client_provides_an_actionlib_server(client: Program) -> None:
    observed = client.observe("actionlib_server")
    succeeded = observed["succeeded"]
    assert (succeeded["result"], succeeded["status"]) == ([0, 1, 1], SUCCEEDED)
    assert succeeded["feedback"] == [[0]]
    preempted = observed["preempted"]
    # A preempted goal is published without a result, which is completed.
    assert (preempted["result"], preempted["status"]) == ([], PREEMPTED)
    # roslibpy has no call for it.
    if "aborted" in observed:
        assert (observed["aborted"]["result"], observed["aborted"]["status"]) == ([0, 1], ABORTED)
