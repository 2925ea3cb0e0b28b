"""Declaration of the demo robot."""

from __future__ import annotations

from pydantic import Field

from rwt.access.settings import Table
from rwt.declarations import NodeContext, NodePart, Option, ReadyNode


class DemoSettings(Table):
    """Settings of the demo robot, at the top level."""

    demo: bool = Field(False, description="add the demo robot")


def _make(context: NodeContext, settings: DemoSettings) -> ReadyNode:
    from rwt.extensions.demo import DemoRobot

    return DemoRobot(context.graph)


def _next_steps(url: str) -> str:
    page = url.replace("ws", "http", 1)
    return f"""
The demo robot is up. Point any rosbridge client at {url}, or open {page} in a browser.

  roslibjs   new ROSLIB.Ros({{ url: "{url}" }})
  roslibpy   roslibpy.Ros(host="{url.split("/")[2].rpartition(":")[0]}", port={url.rpartition(":")[2]}).run()

Publish geometry_msgs/Twist on /cmd_vel to drive, subscribe to /odom, /scan and /map, call /add_two_ints,
or send a goal to /navigate_to_pose. Ctrl-C ends it."""


PART = NodePart(
    summary="simulated mobile robot with an arm",
    settings=DemoSettings,
    at_top_level=True,
    is_on=lambda settings: settings.demo,
    make=_make,
    in_trials=True,
    next_steps=_next_steps,
    options=(
        Option(
            "--demo",
            "demo",
            {"action": "store_true", "default": None, "help": "add a simulated mobile robot"},
        ),
    ),
)
