"""Declaration of robot_state_publisher."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field

from rwt.access.settings import SettingsError, Table
from rwt.declarations import NodeContext, NodePart, ReadyNode


class StatePublisherSettings(Table):
    """Settings of robot_state_publisher, in the table `robot_state_publisher`."""

    urdf: Path | None = Field(None, description="file with the description of the robot; required")
    frame_prefix: str = Field("", max_length=128, description="start of the name of each frame")
    publish_frequency: Annotated[float, Field(gt=0, le=1000, allow_inf_nan=False)] = Field(
        100.0, description="maximum rate of each joint's transform, Hz"
    )


def _make(context: NodeContext, settings: StatePublisherSettings) -> ReadyNode:
    from rwt_graph import Node
    from rwt_tf2 import InvalidDescription
    from rwt_tf2.urdf import MAX_BYTES

    if settings.urdf is None:
        raise SettingsError("`robot_state_publisher.urdf`: required: the file with the robot's description")
    try:
        with settings.urdf.open("rb") as file:
            urdf = file.read(MAX_BYTES + 1).decode()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8"
        raise SettingsError(f"`robot_state_publisher.urdf`: {settings.urdf}: {reason}") from error
    node = Node(context.graph, "robot_state_publisher")
    try:
        node.describe(urdf, frame_prefix=settings.frame_prefix, publish_frequency=settings.publish_frequency)
    except InvalidDescription as error:
        node.close()
        raise SettingsError(f"`robot_state_publisher.urdf`: {settings.urdf}: {error}") from error
    return node


PART = NodePart(
    summary="description of a robot, and the transforms of its links from joint states",
    settings=StatePublisherSettings,
    make=_make,
    in_trials=True,
)
