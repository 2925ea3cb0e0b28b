"""Markers that people drag, turn and click in a viewer, with feedback for the program.

::

    markers = InteractiveMarkerServer(node, "/goal_marker")
    markers.insert(interactive_marker("goal", controls=six_dof()), lambda feedback: print(feedback.pose))
    markers.apply_changes()

The topics are those of ROS's package `interactive_markers`, and those that its proxy adds for browsers, so
rviz and `InteractiveMarkerClient` of ros3djs show them.
"""

from typing import TYPE_CHECKING

from rwt_protocol.extensions import exports

if TYPE_CHECKING:
    from rwt.extensions.markers.controls import button as button
    from rwt.extensions.markers.controls import interactive_marker as interactive_marker
    from rwt.extensions.markers.controls import menu_control as menu_control
    from rwt.extensions.markers.controls import move_3d as move_3d
    from rwt.extensions.markers.controls import move_axis as move_axis
    from rwt.extensions.markers.controls import move_plane as move_plane
    from rwt.extensions.markers.controls import rotate_axis as rotate_axis
    from rwt.extensions.markers.controls import six_dof as six_dof
    from rwt.extensions.markers.feedback import Event as Event
    from rwt.extensions.markers.feedback import Feedback as Feedback
    from rwt.extensions.markers.feedback import Menu as Menu
    from rwt.extensions.markers.feedback import MenuEntry as MenuEntry
    from rwt.extensions.markers.server import InteractiveMarkerServer as InteractiveMarkerServer
    from rwt.extensions.markers.server import NoSuchMarker as NoSuchMarker
    from rwt.extensions.markers.shapes import Colour as Colour
    from rwt.extensions.markers.shapes import arrow as arrow
    from rwt.extensions.markers.shapes import box as box
    from rwt.extensions.markers.shapes import cylinder as cylinder
    from rwt.extensions.markers.shapes import mesh as mesh
    from rwt.extensions.markers.shapes import sphere as sphere
    from rwt.extensions.markers.shapes import text as text

__all__, __getattr__, __dir__ = exports(
    __name__,
    {
        "rwt.extensions.markers.controls": (
            "button interactive_marker menu_control move_3d move_axis move_plane rotate_axis six_dof"
        ),
        "rwt.extensions.markers.feedback": ("Event Feedback Menu MenuEntry"),
        "rwt.extensions.markers.server": ("InteractiveMarkerServer NoSuchMarker"),
        "rwt.extensions.markers.shapes": ("Colour arrow box cylinder mesh sphere text"),
    },
)
