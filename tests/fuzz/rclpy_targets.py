"""Texts given to nodes of ROS 2: the command line after `--ros-args`, and content filters."""

from __future__ import annotations

from rwt_rclpy.endpoints.content_filter import ContentFilter, InvalidFilter
from rwt_rclpy.exceptions import RCLInvalidROSArgsError, UnknownROSArgsError
from rwt_rclpy.names.arguments import parse_arguments, remove_ros_args


class _Message:
    """A message of a few fields, for filters."""

    def __init__(self) -> None:
        self.x = 1.5
        self.name = "wheel"
        self.ok = True
        self.header = self


_MESSAGE = _Message()


def ros_arguments(data: bytes) -> None:
    """A command line, its arguments parted by zero bytes; the first byte says how it begins."""
    # Files are read elsewhere: which there are is not for inputs to say.
    arguments = [
        each for each in data[1:].decode("utf-8", "replace").split("\0") if "params-file" not in each
    ]
    try:
        found = parse_arguments(arguments, ros_first=bool(data[0] & 1))
    except RCLInvalidROSArgsError as error:
        assert 0 < len(str(error)) < 2_000 + 2 * len(data)
        return
    try:
        kept = remove_ros_args(arguments)
    except UnknownROSArgsError as error:
        assert error.unknown_args
        assert all(each in arguments for each in error.unknown_args)
        assert len(str(error)) < 2_000 + 4 * len(data)
    else:
        assert all(each in arguments for each in kept)
    for kind in ("topic", "service"):
        renamed = found.remap("/a/b", kind, "node", "/a")
        assert renamed is None or renamed.startswith("/")
    found.parameters_of("/a/node")
    found.node_name("node")
    found.namespace("node", "/a")


def content_filter(data: bytes) -> None:
    """An expression and its parameters, parted by zero bytes."""
    expression, *parameters = data.decode("utf-8", "replace").split("\0")
    try:
        known = ContentFilter(expression, parameters)
        assert known.matches(_MESSAGE) in (True, False)
    except InvalidFilter as error:
        assert 0 < len(str(error)) < 2_000 + 4 * len(data)
