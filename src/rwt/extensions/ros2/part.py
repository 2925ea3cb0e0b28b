"""Declaration of the graph of a live ROS 2 robot."""

from __future__ import annotations

from pydantic import Field

from rwt.access.settings import SettingsError, Table
from rwt.declarations import GraphContext, GraphPart
from rwt.extensions.ros2.ament import add_installed, installed_release
from rwt_graph.api import Graph


class Ros2Settings(Table):
    """Connection to the installed ROS 2. Used with `graph = "ros2"`."""

    use_sim_time: bool = Field(False, description="take ROS time from the topic `/clock`")
    remap: tuple[str, ...] = Field(
        (),
        description="remapping rules, such as `/cmd_vel:=/input/cmd_vel`, `__ns:=/robot1` for all nodes of"
        " the server, or `rosapi:__node:=api`",
    )


def _make(context: GraphContext, settings: Ros2Settings) -> Graph:
    try:
        from rwt.extensions.ros2.backend import Ros2Graph  # Needs ROS 2, imported only if configured.
    except ImportError as error:
        raise SettingsError(
            f"`graph`: ROS 2 is not available ({error}): source its setup.bash, for example that in"
            " /opt/ros/jazzy, and use its Python"
        ) from error
    return Ros2Graph(
        context.registry, context.clock, use_sim_time=settings.use_sim_time, remap=settings.remap
    )


PART = GraphPart(
    summary="graph of the installed ROS 2",
    settings=Ros2Settings,
    make=_make,
    default_distro=lambda: installed_release().name,
    add_interfaces=add_installed,
)
