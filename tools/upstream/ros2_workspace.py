"""Start rosbridge_server and rosapi of a workspace, as processes on an installed ROS 2.

    python -m tools.upstream.ros2_workspace ~/suite_ws/install -- -p call_services_in_new_thread:=true

The workspace is built for this Python (`lib/rosbridge_server`, `lib/rosapi`). It prints `listening on
ws://127.0.0.1:PORT` and serves until SIGINT or SIGTERM. rosapi is started again when it has ended or does not
answer: an exception in a callback ends it, and a question about its own parameters makes it wait for itself.
"""

from __future__ import annotations

import argparse
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from types import FrameType
from typing import Final

ROSBRIDGE: Final = "lib/rosbridge_server/rosbridge_websocket"
_ROSAPI: Final = "lib/rosapi/rosapi_node"

#: Seconds after which rosapi is taken for stuck; it waits for five for the services of a node's parameters.
_PATIENCE: Final = 8.0
#: Seconds between two questions. Each answer reaches every client of the service, rosbridge_server's too.
_PAUSE: Final = 0.5
_START_SECONDS: Final = 60.0
_END_SECONDS: Final = 3.0


def environment(workspace: Path) -> dict[str, str]:
    """Return the environment of a program of a workspace."""
    packages = workspace / f"lib/python{sys.version_info.major}.{sys.version_info.minor}/site-packages"
    added = {
        "AMENT_PREFIX_PATH": workspace,
        "LD_LIBRARY_PATH": workspace / "lib",
        "PYTHONPATH": packages,
    }
    paths = {
        name: os.pathsep.join(filter(None, (str(path), os.environ.get(name)))) for name, path in added.items()
    }
    return {**os.environ, **paths}


def main(arguments: Sequence[str] | None = None) -> int:
    """Start both; returns when a signal has come, or rosbridge_server has ended."""
    parser = argparse.ArgumentParser("python -m tools.upstream.ros2_workspace", description=__doc__)
    parser.add_argument("workspace", type=Path, help="install folder of a workspace with rosbridge_suite")
    parser.add_argument("--port", type=int, default=0, help="the port (default: a free one)")
    parser.add_argument("ros", nargs="*", metavar="ARGUMENT", help="more of rosbridge_websocket after --")
    options = parser.parse_args(arguments)
    workspace: Path = options.workspace.resolve()
    if missing := [each for each in (ROSBRIDGE, _ROSAPI) if not (workspace / each).is_file()]:
        print(f"{workspace} has no {', '.join(missing)}: build rosbridge_suite into it", file=sys.stderr)
        return 2
    variables = environment(workspace)
    if os.environ.get("AMENT_PREFIX_PATH", "").partition(os.pathsep)[0] != str(workspace):
        # The loader reads the path of libraries only when a process starts.
        command = [sys.executable, "-m", "tools.upstream.ros2_workspace", *(arguments or sys.argv[1:])]
        os.execve(sys.executable, command, variables)
    port = options.port or _free_port()
    parameters = ("--ros-args", "-p", f"port:={port}", "-p", "address:=127.0.0.1", *options.ros)
    websocket = subprocess.Popen([sys.executable, str(workspace / ROSBRIDGE), *parameters])
    try:
        with closing(_Rosapi([sys.executable, str(workspace / _ROSAPI)])) as rosapi:
            for number in (signal.SIGINT, signal.SIGTERM):
                signal.signal(number, rosapi.stop)
            rosapi.watch(websocket, f"listening on ws://127.0.0.1:{port}")
    finally:
        _end(websocket)
    return 0


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as found:
        return int(found.getsockname()[1])


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a process that may ignore SIGTERM, as rosbridge_server does."""
    process.send_signal(signal.SIGINT)
    try:
        process.wait(_END_SECONDS)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


class _Rosapi:
    """The program of rosapi, which is started again when it has ended or does not answer."""

    def __init__(self, command: list[str]) -> None:
        import rclpy
        from rosapi_msgs.srv import GetTime  # type: ignore[import-not-found]  # A workspace has it.

        self._command = command
        self._process = subprocess.Popen(command)
        self._stopped = False
        rclpy.init(signal_handler_options=rclpy.SignalHandlerOptions.NO)
        self._node = rclpy.create_node("_watcher")
        self._request = GetTime.Request
        self._client = self._node.create_client(GetTime, "/rosapi/get_time")

    def stop(self, number: int, frame: FrameType | None) -> None:
        """End the watch, as a handler of signals."""
        self._stopped = True

    def watch(self, websocket: subprocess.Popen[bytes], text: str) -> None:
        """Print `text` at the first answer; return when `websocket` has ended, or after `stop`."""
        import rclpy

        if not self._client.wait_for_service(_START_SECONDS):
            raise TimeoutError("rosapi does not start")
        print(text, flush=True)
        while not self._stopped and websocket.poll() is None:
            future = self._client.call_async(self._request())
            rclpy.spin_until_future_complete(self._node, future, timeout_sec=_PATIENCE)
            if self._process.poll() is not None or not (future.done() or self._stopped):
                print("rosapi has ended or does not answer, and is started again", flush=True)
                self._process.kill()
                self._process.wait()
                self._process = subprocess.Popen(self._command)
                self._client.wait_for_service(_START_SECONDS)
            self._client.remove_pending_request(future)
            time.sleep(_PAUSE)

    def close(self) -> None:
        """End the program."""
        import rclpy

        _end(self._process)
        rclpy.shutdown()


if __name__ == "__main__":
    sys.exit(main())
