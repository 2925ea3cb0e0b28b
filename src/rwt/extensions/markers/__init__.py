"""Markers that people drag, turn and click in a viewer, with feedback for the program.

::

    markers = InteractiveMarkerServer(node, "/goal_marker")
    markers.insert(interactive_marker("goal", controls=six_dof()), lambda feedback: print(feedback.pose))
    markers.apply_changes()

The topics are those of ROS's package `interactive_markers`, and those that its proxy adds for browsers, so
rviz and `InteractiveMarkerClient` of ros3djs show them.
"""

from rwt.extensions.markers.controls import (
    button,
    interactive_marker,
    menu_control,
    move_3d,
    move_axis,
    move_plane,
    rotate_axis,
    six_dof,
)
from rwt.extensions.markers.feedback import Event, Feedback, Menu, MenuEntry
from rwt.extensions.markers.server import InteractiveMarkerServer, NoSuchMarker
from rwt.extensions.markers.shapes import Colour, arrow, box, cylinder, mesh, sphere, text

__all__ = [
    "InteractiveMarkerServer",
    "NoSuchMarker",
    "Event",
    "Feedback",
    "Menu",
    "MenuEntry",
    "interactive_marker",
    "move_axis",
    "move_plane",
    "move_3d",
    "rotate_axis",
    "six_dof",
    "button",
    "menu_control",
    "Colour",
    "arrow",
    "box",
    "cylinder",
    "mesh",
    "sphere",
    "text",
]
