"""Run one launch test of rosbridge_suite with `rwt ros2 serve` in place of its server, on an installed ROS 2.

    python -m tools.upstream.ros2_launch_test ../rosbridge_suite/rosbridge_server/test/websocket/smoke.test.py

The test runs in this process, on the real `rclpy`. Its launch description names the node of rosbridge_server:
the modules `launch`, `launch_ros` and `launch_testing`, which need not be installed, are replaced.
"""

from __future__ import annotations

import argparse
import runpy
import subprocess
import sys
import unittest
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from unittest.mock import MagicMock

_SERVE = ("-m", "rwt.cli", "ros2", "serve", "--ros-args", "-p", "port:=0", "-p", "address:=127.0.0.1")


def _replace_launch() -> None:
    for name in ("launch", "launch.actions", "launch_ros", "launch_ros.actions", "launch_testing.actions"):
        parts = name.split(".")
        for count in range(1, len(parts) + 1):
            whole = ".".join(parts[:count])
            module = sys.modules.setdefault(whole, ModuleType(whole))
            vars(module).setdefault("__getattr__", lambda _name: MagicMock())
            if count > 1:
                setattr(sys.modules[parts[0]], parts[1], module)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run it; the exit code is 1 when a test fails, or none was run."""
    parser = argparse.ArgumentParser("python -m tools.upstream.ros2_launch_test", description=__doc__)
    parser.add_argument("file", type=Path)
    file: Path = parser.parse_args(arguments).file.resolve()
    _replace_launch()
    content = runpy.run_path(str(file), run_name=file.name.partition(".")[0])
    tests = unittest.TestSuite(
        unittest.defaultTestLoader.loadTestsFromTestCase(each)
        for each in content.values()
        if isinstance(each, type) and issubclass(each, unittest.TestCase)
    )
    with subprocess.Popen([sys.executable, *_SERVE], stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        try:
            if not any(line.startswith("listening on ") for line in iter(server.stdout.readline, "")):
                print("the server has ended", file=sys.stderr)
                return 1
            results = unittest.TextTestRunner(verbosity=2).run(tests)
        finally:
            server.terminate()
    return 0 if results.wasSuccessful() and results.testsRun else 1


if __name__ == "__main__":
    sys.exit(main())
