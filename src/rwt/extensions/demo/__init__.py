"""A simulated robot, written on the public graph API as a user would write one."""

from typing import TYPE_CHECKING

from rwt_protocol.extensions import exports

if TYPE_CHECKING:
    from rwt.extensions.demo.robot import DemoRobot as DemoRobot

__all__, __getattr__, __dir__ = exports(
    __name__,
    {
        "rwt.extensions.demo.robot": ("DemoRobot"),
    },
)
