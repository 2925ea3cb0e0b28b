"""Completion: what is offered, and the scripts in the shells they are for."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from websockets.sync.server import ServerConnection

from tests.core.cli.conftest import candidates, response, served


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("topi", ["topic"]),
        ("top", ["top", "topic"]),
        ("topic ec", ["echo"]),
        ("topic echo /od", ["/odom"]),
        ("topic hz /odom /sc", ["/scan"]),
        ("topic echo --field x", []),
        ("topic echo --once /od", ["/odom"]),
        ("topic echo --times 3 /od", ["/odom"]),
        ("topic echo --qos-history ", ["keep_all", "keep_last"]),
        ("topic pub /cmd_vel geometry_msgs/msg/TwistS", ["geometry_msgs/msg/TwistStamped"]),
        ("topic list --sh", ["--show-types"]),
        ("service call /add", ["/add_two_ints"]),
        ("action send_goal /fib", ["/fibonacci"]),
        ("param get /demo", ["/demo_robot"]),
        ("node info /rosa", ["/rosapi"]),
        ("completion ", ["bash", "fish", "zsh"]),
        ("interface show std_srvs/srv/T", ["std_srvs/srv/Trigger"]),
        ("bag ", ["info", "play", "record", "recover"]),
        ("topic list more", []),
        ("topic echo --nonsense", []),
    ],
)
def test_candidates(demo: str, words: str, expected: list[str]) -> None:
    assert candidates(demo, f"rwt {words}") == expected


HOSTILE = (
    "/$(touch pwned)", "/`touch pwned`", "/;touch pwned", "/a b", "/\x1b]0;pwned\x07", "/a\v/b", "/a\nb",
)  # fmt: skip


def _answer(wire: ServerConnection) -> None:
    for text in wire:
        asked = json.loads(text)
        if asked["op"] == "call_service":
            types = ["std_msgs/msg/String"] * (len(HOSTILE) + 1)
            wire.send(json.dumps(response(asked, {"topics": ["/fine", *HOSTILE], "types": types})))


def test_names_that_a_shell_would_run_are_not_offered() -> None:
    with served(_answer) as url:
        assert candidates(url, "rwt topic echo /") == ["/fine"]


def test_the_robot_that_is_typed_is_asked(demo: str) -> None:
    nobody = "ws://127.0.0.1:1"
    assert candidates(nobody, "rwt topic echo /od") == []
    assert candidates(nobody, f"rwt topic echo --url {demo} /od") == ["/odom"]
    assert candidates(nobody, f"rwt topic echo --url={demo} /od") == ["/odom"]


def _in_shell(shell: str, script: str, folder: Path, demo: str) -> str:
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    command = folder / "rwt"
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m rwt.cli "$@"\n')
    command.chmod(0o755)
    environment = {**os.environ, "RWT_URL": demo, "PATH": f"{folder}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run([shell, "-c", script], capture_output=True, text=True, timeout=60, env=environment)
    assert done.stderr == ""
    return done.stdout


def test_bash(demo: str, tmp_path: Path) -> None:
    script = """
        source <(rwt completion bash)
        complete -p rwt
        try() {
            COMP_LINE="$1"; COMP_POINT=${#COMP_LINE}; COMPREPLY=()
            _python_argcomplete rwt
            echo "${COMPREPLY[@]}"
        }
        try "rwt topic ec"
        try "rwt topic echo /od"
        try "rwt topic echo --url $RWT_URL /sc"
        try "rwt topic echo --url=ws://127.0.0.1:1 /sc"
    """
    registered, *found = _in_shell("bash", script, tmp_path, demo).splitlines()
    assert registered.endswith("-F _python_argcomplete rwt")
    assert [each.strip() for each in found] == ["echo", "/odom", "/scan", ""]


def test_zsh(demo: str, tmp_path: Path) -> None:
    script = """
        compdef() { print "compdef $@" }
        is-at-least() { true }
        _describe() { print -l -- "${(P@)2}" }
        source <(rwt completion zsh)
        words=(rwt topic echo /od); BUFFER="rwt topic echo /od"; CURSOR=18; _python_argcomplete
    """
    registered, found = _in_shell("zsh", script, tmp_path, demo).splitlines()
    assert registered == "compdef _python_argcomplete rwt"
    assert found.partition(":")[0] == "/odom"


def test_fish(demo: str, tmp_path: Path) -> None:
    script = 'rwt completion fish | source; complete -C "rwt topic echo /od"'
    assert _in_shell("fish", script, tmp_path, demo).split() == ["/odom"]
