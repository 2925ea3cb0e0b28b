"""`rwt tf`: transforms between the robot's frames."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Final

import anyio

from rwt.cli.console.output import Output
from rwt.cli.errors import TIMED_OUT, CommandError
from rwt.cli.parser import Commands
from rwt.cli.verbs import Arguments, Verb, add_family, add_times, hertz, rounds, seconds
from rwt_interfaces.times import NANOSECONDS

if TYPE_CHECKING:
    from rwt_client import Robot
    from rwt_tf2 import Buffer, StampedTransform

_USUAL_RATE: Final = 1.0
_USUAL_WAIT: Final = 2.0
"""Seconds of listening before the tree is printed; covers frames that are published once a second."""


def add_tf_command(commands: Commands) -> None:
    """Add `tf` to the command line."""
    add_family(commands, "tf", "The robot's frames.", VERBS)


# -- echo --------------------------------------------------------------------------------------------------


def _echo_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("source", metavar="SOURCE", help="reference frame, for example map")
    parser.add_argument("target", metavar="TARGET", help="frame to locate, for example base_link")
    parser.add_argument(
        "--rate", type=hertz, default=_USUAL_RATE, metavar="HZ", help="transforms per second (default 1)"
    )
    add_times(parser, "stop after one", "stop after N")


async def _echo(robot: Robot, arguments: Arguments, output: Output) -> None:
    """Print the transform between two frames.

    example:
      rwt tf echo map base_link

    --json prints:
      a line for each transform: {"stamp": {"sec": …, "nanosec": …}, "source": "map",
      "target": "base_link", "translation": [x, y, z], "rotation": [x, y, z, w],
      "rpy": […], "matrix": […]}; metres, radians
    """
    for number in rounds(arguments.times):
        found = await robot.tf.lookup(arguments.source, arguments.target)
        if output.json:
            output.record(_record(found))
        else:
            output.lines(_lines(found, output))
        if number != arguments.times:
            await anyio.sleep(1 / arguments.rate)


def _record(found: StampedTransform) -> dict[str, object]:
    sec, nanosec = divmod(found.stamp_ns, NANOSECONDS)
    return {
        "stamp": {"sec": sec, "nanosec": nanosec},
        "source": found.parent,
        "target": found.child,
        "translation": list(found.transform.translation),
        "rotation": list(found.transform.rotation),
        "rpy": list(found.transform.rpy()),
        "matrix": [[float(number) for number in row] for row in found.transform.matrix()],
    }


def _lines(found: StampedTransform, output: Output) -> Iterable[str]:
    rpy = found.transform.rpy()
    yield output.styled(f"At time {found.stamp_ns / 1e9:.3f}", "heading")
    yield f"- Translation: {_numbers(found.transform.translation)}"
    yield f"- Rotation: in quaternion {_numbers(found.transform.rotation)}"
    yield f"            in RPY (radian) {_numbers(rpy)}"
    yield f"            in RPY (degree) {_numbers(map(math.degrees, rpy))}"


def _numbers(numbers: Iterable[float]) -> str:
    # Adding 0 turns negative zero into zero.
    return "[" + ", ".join(f"{round(number, 3) + 0.0:.3f}" for number in numbers) + "]"


# -- tree --------------------------------------------------------------------------------------------------


def _tree_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--wait",
        type=seconds,
        default=_USUAL_WAIT,
        metavar="SECONDS",
        help=f"seconds to listen first (default {_USUAL_WAIT:g})",
    )
    shape = parser.add_mutually_exclusive_group()
    shape.add_argument("--yaml", action="store_true", help="print YAML, as tf2's service /tf2_frames does")
    shape.add_argument("--dot", action="store_true", help="print a graph for Graphviz")


async def _tree(robot: Robot, arguments: Arguments, output: Output) -> None:
    """Print the tree of frames.

    example:
      rwt tf tree
      rwt tf tree --dot | dot -Tpdf > frames.pdf

    --json prints:
      [{"frame": "base_link", "parent": "odom", "static": false, "rate": 20.0}, …]; the parent of a
      root is null
    """
    await robot.tf.start()
    await anyio.sleep(arguments.wait)
    frames = robot.tf.buffer
    if not frames.frames():
        raise CommandError(f"no transform on /tf or /tf_static within {arguments.wait:g} s", TIMED_OUT)
    if output.json:
        output.record([_frame(frames, frame) for frame in frames.frames()])
    elif arguments.yaml:
        output.text(frames.all_frames_as_yaml())
    elif arguments.dot:
        output.text(frames.all_frames_as_dot())
    else:
        output.lines(map(output.escape_terminal, frames.tree().splitlines()))


def _frame(frames: Buffer, frame: str) -> dict[str, object]:
    return {
        "frame": frame,
        "parent": frames.parent(frame),
        "static": frames.is_static(frame),
        "rate": round(frames.rate(frame), 3),
    }


VERBS = (
    Verb("echo", _echo, _echo_arguments, until_interrupted=True),
    Verb("tree", _tree, _tree_arguments),
)
