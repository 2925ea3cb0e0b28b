"""Ten people teach ten simulated robots at the same time over one server, and what that takes.

Each demonstrator is a process of its own with a WebSocket and a camera stream over HTTP: it watches camera,
joint states and transforms, drives its robot by hand and records waypoints. In one more process are the
server and all robots.

python examples/demonstrations.py --demonstrators 10 --seconds 20
"""

from __future__ import annotations

import argparse
import multiprocessing
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from multiprocessing.connection import Connection
from typing import Any

from teaching.demonstrator import demonstrate
from teaching.plan import PATIENCE, Camera, name_of
from teaching.report import Teaching, table
from teaching.server import serve_robots


class PartFailed(RuntimeError):
    """A process did not do its part; the text says which."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the demonstrations and print the report; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--demonstrators", type=_count, default=10, metavar="N", help="how many (%(default)s)"
    )
    parser.add_argument("--seconds", type=_positive, default=20.0, help="how long they teach (%(default)g)")
    parser.add_argument("--camera-rate", type=_positive, default=30.0, help="pictures a second (%(default)g)")
    parser.add_argument(
        "--camera-size",
        type=_size,
        default="320x240",
        metavar="WIDTHxHEIGHT",
        help="of pictures (%(default)s)",
    )
    given = parser.parse_args(arguments)
    width, height = given.camera_size
    camera = Camera(width, height, given.camera_rate)
    try:
        print(run(given.demonstrators, given.seconds, camera))
    except PartFailed as failure:
        print(failure, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0


def run(demonstrators: int, seconds: float, camera: Camera) -> str:
    """Let so many teach for so long.

    Returns:
        The report.

    Raises:
        PartFailed: a process ended early or did not answer.
    """
    with ExitStack() as parts:
        server = parts.enter_context(_process(serve_robots, demonstrators, camera))
        url = _hear(server, "the server", PATIENCE)
        names = [name_of(number) for number in range(1, demonstrators + 1)]
        lines = [parts.enter_context(_process(demonstrate, url, name, seconds)) for name in names]
        for name, line in zip(names, lines, strict=True):
            _hear(line, f"the demonstrator of {name}", PATIENCE)
        print(f"{demonstrators} demonstrators teach for {seconds:g} s at {url}", flush=True)
        before = _computed(server)
        for line in lines:
            line.send("go")
        teachings: list[Teaching] = [
            _hear(line, f"the demonstrator of {name}", seconds + PATIENCE)
            for name, line in zip(names, lines, strict=True)
        ]
        return table(teachings, _computed(server) - before, camera)


@contextmanager
def _process(target: Callable[..., None], *arguments: object) -> Iterator[Connection[Any, Any]]:
    """A process that talks over a pipe, until it is left."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=target, args=(theirs, *arguments), daemon=True)
    process.start()
    theirs.close()
    try:
        yield ours
        ours.close()  # which ends it
        process.join(PATIENCE)
    finally:
        process.terminate()
        process.join()


def _hear(line: Connection[Any, Any], who: str, patience: float) -> Any:
    try:
        if line.poll(patience):
            return line.recv()
    except EOFError:
        raise PartFailed(f"{who} ended early; its own words are above") from None
    raise PartFailed(f"{who} said nothing within {patience:g} s")


def _computed(server: Connection[Any, Any]) -> float:
    server.send("computed?")
    seconds: float = _hear(server, "the server", PATIENCE)
    return seconds


def _count(text: str) -> int:
    if not text.isdigit() or not 1 <= int(text) <= 100:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number from 1 to 100")
    return int(text)


def _size(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d{2,4})x(\d{2,4})", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"{text!r} is not WIDTHxHEIGHT, as 320x240")
    return int(match[1]), int(match[2])


def _positive(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None
    if not 0 < number <= 3600:
        raise argparse.ArgumentTypeError(f"{text}: it must be above 0 and at most 3600")
    return number


if __name__ == "__main__":
    sys.exit(main())
