"""Ends of commands: Ctrl-C, a reader that has gone, a connection that is lost; and how fast they begin."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

from tests.core.cli.conftest import demo_server, process
from tests.processes import ended


@pytest.mark.parametrize(
    "words",
    [
        ("topic", "echo", "/odom"),
        ("topic", "pub", "/cmd_vel", "{}"),
        ("topic", "hz", "/odom", "--interval", "0.1"),
    ],
    ids=lambda words: words[1],
)
def test_ctrl_c_is_a_silent_good_end_of_what_goes_on_for_ever(demo: str, words: tuple[str, ...]) -> None:
    with process(*words, url=demo, real=words[1] == "echo") as running:
        assert running.stdout is not None
        assert running.stdout.readline()
        running.send_signal(signal.SIGINT)
        _, errors = running.communicate(timeout=60)
    assert (running.returncode, errors) == (0, "")


def test_ctrl_c_cancels_a_goal_and_is_130(demo: str) -> None:
    with process("action", "send_goal", "/fibonacci", "{order: 40}", "-f", url=demo) as running:
        assert running.stdout is not None
        while not running.stdout.readline().startswith("Feedback"):
            pass
        running.send_signal(signal.SIGINT)
        _, errors = running.communicate(timeout=60)
    assert (running.returncode, errors) == (130, "")


def test_a_reader_that_has_gone_is_a_silent_end(demo: str) -> None:
    with process("topic", "echo", "/odom", url=demo) as running:
        assert running.stdout is not None and running.stderr is not None
        assert running.stdout.readline()
        running.stdout.close()
        assert running.wait(timeout=60) == 141
        assert running.stderr.read() == ""


def test_a_reader_that_was_never_there(demo: str) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    done = ended("topic", "list", "--url", demo, stdout=writing, real=True)
    os.close(writing)
    assert (done.returncode, done.stderr) == (141, "")


def test_a_full_disk_is_one_line(demo: str) -> None:
    with open("/dev/full", "wb") as full:
        done = ended("topic", "list", "--url", demo, stdout=full)
    said = "rwt: the output cannot be written: No space left on device\n"
    assert (done.returncode, done.stderr) == (1, said)


def test_a_lost_connection_ends_what_waits_for_an_answer() -> None:
    with demo_server() as url:
        running = process("action", "send_goal", "/fibonacci", "{order: 40}", "-f", url=url)
        assert running.stdout is not None
        while not running.stdout.readline().startswith("Feedback"):
            pass
    _, errors = running.communicate(timeout=60)
    assert running.returncode == 3
    assert "was lost" in errors
    assert len(errors.splitlines()) == 1


@pytest.mark.parametrize(
    ("commands", "loaded", "unloaded"),
    [
        (["--help"], "rwt.cli", "pydantic msgspec anyio asyncio numpy PIL rwt_client rwt.rosbridge"),
        (
            ["topic list", "topic echo /scan --once", "service list"],
            "rwt_client",
            "numpy PIL rwt.rosbridge rwt_graph trio rwt.cli.commands.doctor",
        ),
    ],
    ids=["help", "verbs"],
)
def test_a_command_loads_only_what_it_needs(
    demo: str, commands: list[str], loaded: str, unloaded: str
) -> None:
    code = "import sys; from contextlib import suppress; from rwt.cli import main\n"
    code += f"for line in {commands!r}:\n with suppress(SystemExit): main(line.split())\n"
    done = subprocess.run(
        [sys.executable, "-c", f"{code}print('\\n', *sys.modules)"],
        capture_output=True,
        text=True,
        timeout=30,
        env={**os.environ, "RWT_URL": demo},
    )
    assert done.returncode == 0, done.stderr
    modules = set(done.stdout.splitlines()[-1].split())
    assert loaded in modules
    assert not modules & set(unloaded.split())


def test_output_survives_a_terminal_without_unicode(demo: str) -> None:
    environment = {**os.environ, "PYTHONIOENCODING": "ascii", "RWT_URL": demo}
    words = ("topic", "pub", "--once", "-w", "0", "/a", "std_msgs/String", "data: é")
    done = ended(*words, environment=environment, real=True)
    assert (done.returncode, done.stderr) == (0, "")


def test_what_goes_on_for_ever_waits_for_a_lost_robot() -> None:
    with demo_server() as url:
        running = process("topic", "echo", "/odom", "--csv", url=url)
        assert running.stdout is not None and running.stderr is not None
        assert running.stdout.readline()
    assert "reconnecting" in running.stderr.readline()
    with demo_server(url=url):
        assert "reconnected" in running.stderr.readline()
        running.send_signal(signal.SIGINT)
        running.communicate(timeout=60)
    assert running.returncode == 0
