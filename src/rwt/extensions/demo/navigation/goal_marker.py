"""Interactive marker that sets the goal of the robot."""

from __future__ import annotations

from rwt.extensions.demo import messages
from rwt.extensions.demo.messages import MAP, frame
from rwt.extensions.demo.world.map import Pose
from rwt.extensions.markers import (
    Colour,
    Event,
    Feedback,
    InteractiveMarkerServer,
    Menu,
    arrow,
    cylinder,
    interactive_marker,
    move_plane,
    rotate_axis,
)
from rwt_graph import Node
from rwt_participant.errors import CallFailed
from rwt_participant.goals import Goal, GoalStatus
from rwt_participant.messages import Message
from rwt_tf2 import quaternion_from_yaw

NAMESPACE = "goal_marker"
_NAME = "goal"
#: Not quite opaque: ros3djs does not shade such colours.
_ORANGE = Colour(1.0, 0.55, 0.0, 0.9)
#: Diameter and height in metres: wider than the robot, and above the floor, which would hide it.
_SIZE = 0.8
_HEIGHT = 0.02


class GoalMarker:
    """Marker that sends the robot to where it is dropped.

    The disc moves it, the ring turns it; its menu repeats the goal, stops the robot, and resets the marker.
    """

    def __init__(self, node: Node, start: Pose) -> None:
        self._node = node
        self._grabbed_at: Message | None = None
        self._goal: Goal | None = None
        self._markers = InteractiveMarkerServer(node, NAMESPACE)
        menu = Menu()
        menu.add("Drive here", self._drive)
        menu.add("Stop", self._stop)
        menu.add("Fetch the marker", lambda _: self._markers.set_pose(_NAME, _pose(start)))
        self._markers.insert(_marker(frame(node, MAP), start), self._on_feedback, menu=menu)
        self._markers.apply_changes()

    async def _on_feedback(self, feedback: Feedback) -> None:
        if feedback.event is Event.MOUSE_DOWN:
            self._grabbed_at = self._pose()
        elif feedback.event is Event.MOUSE_UP and self._grabbed_at != self._pose():
            # A click without dragging only opens the menu.
            await self._drive(feedback)

    def _pose(self) -> Message:
        return self._markers.marker(_NAME).pose

    async def _drive(self, feedback: Feedback) -> None:
        goal = {"pose": {"header": {"frame_id": frame(self._node, MAP)}, "pose": self._pose()}}
        try:
            sent = self._goal = await self._node.send_goal("navigate_to_pose", goal)
            status, _ = await sent.result()
        except CallFailed as error:
            self._tell(str(error))
        else:
            if status is GoalStatus.ABORTED:
                self._tell(sent.reason)

    def _tell(self, reason: str) -> None:
        text = f"{self._node.resolve(NAMESPACE)}: {reason}"
        self._node.log.info(text)

    async def _stop(self, feedback: Feedback) -> None:
        if self._goal is not None:
            self._goal.cancel()


def _marker(frame_id: str, start: Pose) -> messages.Message:
    disc = cylinder(0.56, 0.02, _ORANGE)
    heading = arrow((0.0, 0.0, 0.05), (0.6, 0.0, 0.05), 0.06, _ORANGE)
    controls = [
        move_plane("z", disc, heading, name="move"),
        rotate_axis("z", name="turn", scale=_SIZE),
    ]
    marker = interactive_marker(_NAME, frame=frame_id, scale=_SIZE, controls=controls)
    return {**marker, "pose": _pose(start)}


def _pose(place: Pose) -> messages.Message:
    return {
        "position": messages.vector(place.x, place.y, _HEIGHT),
        "orientation": quaternion_from_yaw(place.heading),
    }
