"""The demo robot driven from a terminal, as its users would: typed commands, colours, live rates."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.core.cli.conftest import ROOT

_LIMIT = 25.0


class Terminal:
    """A shell in a terminal of 120 columns, through tmux."""

    def __init__(self, folder: Path, url: str) -> None:
        self._socket = folder / "tmux"
        self._lines = 0
        command = folder / "rwt"
        command.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m rwt.cli "$@"\n')
        command.chmod(0o755)
        environment = {
            **{name: value for name, value in os.environ.items() if name not in ("NO_COLOR", "TMUX")},
            "RWT_URL": url,
            "PYTHONPATH": f"{ROOT / 'src'}{os.pathsep}{ROOT}",
            "PS1": "$ ",
            "PATH": f"{folder}{os.pathsep}{os.environ['PATH']}",
        }
        start = ["-f", "/dev/null", "new-session", "-d", "-x", "120", "-y", "1000", "-c", str(folder)]
        self._tmux(*start, "bash --noprofile --norc", environment=environment)

    def _tmux(self, *words: str, environment: dict[str, str] | None = None) -> str:
        command = ["tmux", "-S", str(self._socket), *words]
        done = subprocess.run(command, capture_output=True, text=True, timeout=_LIMIT, env=environment)
        assert done.returncode == 0, done.stderr
        return done.stdout

    def close(self) -> None:
        self._tmux("kill-server")

    def keys(self, *keys: str) -> None:
        """Press keys, by tmux's names."""
        self._tmux("send-keys", *keys)

    def screen(self, *, colours: bool = False) -> str:
        """Current content of the screen."""
        return self._tmux("capture-pane", "-p", "-J", *(["-e"] if colours else []))

    def run(self, line: str) -> str:
        """Type a command line and give what it printed, when it has ended with exit code 0."""
        # Numbered, because what the line before printed may still stand there.
        self._lines += 1
        mark = f"line {self._lines} ended with"
        self._tmux("send-keys", "-l", f"clear; {line}; echo {mark} $?")
        self.keys("Enter")
        found = self.wait_for(rf"^{mark} \d+$")
        assert found.endswith(f"{mark} 0"), found
        return found.rpartition(mark)[0]

    def wait_for(self, pattern: str) -> str:
        """The screen up to where a pattern is; waits for it."""
        deadline = time.monotonic() + _LIMIT
        while time.monotonic() < deadline:
            screen = self.screen()
            found = re.search(pattern, screen, re.MULTILINE)
            if found is not None:
                return screen[: found.end()]
            time.sleep(0.05)
        raise AssertionError(f"{pattern!r} was not shown:\n{self.screen().rstrip()}")


@pytest.fixture
def terminal(tmp_path: Path, demo: str) -> Iterator[Terminal]:
    if shutil.which("tmux") is None:
        pytest.skip("tmux is not installed")
    opened = Terminal(tmp_path, demo)
    yield opened
    opened.close()


def _x(terminal: Terminal) -> float:
    said = terminal.run("rwt topic echo --once /odom --field pose.pose.position.x")
    return float(re.findall(r"^-?[0-9][0-9.e-]*$", said, re.MULTILINE)[-1])


@pytest.mark.timeout(120)
def test_the_robot_is_driven_from_a_terminal(terminal: Terminal) -> None:
    terminal.run("rwt service call /reset std_srvs/srv/Empty")
    before = _x(terminal)
    terminal.run("rwt topic pub -t 8 -r 10 /cmd_vel geometry_msgs/msg/Twist '{linear: {x: 0.5}}'")
    assert _x(terminal) > before + 0.1

    terminal.run("rwt service call /reset std_srvs/srv/Empty")
    goal = "{pose: {header: {frame_id: map}, pose: {position: {x: -3.0, y: -2.5}, orientation: {w: 1.0}}}}"
    said = terminal.run(
        f"rwt action send_goal -f /navigate_to_pose nav2_msgs/action/NavigateToPose '{goal}' | tail -n 40"
    )
    assert "distance_remaining: " in said
    assert "Goal finished with status: SUCCEEDED" in said


@pytest.mark.timeout(120)
def test_live_rates_are_drawn_in_place_and_in_colour(terminal: Terminal) -> None:
    terminal._tmux("send-keys", "-l", "clear; rwt topic hz /odom /scan --interval 0.2")
    terminal.keys("Enter")
    terminal.wait_for(r"average rate: [\s\S]*average rate: ")
    terminal.wait_for(r"window: [3-9]\d")  # More than one report has been drawn, each over the one before.
    screen = terminal.screen(colours=True)
    assert screen.count("average rate: ") == 2
    assert "\x1b[36m/odom" in screen
    terminal.keys("C-c")
    said = terminal.run("NO_COLOR=1 rwt topic list -t")
    assert re.search(r"^/odom +nav_msgs/msg/Odometry$", said, re.MULTILINE)
    assert "\x1b[36m" not in terminal.screen(colours=True)
