"""The example programs run against the demo robot."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

EXAMPLES = Path(__file__).parents[3] / "examples"


def run(name: str, url: str) -> list[str]:
    command = [sys.executable, str(EXAMPLES / name), url]
    done = subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.splitlines()


def test_a_script(url: str) -> None:
    lines = run("client_script.py", url)
    assert lines[-1] == "the robot says: beep"
    assert lines[-2] == "picture: (64, 48) (255, 165, 0)"
    assert lines[-3].endswith(" m of 360 rays")
    assert any(line.split() == ["/odom", "nav_msgs/msg/Odometry"] for line in lines)


def test_a_drive(url: str) -> None:
    lines = run("client_drive.py", url)
    words = lines[0].split()
    assert (words[0], words[2:]) == ("gone", ["m,", "0", "messages", "dropped"])
    assert 0.3 <= float(words[1]) < 0.6
    assert lines[-3:] == ["so far 0 1 1 2 3", "succeeded 0 1 1 2 3", "closed"]
