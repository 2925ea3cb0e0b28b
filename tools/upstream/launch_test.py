"""Run one launch test of rosbridge_suite: the server in a process of its own, the test in this one.

    python -m tools.upstream.launch_test ../rosbridge_suite/rosbridge_server/test/websocket/smoke.test.py

Both are part of one graph over Zenoh on loopback. Of `launch_testing` there is what these tests need: the
action ReadyToTest, after which the tests of the file run beside the launch.
"""

from __future__ import annotations

import argparse
import os
import runpy
import socket
import sys
import threading
import unittest
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from anyio.from_thread import start_blocking_portal

import rwt_rclpy
from rwt.extensions.zenoh import ZenohGraph
from rwt_rclpy.launch import Action, LaunchContext, LaunchService
from rwt_rclpy.messages.loaded import classes
from rwt_rclpy.middleware.joining import VARIABLE
from rwt_rclpy.running import interface_folders, packages, use_root

#: Seconds in which the server has to be there.
_PATIENCE = 90.0
_INTERFACES = ("rosbridge_msgs", "rosapi_msgs", "rosbridge_test_msgs")


class ReadyToTest(Action):
    """Action after which the tests run."""

    is_reached: Callable[[], None]

    def execute(self, context: LaunchContext) -> None:
        """Let them run."""
        ReadyToTest.is_reached()


def _offer_launch_testing() -> None:
    whole, actions = ModuleType("launch_testing"), ModuleType("launch_testing.actions")
    vars(actions)["ReadyToTest"] = ReadyToTest
    vars(whole)["actions"] = actions
    sys.modules.update({"launch_testing": whole, "launch_testing.actions": actions})


class _Results(unittest.TextTestResult):
    """Keeps what each test came to, for a report in the form of JUnit."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.suite = ElementTree.Element("testsuite")

    def startTest(self, test: unittest.TestCase) -> None:
        super().startTest(test)
        kind, _, name = test.id().rpartition(".")
        ElementTree.SubElement(self.suite, "testcase", classname=kind, name=name)

    def _failed(self, error: Any) -> None:
        ElementTree.SubElement(self.suite[-1], "failure", message=f"{error[0].__name__}: {error[1]}")

    def addFailure(self, test: unittest.TestCase, err: Any) -> None:
        super().addFailure(test, err)
        self._failed(err)

    def addError(self, test: unittest.TestCase, err: Any) -> None:
        super().addError(test, err)
        self._failed(err)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def _wait_for_server() -> None:
    """Wait until the server's node is there: the tests give it five seconds, too few on a busy machine."""
    import rclpy

    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    node = rclpy.create_node("_waiting", context=context)
    get_parameters: Any = classes().service("rcl_interfaces/GetParameters")
    client = node.create_client(get_parameters, "/rosbridge_websocket/get_parameters")
    if not client.wait_for_service(_PATIENCE):
        raise SystemExit(f"the server did not start within {_PATIENCE:g} s")
    node.destroy_node()
    rclpy.shutdown(context=context)


def _run(file: Path) -> _Results | None:
    """Run the launch of a file, and beside it its tests; None when the launch never got so far."""
    content = runpy.run_path(str(file), run_name=file.name.partition(".")[0])
    tests = unittest.TestSuite(
        unittest.defaultTestLoader.loadTestsFromTestCase(each)
        for each in content.values()
        if isinstance(each, type) and issubclass(each, unittest.TestCase)
    )
    service = LaunchService(noninteractive=True)
    service.include_launch_description(content["generate_test_description"]())
    found: list[_Results] = []

    def test() -> None:
        try:
            _wait_for_server()
            runner = unittest.TextTestRunner(resultclass=_Results, verbosity=2)
            results = runner.run(tests)
            assert isinstance(results, _Results)  # The runner makes what it is told to.
            found.append(results)
        finally:
            service.shutdown()

    ReadyToTest.is_reached = threading.Thread(target=test, name="tests", daemon=True).start
    service.run(shutdown_when_idle=False)
    return found[0] if found else None


def main(arguments: Sequence[str] | None = None) -> int:
    """Run it; the exit code is 1 when a test fails, or none was run."""
    parser = argparse.ArgumentParser("python -m tools.upstream.launch_test", description=__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("--report", type=Path, metavar="FILE", help="where the results go, as JUnit")
    options = parser.parse_args(arguments)
    file: Path = options.file.resolve()
    checkout = file.parents[3]
    if rwt_rclpy.install(interface_folders([str(checkout / each) for each in _INTERFACES])) == "ros":
        print("ROS is installed: use launch_test", file=sys.stderr)
        return 2
    _offer_launch_testing()
    use_root(checkout)
    sys.path[:0] = [str(each.python_folder) for each in packages(checkout)]
    endpoint = f"tcp/127.0.0.1:{_free_port()}"
    os.environ.update(
        {VARIABLE: f"zenoh:{endpoint}", "ROS_PYTHON_CHECK_FIELDS": "0", "PYTHONUNBUFFERED": "1"}
    )
    graph = ZenohGraph(classes().registry, listen=[endpoint])
    with start_blocking_portal() as portal, portal.wrap_async_context_manager(graph):
        rwt_rclpy.use_graph(graph)
        results = _run(file)
    if results is None:
        return 1
    if options.report is not None:
        ElementTree.ElementTree(results.suite).write(options.report)
    return 0 if results.wasSuccessful() else 1


if __name__ == "__main__":
    sys.exit(main())
