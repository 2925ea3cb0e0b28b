"""The libraries' TF clients, as they are, against the republisher."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.clients.conftest import Observed, Program

pytestmark = pytest.mark.clients

ANYWHERE = {"x": 0.0, "y": 0.0, "z": 0.0}


def follows_the_robot(observed: Observed) -> None:
    """The laser is on top of the robot, which was where it started and then drove."""
    laser = observed["laser"]
    assert laser["translation"] == {"x": 0, "y": 0, "z": pytest.approx(0.17, abs=0.05)}
    assert laser["rotation"] == {"x": 0, "y": 0, "z": 0, "w": 1}
    assert observed["before"] == pytest.approx(ANYWHERE, abs=0.05)
    assert 0.1 <= observed["moved"] < 1.0


def test_the_action_over_topics(roslib: Program) -> None:
    follows_the_robot(roslib.observe("tf_over_topics"))


def test_several_goals_over_topics(roslib: Program) -> None:
    observed = roslib.observe("tf_twice")
    follows_the_robot(observed)
    assert observed["wheel"]["y"] > 0


def test_the_service(roslib1: Program) -> None:
    follows_the_robot(roslib1.observe("tf_service"))


def test_the_service_in_roslibpy(roslibpy: Program) -> None:
    follows_the_robot(roslibpy.observe("tf_service"))


@pytest.mark.parametrize("distro", ["jazzy"], indirect=True)
def test_the_action_of_ros_2(roslib2: Program) -> None:
    observed, complaints = roslib2.answer("tf_ros2")
    follows_the_robot(observed)
    # The client cancels its goals, and gives its library nobody to tell of it.
    assert set(complaints) == {"GoalError: Action was canceled: {}"}
