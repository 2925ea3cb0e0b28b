"""Start rosbridge_server and rosapi from a checkout of rosbridge_suite, unmodified, on this project's graph.

    python -m tools.upstream.rosbridge_server ../rosbridge_suite

Both run in one process, as nodes of one graph. It prints `listening on ws://127.0.0.1:PORT` and serves until
it is interrupted. SIGTERM ends it too, which the reference alone ignores, here as on ROS
(RobotWebTools/rosbridge_suite#1024 and #945): each spin raises ExternalShutdownException, before it looks
whether to stop.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import runpy
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import rwt_rclpy
from tools.upstream.suites import install_line, missing_packages

_SOURCES = ("rosbridge_library/src", "rosbridge_server/src", "rosapi/src")
_INTERFACES = ("rosbridge_msgs", "rosapi_msgs", "rosbridge_test_msgs")
_NEEDED = ("rosbridge_server/scripts/rosbridge_websocket.py", "rosapi/scripts/rosapi_node")
#: What its unmodified code imports that is no part of ROS: the names of the modules.
_MODULES = ("tornado", "bson", "PIL")

#: Seconds after which rosapi is taken for stuck; it waits for five for the services of a node's parameters.
_PATIENCE = 6.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Start both; returns when they have ended."""
    parser = argparse.ArgumentParser("python -m tools.upstream.rosbridge_server", description=__doc__)
    parser.add_argument("checkout", type=Path, help="your checkout of rosbridge_suite, branch ros2 or jazzy")
    parser.add_argument("--port", type=int, default=0, help="the port (default: a free one)")
    parser.add_argument("ros", nargs="*", metavar="ARGUMENT", help="more of it after --, as for ros2 run")
    options = parser.parse_args(arguments)
    checkout: Path = options.checkout.resolve()
    missing = [each for each in _NEEDED if not (checkout / each).is_file()]
    if missing:
        print(
            f"{checkout}: has no {', '.join(missing)}; it should be a checkout of rosbridge_suite",
            file=sys.stderr,
        )
        return 2
    packages = missing_packages(_MODULES)
    if packages:
        print(
            f"rosbridge_suite needs Python packages that are not installed: {install_line(packages)}",
            file=sys.stderr,
        )
        return 2
    # What a build of Jazzy has: setters do not check what they are given. And what its setup.bash sets.
    os.environ.setdefault("ROS_PYTHON_CHECK_FIELDS", "0")
    os.environ.setdefault("ROS_DISTRO", "jazzy")
    os.environ.setdefault("ROS_VERSION", "2")
    sys.path[:0] = [str(checkout / each) for each in _SOURCES]
    if rwt_rclpy.install([checkout / each for each in _INTERFACES]) == "ros":
        print("ROS is installed: use tools.upstream.ros2_workspace", file=sys.stderr)
        return 2
    websocket, rosapi = (runpy.run_path(str(checkout / each)) for each in _NEEDED)
    own = ["--ros-args", "-p", f"port:={options.port}", "-p", "address:=127.0.0.1"]
    # It takes its arguments of ROS from here, and looks in them for its own.
    sys.argv = ["rosbridge_websocket", *own, *options.ros]
    from tornado.ioloop import IOLoop

    loop = IOLoop.current()  # The one that the reference will run.

    def run_beside() -> None:
        from rclpy.executors import ExternalShutdownException

        with contextlib.suppress(ExternalShutdownException):
            _beside(rosapi["Rosapi"])
        loop.add_callback(loop.stop)

    threading.Thread(target=run_beside, daemon=True, name="rosapi").start()
    import rclpy
    from rclpy.exceptions import RCLError

    try:
        websocket["main"](sys.argv)
    except RCLError:
        if rclpy.ok():
            raise
        # It shuts a context down that SIGTERM has ended already.
    return 0


def _beside(rosapi_class: Any) -> None:
    """Wait for the server's node, tell its port, and keep rosapi running beside it."""
    import rclpy

    from rwt_rclpy.companions.ros2_queries import call_get_parameters

    started = threading.Event()
    while not rclpy.ok():
        started.wait(0.05)
    watcher = rclpy.create_node("_watcher")
    port = 0
    while not port:
        found = call_get_parameters(
            node=watcher, node_name="/rosbridge_websocket", parameter_names=["actual_port"]
        )
        port = found.values[0].integer_value if found.values else 0
    supervised = _Supervised(rosapi_class)
    supervised.start()
    print(f"listening on ws://127.0.0.1:{port}", flush=True)
    supervised.watch(watcher)


class _Supervised:
    """rosapi, which is started again when it has ended or answers nothing any more.

    An exception in a service's callback ends it, and a question about its own parameters makes it wait for
    itself without end. On a robot somebody would start it again.
    """

    def __init__(self, node_class: Any) -> None:
        self._class = node_class
        self._node: Any = None

    def start(self) -> None:
        """Start it, and forget the one before."""
        if self._node is not None:
            self._node.destroy_node()
            sys.modules["rosapi.params"]._node.destroy_node()
        self._node = self._class()
        threading.Thread(target=self._spin, args=(self._node,), daemon=True, name="rosapi").start()

    def _spin(self, node: Any) -> None:
        from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

        executor = SingleThreadedExecutor()
        executor.add_node(node)
        try:
            executor.spin()
        except ExternalShutdownException:
            return
        except Exception as error:
            print(f"rosapi has ended and is started again: {type(error).__name__}: {error}", flush=True)
            executor.shutdown()
            self.start()

    def watch(self, watcher: Any) -> None:
        """Ask it for the time now and then, while there is ROS."""
        import rclpy
        from rclpy.executors import SingleThreadedExecutor

        from rwt_rclpy.messages.loaded import classes

        get_time: Any = classes().service("rosapi_msgs/GetTime")
        executor = SingleThreadedExecutor()
        executor.add_node(watcher)
        client = watcher.create_client(get_time, "/rosapi/get_time")
        while rclpy.ok():
            future = client.call_async(get_time.Request())
            executor.spin_until_future_complete(future, timeout_sec=_PATIENCE)
            if not future.done() and rclpy.ok():
                print("rosapi answers nothing any more, and is started again", flush=True)
                self.start()
            executor.spin_once(timeout_sec=0.5)


if __name__ == "__main__":
    sys.exit(main())
