"""Replay the journey: `python -m tools.ros2_owner OWNER`, in the robot's environment.

OWNER is the folder of another one, with the wheels of this project, `rclpy` and its rmw. It serves without a
setting, and sees and uses everything of the robot.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
import urllib.request
from contextlib import suppress
from pathlib import Path
from typing import Final

from tests.extensions.ros2.live.domains import free_domain
from tests.processes import free_port

#: Topics, and what a message of each contains.
TOPICS: Final = {
    "/tf": "child_frame_id: base_link",
    "/diagnostics": "message: full",
    "/markers": "ns: garden",
    "/own": "int32_value: 7",
}
_TIMEOUT: Final = "60"


def main() -> None:
    """Replay it; raises AssertionError for what is not as it should be."""
    owner = Path(sys.argv[1]).absolute()
    common = {"ROS_DOMAIN_ID": str(free_domain()), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    plain = {"PATH": os.environ["PATH"], "HOME": os.environ.get("HOME", "/"), **common}
    port = free_port()
    command = [sys.executable, "-m", "tools.ros2_owner.robot"]
    server = [f"{owner}/bin/rwt", "serve", "--graph", "ros2", f"ws://127.0.0.1:{port}"]
    with (
        subprocess.Popen(command, env={**os.environ, **common}, stdout=subprocess.PIPE, text=True) as running,
        subprocess.Popen(server, env=plain, cwd="/") as serving,
    ):
        try:
            assert running.stdout is not None
            assert running.stdout.readline() == "ready\n", "the robot has not started"
            _wait(serving, port)
            _see(owner, plain, f"ws://127.0.0.1:{port}")
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/") as page:
                assert page.status == 200, "the dashboard is not served"
        finally:
            serving.terminate()
            running.terminate()
    print("the owner sees and uses everything of the robot")


def _wait(serving: subprocess.Popen[bytes], port: int) -> None:
    """Wait until the server accepts connections."""
    while True:
        assert serving.poll() is None, "the server has ended"
        with suppress(OSError), socket.create_connection(("127.0.0.1", port)):
            return
        time.sleep(0.1)


def _see(owner: Path, environment: dict[str, str], url: str) -> None:
    """Read each topic, and send a goal, with the owner's commands."""

    def rwt(*arguments: str) -> str:
        command = [f"{owner}/bin/rwt", *arguments, "--url", url, "--timeout", _TIMEOUT]
        done = subprocess.run(command, env=environment, cwd="/", capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{' '.join(arguments)}: {done.stdout}{done.stderr}"
        return done.stdout

    for topic, expected in TOPICS.items():
        shown = rwt("topic", "echo", topic, "--once")
        assert expected in shown, f"{topic} shows {shown}"
        print(f"{topic}: {expected}")
    goal = rwt("action", "send_goal", "/navigate_to_pose", "nav2_msgs/action/NavigateToPose", "{}")
    assert "SUCCEEDED" in goal, goal
    print("/navigate_to_pose: SUCCEEDED")


if __name__ == "__main__":
    main()
