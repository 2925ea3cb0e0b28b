"""Updates of markers to viewers, and feedback of viewers to a program."""

from __future__ import annotations

import logging
import math
import threading
from typing import Any

import anyio.to_thread
import pytest

from rwt.extensions.markers import (
    Event,
    Feedback,
    InteractiveMarkerServer,
    NoSuchMarker,
    box,
    button,
    interactive_marker,
    move_plane,
)
from rwt.extensions.markers.server import PUBLISHES_STATE
from rwt_graph import Node
from rwt_interfaces.errors import InvalidMessage
from rwt_participant.messages import Message
from tests.extensions.markers.conftest import Lab, pose

pytestmark = pytest.mark.anyio

GOAL = interactive_marker("goal", at=(1.0, 2.0, 0.0), controls=[move_plane("z")])


def x_of(marker: Message) -> float:
    return float(marker.pose.position.x)


async def test_changes_show_when_they_are_applied_and_all_at_once(lab: Lab) -> None:
    updates, tunneled = lab.watch(), lab.watch("tunneled/update")
    lab.server.insert(GOAL)
    lab.server.insert(interactive_marker("other"))
    assert (updates, (await lab.init()).markers) == ([], [])
    lab.server.apply_changes()
    [update] = updates
    assert (update.type, update.seq_num) == (1, 1)
    assert [marker.name for marker in update.markers] == ["goal", "other"]
    assert (update.poses, update.erases) == ([], [])
    assert tunneled == updates
    lab.server.apply_changes()
    assert len(updates) == 1, "nothing has changed"


async def test_a_marker_that_moved_is_sent_as_a_pose_alone(lab: Lab) -> None:
    updates = lab.show(GOAL)
    lab.server.set_pose("goal", pose(5.0))
    lab.server.apply_changes()
    [update] = updates
    assert update.markers == []
    [moved] = update.poses
    assert (moved.name, moved.header.frame_id, moved.pose.position.x) == ("goal", "map", 5.0)
    assert update.seq_num == 2


async def test_a_marker_can_be_moved_to_another_frame(lab: Lab) -> None:
    lab.server.insert(GOAL)
    lab.server.set_pose("goal", pose(5.0), "odom")
    assert lab.server.marker("goal").header.frame_id == "odom"


async def test_an_erased_marker_is_named(lab: Lab) -> None:
    updates = lab.show(GOAL, interactive_marker("other"))
    lab.server.erase("goal")
    assert lab.server.names == ("other",)
    lab.server.apply_changes()
    assert updates[-1].erases == ["goal"]
    assert [marker.name for marker in (await lab.init()).markers] == ["other"]


async def test_one_that_was_erased_before_anybody_saw_it_is_not_named(lab: Lab) -> None:
    updates = lab.watch()
    lab.server.insert(GOAL)
    lab.server.erase("goal")
    lab.server.apply_changes()
    assert updates == []


async def test_replacing_a_marker_sends_all_of_it(lab: Lab) -> None:
    updates = lab.show(GOAL)
    lab.server.insert(interactive_marker("goal", at=(9.0, 0.0, 0.0)))
    lab.server.apply_changes()
    assert [x_of(marker) for marker in updates[-1].markers] == [9.0]


async def test_who_begins_later_gets_everything_with_its_number(lab: Lab) -> None:
    lab.show(GOAL)
    lab.server.set_pose("goal", pose(5.0))
    lab.server.apply_changes()
    everything = await lab.init()
    assert everything.seq_num == 2
    assert [x_of(marker) for marker in everything.markers] == [5.0]
    if PUBLISHES_STATE[lab.graph.distro.name]:
        [full] = lab.watch("update_full")
        assert full == everything
    else:
        answer = await lab.viewer.call("/marks/get_interactive_markers")
        assert (answer.sequence_number, answer.markers) == (2, everything.markers)


async def test_a_marker_without_a_stamp_stays_with_its_frame(lab: Lab) -> None:
    """A stamp of now would nail it to where the frame was at that moment."""
    lab.server.insert({"name": "bare", "header": {"frame_id": "base_link"}, "controls": [{"markers": [{}]}]})
    marker = lab.server.marker("bare")
    stamps = [marker.header.stamp, marker.controls[0].markers[0].header.stamp]
    fields = lab.graph.distro.time_fields
    assert [[getattr(stamp, field) for field in fields] for stamp in stamps] == [[0, 0], [0, 0]]


async def test_ros_1_clients_hear_that_the_server_lives(lab: Lab) -> None:
    updates, tunneled = lab.watch(), lab.watch("tunneled/update")
    lab.clock.advance(1.2)
    signs = 2 if PUBLISHES_STATE[lab.graph.distro.name] else 0
    assert [update.type for update in updates] == [0] * signs
    assert tunneled == []


async def test_dragging_moves_the_marker_for_everybody(lab: Lab) -> None:
    events: list[Feedback] = []
    updates = lab.show(GOAL, on_feedback=events.append)
    lab.send(Event.MOUSE_DOWN, control_name="move_plane", mouse_point={"x": 0.5}, mouse_point_valid=True)
    lab.drag(3.0)
    lab.send(Event.MOUSE_UP)
    assert [event.event for event in events] == [Event.MOUSE_DOWN, Event.POSE_UPDATE, Event.MOUSE_UP]
    down, moved, up = events
    assert (down.marker, down.control, down.mouse_point.x if down.mouse_point else None) == (
        "goal",
        "move_plane",
        0.5,
    )
    assert (moved.frame, moved.pose.position.x, moved.mouse_point) == ("map", 3.0, None)
    assert [[x_of(pose) for pose in update.poses] for update in updates] == [[3.0]]
    assert x_of(lab.server.marker("goal")) == 3.0
    assert up.event is Event.MOUSE_UP


async def test_what_a_callback_changes_shows_when_it_returns(lab: Lab) -> None:
    def snap(feedback: Feedback) -> None:
        lab.server.set_pose("goal", pose(round(feedback.pose.position.x)))

    updates = lab.show(GOAL, on_feedback=snap)
    lab.drag(3.4)
    assert [x_of(pose) for pose in updates[-1].poses] == [3.0]
    assert len(updates) == 1


async def test_a_callback_may_be_a_coroutine_function(lab: Lab) -> None:
    go_on = anyio.Event()

    async def later(feedback: Feedback) -> None:
        await go_on.wait()
        lab.server.erase(feedback.marker)

    updates = lab.show(GOAL, on_feedback=later)
    lab.send(Event.BUTTON_CLICK)
    await lab.settle()
    assert updates == []
    go_on.set()
    await lab.settle()
    assert updates[-1].erases == ["goal"]


async def test_a_callback_that_fails_is_logged_and_the_marker_goes_on(
    lab: Lab, caplog: pytest.LogCaptureFixture
) -> None:
    async def fail_later(feedback: Feedback) -> None:
        raise RuntimeError("later")

    def fail(feedback: Feedback) -> None:
        raise RuntimeError("at once")

    lab.server.insert(GOAL, fail)
    lab.server.insert(interactive_marker("other"), fail_later)
    lab.drag(3.0)
    lab.send(Event.BUTTON_CLICK, "other")
    await lab.settle()
    assert x_of(lab.server.marker("goal")) == 3.0
    said = [record.getMessage() for record in caplog.records if record.levelno == logging.ERROR]
    assert said == [
        "a callback of interactive marker goal failed",
        "a callback of interactive marker other failed",
    ]


async def test_a_marker_that_somebody_drags_is_theirs_for_a_second(lab: Lab) -> None:
    lab.server.insert(GOAL)
    lab.drag(3.0, client_id="ann")
    lab.drag(7.0, client_id="bob")
    assert x_of(lab.server.marker("goal")) == 3.0
    lab.clock.advance(1.1)
    lab.drag(7.0, client_id="bob")
    assert x_of(lab.server.marker("goal")) == 7.0


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"pose": {"position": {"x": math.inf}, "orientation": {"w": 1.0}}}, "pose: expected finite numbers"),
        (
            {"pose": {"orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 0.0}}},
            "pose.orientation: expected a quaternion, got zeros",
        ),
        ({"event": 6}, "event_type: expected 0 to 5, got 6"),
        ({"header": {"frame_id": "moon"}, "pose": pose(4.0)}, "its pose is in 'moon', the marker in map"),
    ],
)
async def test_feedback_that_means_nothing_is_ignored_and_logged(
    lab: Lab, caplog: pytest.LogCaptureFixture, wrong: dict[str, Any], said: str
) -> None:
    events: list[Feedback] = []
    lab.server.insert(GOAL, events.append)
    lab.send(**{"event": 1, **wrong})
    assert events == []
    assert x_of(lab.server.marker("goal")) == 1.0
    [record] = caplog.records
    assert record.getMessage() == f"feedback for 'goal' was ignored: {said}"


async def test_feedback_for_a_marker_that_is_gone_changes_nothing(lab: Lab) -> None:
    updates = lab.watch()
    lab.drag(3.0, marker="ghost")
    assert (updates, lab.server.names) == ([], ())


async def test_asking_for_a_marker_that_is_not_there_names_those_that_are(lab: Lab) -> None:
    with pytest.raises(NoSuchMarker, match=r"there is no interactive marker 'gaol'; there is none"):
        lab.server.erase("gaol")
    lab.server.insert(GOAL)
    with pytest.raises(NoSuchMarker, match=r"'gaol'; there is goal$"):
        lab.server.set_pose("gaol", pose(1.0))
    with pytest.raises(NoSuchMarker):
        lab.server.marker("gaol")


async def test_a_marker_that_does_not_fit_its_type_is_refused_with_the_field(lab: Lab) -> None:
    with pytest.raises(InvalidMessage, match=r"scale: expected float32, got \"big\""):
        lab.server.insert({"name": "goal", "scale": "big"})
    with pytest.raises(ValueError, match="needs a name"):
        lab.server.insert({"scale": 1.0})
    assert lab.server.names == ()


async def test_leaving_takes_the_markers_from_the_viewers(lab: Lab) -> None:
    with InteractiveMarkerServer(Node(lab.graph, "second"), "/second") as server:
        server.insert(GOAL)
        server.apply_changes()
        updates: list[Message] = []
        lab.viewer.subscribe("/second/tunneled/update", updates.append)
    assert [update.erases for update in updates] == [["goal"]]
    assert not any(service.name.startswith("/second/tunneled") for service in lab.graph.services())


async def test_markers_may_be_changed_from_any_thread(lab: Lab) -> None:
    updates = lab.watch()

    def work() -> None:
        assert threading.current_thread() is not threading.main_thread()
        lab.server.insert(interactive_marker("thread", controls=[button(box((1.0, 1.0, 1.0)))]))
        lab.server.apply_changes()

    await anyio.to_thread.run_sync(work)
    await lab.settle()
    assert [marker.name for marker in updates[-1].markers] == ["thread"]


async def test_feedback_cannot_forge_a_line_of_the_log(lab: Lab, caplog: pytest.LogCaptureFixture) -> None:
    lab.send(6, "goal\nclient 1 joined" + 1000 * "!")
    [record] = caplog.records
    assert "\n" not in record.getMessage()
    assert len(record.getMessage()) < 200
