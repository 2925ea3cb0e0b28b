"""Time from a fault to the error in LeRobot's loop: `python -m bench.lerobot`.

A loop at 30 Hz reads and commands an arm without motors over rosbridge, through a gate, as LeRobot's
programs do. Each fault is timed from before it is caused until the loop raises. Prints a table in Markdown,
in milliseconds. LeRobot is used if it is installed, else its fake in the tests.
"""

from __future__ import annotations

import argparse
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

TESTS: Final = Path(__file__).parents[1] / "rwt-lerobot" / "tests"
PERIOD: Final = 1 / 30
LEASE_SECONDS: Final = 0.5
SERVER: Final = f"""
import sys
sys.path.insert(0, {str(TESTS)!r})
from conftest import FakeArm
from rwt import Server
from rwt_lerobot import LeRobotNode
rule = dict(
    topics=["/arm_controller/joint_trajectory"], emergency=True, stop=dict(),
    lease=dict(seconds={LEASE_SECONDS}), fields={{"points[].positions[]": dict(max=1.6)}},
)
with Server("ws://127.0.0.1:0", gate=dict(rules=dict(arm=rule))) as robot:
    arm = FakeArm()
    LeRobotNode(robot.node, arm, rate=100.0)

    def unplug(request):
        arm.error = ConnectionError("no status packet")
        return {{}}

    robot.advertise_service("/unplug", "std_srvs/Empty", unplug)
    print(robot.server.urls[0], flush=True)
    sys.stdin.read()
"""


@dataclass
class Loop:
    """LeRobot's loop, with the server that it drives and another client.

    Attributes:
        action: action of each turn.
    """

    server: subprocess.Popen[str]
    device: Any
    other: Any
    action: Mapping[str, float]

    def turn(self) -> None:
        """Read and command the arm once."""
        self.device.get_observation()
        self.device.send_action(self.action)

    def run(self, seconds: float) -> None:
        """Read and command the arm at 30 Hz.

        Raises:
            DeviceError: what the device raises.
        """
        end = time.monotonic() + seconds
        while (now := time.monotonic()) < end:
            self.turn()
            time.sleep(max(0.0, now + PERIOD - time.monotonic()))


def _press(loop: Loop) -> None:
    loop.other.call("/gate/stop", {"reason": "bench"}, "rwt_gate_msgs/Stop")


def _exceed(loop: Loop) -> None:
    loop.action = {**loop.action, "pan.pos": 92.0}  # 1.605 rad


def _lose_the_lease(loop: Loop) -> None:
    answer = loop.other.call(
        "/gate/take_lease", {"topic": "/arm_controller/joint_trajectory"}, "rwt_gate_msgs/Lease"
    )
    assert answer.success, answer.message


def _queue(loop: Loop) -> None:
    for _ in range(6):  # At once, as after a stall of the connection.
        loop.turn()


def _unplug(loop: Loop) -> None:
    loop.other.call("/unplug", {}, "std_srvs/Empty")


def _suspend(loop: Loop) -> None:
    os.kill(loop.server.pid, signal.SIGSTOP)


def _kill(loop: Loop) -> None:
    os.kill(loop.server.pid, signal.SIGKILL)


FAULTS: Final[Mapping[str, tuple[float, Callable[[Loop], None]]]] = {
    "emergency stop": (0.0, _press),
    "limit": (0.0, _exceed),
    "lease lost": (LEASE_SECONDS + 0.2, _lose_the_lease),
    "stale commands": (LEASE_SECONDS + 0.2, _queue),
    "bus unplugged": (0.0, _unplug),
    "server suspended": (0.0, _suspend),
    "server killed": (0.0, _kill),
}
"""Causes by name, each with seconds in which the loop pauses before."""


@contextmanager
def _loop() -> Iterator[Loop]:
    from lerobot.robots import RobotConfig, make_robot_from_config

    import lerobot_robot_rosbridge  # noqa: F401 - registers the type
    from rwt_client.blocking import connect

    program = [sys.executable, "-c", SERVER]
    with (
        tempfile.TemporaryDirectory() as folder,
        subprocess.Popen(program, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as server,
    ):
        assert server.stdout is not None
        url = server.stdout.readline().strip()
        config = RobotConfig.get_choice_class("rosbridge")(
            url=url, calibration_dir=Path(folder), joints=["pan", "lift", "gripper"]
        )
        device: Any = make_robot_from_config(config)
        device.connect()
        try:
            observed = device.get_observation()
            with connect(url) as other:
                yield Loop(server, device, other, {name: observed[name] for name in device.action_features})
        finally:
            device.disconnect()
            server.kill()


def measure(pause: float, cause: Callable[[Loop], None]) -> tuple[float, str]:
    """Return the milliseconds from a fault to the error, and its class."""
    with _loop() as loop:
        loop.run(1.0)
        time.sleep(pause)
        began = time.monotonic()
        try:
            cause(loop)
            loop.run(10.0)
        except ConnectionError as error:
            return (time.monotonic() - began) * 1000, type(error).__name__
    raise RuntimeError("the loop did not raise")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    rounds = parser.parse_args().rounds
    if find_spec("lerobot") is None:
        sys.path.append(str(TESTS / "fakes"))
    print("| fault | error | median | maximum |\n|---|---|---|---|")
    for name, fault in FAULTS.items():
        found = [measure(*fault) for _ in range(rounds)]
        times = [milliseconds for milliseconds, _ in found]
        kinds = " or ".join(sorted({kind for _, kind in found}))
        print(f"| {name} | `{kinds}` | {statistics.median(times):.0f} | {max(times):.0f} |", flush=True)


if __name__ == "__main__":
    main()
