"""The files for a service and a container run the server as they say."""

from __future__ import annotations

import configparser
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from tests.processes import LONGEST, ROOT, ended, free_port, running, start

FILES = ROOT / "docs" / "how-to" / "deploy"
TOKEN = "a-token-of-thirty-two-characters"
TOKEN_FILE = "/etc/robot/tokens/operator"
ADVERTISE = json.dumps({"op": "advertise", "topic": "/cmd_vel", "type": "geometry_msgs/Twist"})


class Unit(configparser.RawConfigParser):
    """A unit file of systemd, each of whose keys stands once here."""

    def optionxform(self, optionstr: str) -> str:
        return optionstr


@pytest.fixture
def service() -> configparser.SectionProxy:
    unit = Unit()
    unit.read(FILES / "robot.service", encoding="utf-8")
    return unit["Service"]


@pytest.fixture
def settings(tmp_path: Path) -> tuple[Path, int]:
    """The settings of the page, on a port that is free."""
    port = free_port()
    text = (FILES / "rwt.toml").read_text(encoding="utf-8")
    assert "0.0.0.0:9090" in text
    file = tmp_path / "rwt.toml"
    assert TOKEN_FILE in text
    token_file = tmp_path / "operator"
    token_file.write_text(f"{TOKEN}\n")
    file.write_text(text.replace("0.0.0.0:9090", f"127.0.0.1:{port}").replace(TOKEN_FILE, str(token_file)))
    return file, port


class Manager:
    """Notifications that a service manager receives from the process that it has started."""

    def __init__(self, path: Path) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(str(path))
        self.socket.settimeout(LONGEST)

    def hears(self, state: str) -> str:
        """Wait for a state; the whole message that has it."""
        while True:
            message = self.socket.recv(4096).decode()
            if state in message.split("\n"):
                return message


def arguments(command: str, settings: Path) -> list[str]:
    """Return the arguments of `rwt` in a command of the files, with other settings."""
    program, *rest = command.split()
    assert program in ("/opt/robot/bin/rwt", "/opt/robot/current/bin/rwt")
    return [str(settings) if each == "/etc/robot/rwt.toml" else each for each in rest]


def test_the_unit_is_one(tmp_path: Path) -> None:
    program = shutil.which("systemd-analyze")
    if program is None:
        pytest.skip("systemd is not installed")
    text = (FILES / "robot.service").read_text(encoding="utf-8")
    unit = tmp_path / "robot.service"
    unit.write_text(text.replace("/opt/robot/current/bin/rwt", sys.executable))
    done = subprocess.run([program, "verify", str(unit)], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")


def test_what_a_restart_cannot_mend_ends_the_service(
    service: configparser.SectionProxy, settings: tuple[Path, int], tmp_path: Path
) -> None:
    recording = tmp_path / "run.mcap"
    recording.write_bytes(b"of yesterday")
    command = [*arguments(service["ExecStart"], settings[0]), "--record"]
    with start(*command, str(recording), stderr=subprocess.PIPE) as process:
        errors = process.communicate(timeout=LONGEST)[1]
    assert "run.mcap is there already" in errors
    assert service["RestartPreventExitStatus"] == str(process.returncode) == "2"


@pytest.mark.parametrize("workers", [1, 2])
def test_the_service_tells_when_it_is_ready_alive_reloading_and_stopping(
    service: configparser.SectionProxy, settings: tuple[Path, int], tmp_path: Path, workers: int
) -> None:
    file, port = settings
    manager = Manager(tmp_path / "notify")
    with manager.socket:
        environment = {"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "200000"}
        command = [*arguments(service["ExecStart"], file), "--workers", str(workers)]
        with running(*command, environment=environment) as (process, _):
            manager.hears("READY=1")
            manager.hears("WATCHDOG=1")
            manager.hears("WATCHDOG=1")
            with connect(f"ws://127.0.0.1:{port}?token={TOKEN}") as operator:
                operator.send(ADVERTISE)
                assert service["ExecReload"] == "/bin/kill -HUP $MAINPID"
                process.send_signal(signal.SIGHUP)
                assert re.search(r"^MONOTONIC_USEC=\d+$", manager.hears("RELOADING=1"), re.MULTILINE)
                manager.hears("READY=1")
            process.send_signal(signal.SIGTERM)
            manager.hears("STOPPING=1")
            assert process.wait(float(service["TimeoutStopSec"])) == 0


def test_who_shows_no_token_may_look(settings: tuple[Path, int]) -> None:
    file, port = settings
    with (
        running("serve", "--config", str(file)),
        connect(f"ws://127.0.0.1:{port}") as viewer,
    ):
        viewer.send(json.dumps({"op": "set_level", "level": "error"}))
        viewer.send(ADVERTISE)
        assert "roles.viewer" in json.loads(viewer.recv(LONGEST))["msg"]
        with pytest.raises(InvalidStatus):
            connect(f"ws://127.0.0.1:{port}?token=wrong")


def test_without_the_token_the_server_does_not_start(settings: tuple[Path, int]) -> None:
    (settings[0].parent / "operator").unlink()
    done = ended("serve", "--config", str(settings[0]))
    assert done.returncode == 2
    assert re.search(r"rwt\.toml:\d+: `auth\.tokens\.operator\.token_file`: .*cannot be read", done.stderr)
    assert "Traceback" not in done.stderr


def test_a_token_is_replaced_as_the_page_says(settings: tuple[Path, int]) -> None:
    file, port = settings
    new = "another-token-of-thirty-characters"
    variable = {"RWT_ORIGINS__ALLOW": "https://ui.example"}
    with running("serve", "--config", str(file), "--verbose", environment=variable) as (process, _):
        assert process.stderr is not None
        with connect(f"ws://127.0.0.1:{port}?token={TOKEN}") as operator:
            (file.parent / "operator").write_text(f"{new}\n")
            process.send_signal(signal.SIGHUP)
            with pytest.raises(ConnectionClosed) as closed:
                operator.recv(LONGEST)
            assert closed.value.rcvd is not None and closed.value.rcvd.code == 1008
        with connect(f"ws://127.0.0.1:{port}?token={new}"), pytest.raises(InvalidStatus):
            connect(f"ws://127.0.0.1:{port}?token={TOKEN}")
        process.terminate()
        log = process.communicate(timeout=LONGEST)[1]
    assert re.search(r"not read again, .*: RWT_ORIGINS__ALLOW$", log, re.MULTILINE)
    assert "were read again from their files" in log


def test_the_container_runs_the_same(settings: tuple[Path, int]) -> None:
    file, port = settings
    text = (FILES / "Containerfile").read_text(encoding="utf-8").replace("\\\n", " ")
    steps = [line.split(maxsplit=1) for line in text.splitlines() if line and not line.startswith("#")]
    said = dict(steps)
    assert said["STOPSIGNAL"] == "SIGTERM" and said["USER"] != "root" and said["EXPOSE"] == "9090"
    command = " ".join(json.loads(said["CMD"]))
    health = json.loads(said["HEALTHCHECK"].partition("CMD ")[2])
    with running(*arguments(command, file)):
        check = [sys.executable, "-c", health[2].replace("9090", str(port))]
        assert health[:2] == ["/opt/robot/bin/python", "-c"]
        assert subprocess.run(check, timeout=LONGEST, check=False).returncode == 0
    assert subprocess.run(check, timeout=LONGEST, check=False, capture_output=True).returncode != 0


def test_the_container_needs_no_writable_root(settings: tuple[Path, int]) -> None:
    assert "--read-only" in (FILES.parent / "deploy.md").read_text(encoding="utf-8")
    text = (FILES / "Containerfile").read_text(encoding="utf-8")
    command = json.loads(text.rpartition("\nCMD ")[2])
    # A namespace of its own in which no file system but those of the kernel can be written to.
    mounts = "awk '$5 !~ \"^/(proc|sys|dev)\" {print $5}' /proc/self/mountinfo | sort -u"
    script = f'for at in $({mounts}); do mount -o remount,bind,ro "$at" || exit 9; done'
    script += '; touch "$0" 2>/dev/null && exit 9; exec "$@"'
    probe = settings[0].parent / "probe"
    trial = ["unshare", "--mount", "sh", "-c", script, str(probe)]
    if shutil.which("unshare") is None or subprocess.run([*trial, "true"], check=False).returncode:
        pytest.skip("this system has no mount namespaces for tests")
    words = [*trial, sys.executable, "-m", "rwt.cli", *arguments(" ".join(command), settings[0])]
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "src")}
    with subprocess.Popen(words, env=environment, stdout=-1, stderr=-1, text=True) as process:
        assert process.stdout is not None and process.stderr is not None
        while not (line := process.stdout.readline()).startswith("listening on "):
            assert line, process.stderr.read()
        with connect(f"ws://127.0.0.1:{settings[1]}?token={TOKEN}") as operator:
            operator.send(ADVERTISE)
        process.terminate()
        assert "Read-only file system" not in process.stderr.read()
    assert process.returncode == 0 and not probe.exists()


def test_a_manager_that_is_gone_ends_nothing(tmp_path: Path) -> None:
    gone = {"NOTIFY_SOCKET": os.fspath(tmp_path / "nobody")}
    with running("serve", "ws://127.0.0.1:0", environment=gone) as (process, url):
        with connect(url):
            pass
        process.terminate()
        assert process.wait(LONGEST) == 0
        assert process.stderr is not None
        assert "cannot notify the service manager (NOTIFY_SOCKET) of READY=1" in process.stderr.read()
