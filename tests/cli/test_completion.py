"""Completion: what is offered, and the scripts in the shells they are for."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt_cli.commands.completion import candidates, words_of
from tests.cli.conftest import Rwt

_Case = tuple[tuple[str, ...], list[str]]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("top",), ["topic"]),
        (("topic", "ec"), ["echo"]),
        (("topic", "echo", "/od"), ["/odom"]),
        (("topic", "hz", "/odom", "/sc"), ["/scan"]),
        (("topic", "echo", "--field", "x"), []),
        (("topic", "echo", "--once", "/od"), ["/odom"]),
        (("topic", "echo", "--times", "3", "/od"), ["/odom"]),
        (("topic", "echo", "--qos-history", ""), ["keep_all", "keep_last"]),
        (("topic", "pub", "/cmd_vel", "geometry_msgs/msg/TwistS"), ["geometry_msgs/msg/TwistStamped"]),
        (("topic", "list", "--sh"), ["--show-types"]),
        (("service", "call", "/add"), ["/add_two_ints"]),
        (("action", "send_goal", "/fib"), ["/fibonacci"]),
        (("param", "get", "/demo"), ["/demo_robot"]),
        (("node", "info", "/rosa"), ["/rosapi"]),
        (("completion", ""), ["bash", "fish", "zsh"]),
        (("interface", "show", "std_srvs/srv/T"), ["std_srvs/srv/Trigger"]),
        (("topic", "list", "more"), []),
        (("nonsense", ""), []),
    ],
)
def test_candidates(
    demo: str, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], expected: list[str]
) -> None:
    monkeypatch.setenv("RWT_URL", demo)
    assert candidates(words) == expected


def test_the_robot_that_is_typed_is_asked(demo: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RWT_URL", "ws://127.0.0.1:1")
    assert candidates(["topic", "echo", "/od"]) == []
    assert candidates(["topic", "echo", "--url", demo, "/od"]) == ["/odom"]
    assert candidates(["topic", "echo", f"--url={demo}", "/od"]) == ["/odom"]


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("rwt topic ", ["rwt", "topic", ""]),
        ("rwt --url ws://a:1 to", ["rwt", "--url", "ws://a:1", "to"]),
        ("rwt 'a b' \"c d\" e\\ f", ["rwt", "a b", "c d", "e f"]),
        ("rwt 'open quo", ["rwt", "open quo"]),
        ("rwt \\", ["rwt", ""]),
        ("", [""]),
    ],
)
def test_words_as_a_shell_splits_them(line: str, expected: list[str]) -> None:
    assert words_of(line) == expected


@given(st.text(max_size=40))
def test_any_line_has_a_word_that_is_typed(line: str) -> None:
    assert words_of(line)


def _in_shell(shell: str, script: str, folder: Path, demo: str) -> str:
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    command = folder / "rwt"
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m rwt_cli "$@"\n')
    command.chmod(0o755)
    environment = {**os.environ, "RWT_URL": demo, "PATH": f"{folder}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run([shell, "-c", script], capture_output=True, text=True, timeout=30, env=environment)
    assert done.stderr == ""
    return done.stdout


def test_bash(demo: str, tmp_path: Path) -> None:
    script = """
        source <(rwt completion bash)
        complete -p rwt
        try() {
            COMP_LINE="$1"; COMP_POINT=${#COMP_LINE}; COMPREPLY=()
            _rwt_complete
            echo "${COMPREPLY[@]}"
        }
        try "rwt topic ec"
        try "rwt topic echo /od"
        try "rwt topic echo --url $RWT_URL /sc"
        try "rwt nonsense "
    """
    assert _in_shell("bash", script, tmp_path, demo).splitlines() == [
        "complete -o default -F _rwt_complete rwt",
        "echo",
        "/odom",
        "/scan",
        "",
    ]


def test_zsh(demo: str, tmp_path: Path) -> None:
    script = """
        compdef() { print "compdef $@" }
        compadd() { shift; print -l -- "$@" }
        source <(rwt completion zsh)
        words=(rwt topic echo /od); CURRENT=4; _rwt
    """
    assert _in_shell("zsh", script, tmp_path, demo).splitlines() == ["compdef _rwt rwt", "/odom"]


def test_fish(demo: str, tmp_path: Path) -> None:
    script = 'rwt completion fish | source; complete -C "rwt topic echo /od"'
    assert _in_shell("fish", script, tmp_path, demo).splitlines() == ["/odom"]


def test_the_scripts_are_printed(rwt: Rwt) -> None:
    for shell in ("bash", "zsh", "fish"):
        assert "rwt completion words" in rwt("completion", shell).out
    assert "words" not in rwt("completion", "--help").out.partition("examples")[0].replace("you type", "")
