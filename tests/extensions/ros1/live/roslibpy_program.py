"""A client of `roslibpy`, which runs statements that see it and the open connection `ros`."""

from __future__ import annotations

import sys

import roslibpy

from tests.statements import run_statements


def main() -> None:
    """Connect to the URL of the command line, and run statements from standard input until it ends."""
    ros = roslibpy.Ros(sys.argv[1])
    ros.run(30)
    run_statements({"roslibpy": roslibpy, "ros": ros})
    ros.terminate()


if __name__ == "__main__":
    main()
