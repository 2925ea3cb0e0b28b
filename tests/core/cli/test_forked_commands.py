"""Commands that tests fork behave like those that start an interpreter."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.processes import ended, running, start

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="commands are forked on Linux only")


def test_arguments_environment_folder_and_output_are_those_of_a_real_process(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text("limits.calls = 7\n")
    environment = {**os.environ, "RWT_LIMITS__CONNECTIONS": "20"}
    for words in (("config", "show", "--config", "robot.toml"), ("config", "show", "--set", "nothing=1")):
        forked, real = (
            ended(*words, environment=environment, folder=tmp_path, real=it) for it in (False, True)
        )
        assert vars(forked) == vars(real)
    assert real.returncode == 2 and "nothing" in real.stderr


@pytest.mark.parametrize("real", [False, True])
def test_signals_and_exit_codes(real: bool) -> None:
    for number, code in ((signal.SIGINT, 0), (signal.SIGTERM, 0), (signal.SIGKILL, -9)):
        with running("serve", "ws://127.0.0.1:0", stderr=subprocess.DEVNULL, real=real) as (process, _):
            assert process.poll() is None
            process.send_signal(number)
            assert process.wait(20) == code


def test_a_command_is_a_child_of_the_test() -> None:
    with start("--version", stdout=subprocess.DEVNULL) as process:
        pid, status = os.waitpid(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    assert (pid, process.returncode) == (process.pid, 0)
