"""Declaration of the graph of a live ROS 2 robot."""

from __future__ import annotations

from types import ModuleType

from pydantic import Field

from rwt.access.settings import SettingsError, Table
from rwt.declarations import GraphContext, GraphPart
from rwt_graph.api import Graph
from rwt_interfaces.registry import Registry


class Ros2Settings(Table):
    """Connection to the installed ROS 2. Used with `graph = "ros2"`."""

    use_sim_time: bool = Field(False, description="take ROS time from the topic `/clock`")
    remap: tuple[str, ...] = Field(
        (),
        description="remapping rules, such as `/cmd_vel:=/input/cmd_vel`, `__ns:=/robot1` for all nodes of"
        " the server, or `rosapi:__node:=api`",
    )


def _ros2() -> ModuleType:
    try:
        import rwt.extensions.ros2  # Needs ROS 2, imported only if configured.
    except ImportError as error:
        raise SettingsError(
            f"`graph`: ROS 2 is not available ({error}): source its setup.bash, for example that in"
            " /opt/ros/jazzy, and use its Python"
        ) from error
    return rwt.extensions.ros2


def _make(context: GraphContext, settings: Ros2Settings) -> Graph:
    graph: Graph = _ros2().Ros2Graph(
        context.registry, context.clock, use_sim_time=settings.use_sim_time, remap=settings.remap
    )
    return graph


def _add_interfaces(registry: Registry) -> None:
    _ros2().add_installed(registry)


PART = GraphPart(
    summary="graph of the installed ROS 2", settings=Ros2Settings, make=_make, add_interfaces=_add_interfaces
)
