"""`rwt serve` as its users meet it: a process, a line on stdout, a signal."""

from __future__ import annotations

import json
import signal
import socket
from pathlib import Path

import pytest
from websockets.sync.client import connect

from tests.processes import ended, running


def test_the_demo_says_what_to_do_next() -> None:
    with running("serve", "ws://127.0.0.1:0", "--demo") as (process, url):
        process.send_signal(signal.SIGTERM)
        assert process.stdout is not None
        said = process.stdout.read()  # what `readline` has buffered is lost to `communicate`
        assert "roslib" in said
        assert url in said


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        ("http://127.0.0.1:9090", 1, "ws://"),
        ("127.0.0.1:9090", 1, "ws://"),
        ("ws://", 1, "ws://"),
        ("ws://127.0.0.1:99999", 1, "ws://"),
        ("wss://127.0.0.1:0", 1, "needs a certificate and a key"),
        ("tcps://127.0.0.1:0", 1, "tls.certfile"),
        ("stdio://robot", 1, "no address"),
        ("stdio", 1, "stdio:"),
        ("unix://robot.sock", 1, "absolute path"),
        ("unix:///no/such/folder/robot.sock", 1, "No such file"),
        ("udp://", 1, "names no host"),
        ("udp://127.0.0.1:0/path", 1, "only a host and a port"),
        ("udp://192.0.2.1:9092", 1, "not an address of this machine"),
        ("udp://no.such.host.invalid:9092", 1, "is not known"),
        ("--config none.toml", 2, "none.toml"),
        (
            "--packages tls",
            2,
            "`packages`: tls: no packages; expected PACKAGE/meshes/… in it, or a package.xml",
        ),
        ("--set auth.rosauth_secret_file=secret", 2, "exactly 16"),
        ("--set tls.certfile=a.pem --set tls.keyfile=b.pem", 2, "tls.certfile: a.pem: cannot be read"),
        (
            "--tls auto ws://127.0.0.1:0",
            2,
            "ws://127.0.0.1:0 is not encrypted: expected a URL such as wss://",
        ),
        ("--tls auto wss://127.0.0.1:0 --set tls.folder=tls", 2, "authority.pem: damaged"),
        ("--tls auto --set tls.certfile=a.pem", 2, "tls"),
        ("--tls auto --set tls.names=a_b", 2, "tls"),
        ("--interfaces .", 2, "Mood.msg:2"),
    ],
)
def test_what_cannot_be_served_is_one_line(words: str, code: int, said: str, tmp_path: Path) -> None:
    for name, text in {
        "secret": "too short",
        "tls/authority.pem": "nothing",
        "my_msgs/msg/Mood.msg": "string name\nuint8[ level\n",
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(0o600)
    (tmp_path / "tls").chmod(0o700)
    done = ended("serve", *words.split(), folder=tmp_path)
    assert (done.returncode, done.stdout, said in done.stderr) == (code, "", True), done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("file", "text", "said"),
    [
        ("robot.toml", "distor = 'jazzy'", "robot.toml:1: unknown setting `distor`; did you mean `distro`?"),
        ("robot.toml", "distro = 'kinetic'", "robot.toml:1: `distro`"),
        ("robot.toml", "listen = 5", "robot.toml:1: `listen`"),
        ("robot.toml", "listen = [", "robot.toml: not TOML"),
        ("script.toml", "[topcs]", "script: script.toml: unknown key `topcs`; did you mean `topics`?"),
        ("script.py", "x = 1\n1 / 0", "script: script.py:2: ZeroDivisionError: division by zero"),
    ],
)
def test_a_mistake_in_a_file_is_one_line(tmp_path: Path, file: str, text: str, said: str) -> None:
    (tmp_path / file).write_text(text)
    words = ("--config", file) if file == "robot.toml" else ("ws://127.0.0.1:0", "--script", file)
    done = ended("serve", *words, folder=tmp_path)
    assert (done.returncode, said in done.stderr, done.stderr.count("\n")) == (2, True, 1), done.stderr


@pytest.mark.parametrize(("scheme", "kind"), [("ws", socket.SOCK_STREAM), ("udp", socket.SOCK_DGRAM)])
def test_a_port_in_use_is_one_line(scheme: str, kind: socket.SocketKind) -> None:
    with socket.socket(socket.AF_INET, kind) as taken:
        taken.bind(("127.0.0.1", 0))
        if kind is socket.SOCK_STREAM:
            taken.listen()
        port = taken.getsockname()[1]
        done = ended("serve", f"{scheme}://127.0.0.1:{port}")
    assert (done.returncode, done.stderr.count("\n")) == (1, 1)
    assert str(port) in done.stderr and "in use" in done.stderr


@pytest.mark.parametrize(
    ("text", "code", "expected"),
    [
        ("demo = true", 0, ""),
        ('distro = "foxy"', 2, "robot.toml:1"),
        ('[tls]\ncertfile = "gone.pem"\nkeyfile = "gone.pem"', 2, "gone.pem"),
        (
            'demo = true\n[gate.rules.drive]\ntopics = ["/cmd_vel"]\nfields."x.y".max = 1',
            2,
            "no field x",
        ),
    ],
)
def test_settings_are_checked_without_serving(tmp_path: Path, text: str, code: int, expected: str) -> None:
    config = tmp_path / "robot.toml"
    config.write_text(text)
    with socket.create_server(("127.0.0.1", 0)) as taken:
        url = f"ws://127.0.0.1:{taken.getsockname()[1]}"
        done = ended("serve", url, "--check", "--config", str(config))
    assert (done.returncode, expected in done.stderr) == (code, True), done.stderr
    assert done.stdout.startswith("the settings are valid") == (code == 0)


def test_the_config_is_used_and_the_command_line_wins(tmp_path: Path) -> None:
    config = tmp_path / "rwt.toml"
    config.write_text('listen = ["ws://127.0.0.1:1"]\ndistro = "noetic"\ndemo = true\n')
    with running("serve", "--config", str(config), "ws://127.0.0.1:0") as (_, url), connect(url) as wire:
        wire.send(
            json.dumps({"op": "call_service", "service": "/rosapi/topic_type", "args": {"topic": "/odom"}})
        )
        assert json.loads(wire.recv(timeout=60))["values"] == {"type": "nav_msgs/Odometry"}
