"""Options of every command that runs programs of ROS 2, also of `python -m rwt_rclpy`."""

from __future__ import annotations

import argparse


def add_program_options(parser: argparse.ArgumentParser) -> None:
    """Add the options for interfaces, and for the graph that nodes join."""
    parser.add_argument(
        "--interfaces",
        action="append",
        default=[],
        metavar="DIR",
        help="folder with .msg, .srv and .action files; may be given several times",
    )
    parser.add_argument(
        "--graph",
        metavar="WHERE",
        help="the graph that the nodes join: memory (one of their own), ws://HOST:PORT or unix:///PATH of a"
        " server, zenoh, or zenoh:ENDPOINT; default: RWT_RCLPY_GRAPH, or memory",
    )
