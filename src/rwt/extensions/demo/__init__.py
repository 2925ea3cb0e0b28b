"""A simulated robot, written on the public graph API as a user would write one."""

from rwt.extensions.demo.robot import DemoRobot

__all__ = ["DemoRobot"]
