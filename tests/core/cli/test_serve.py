"""`rwt serve` as its users meet it: a process, a line on stdout, a signal."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import urllib.request
from pathlib import Path

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from tests.processes import ended, running, start


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_closes_every_client_with_1001_and_exits_0(how: signal.Signals) -> None:
    with (
        running("serve", "ws://127.0.0.1:0") as (process, url),
        connect(url) as first,
        connect(url) as second,
    ):
        process.send_signal(how)
        for wire in (first, second):
            with pytest.raises(ConnectionClosed) as closed:
                wire.recv(timeout=60)
            assert closed.value.rcvd is not None
            assert closed.value.rcvd.code == 1001
        _, errors = process.communicate(timeout=60)
        assert process.returncode == 0
        assert "Traceback" not in errors


def test_publish_and_call_over_a_real_socket() -> None:
    with running("serve", "ws://127.0.0.1:0", "--demo") as (_, url), connect(url) as wire:
        wire.send(json.dumps({"op": "call_service", "id": "1", "service": "/add_two_ints", "args": [20, 22]}))
        assert json.loads(wire.recv(timeout=60)) == {
            "op": "service_response",
            "service": "/add_two_ints",
            "values": {"sum": 42},
            "result": True,
            "id": "1",
        }
        wire.send(json.dumps({"op": "call_service", "id": "2", "service": "rosapi/topics"}))
        topics = json.loads(wire.recv(timeout=60))["values"]["topics"]
        assert {"/odom", "/scan", "/map", "/tf", "/rosout"} <= set(topics)


def test_meshes_of_packages_on_the_same_port(tmp_path: Path) -> None:
    mesh = tmp_path / "arm/meshes/hand.stl"
    mesh.parent.mkdir(parents=True)
    mesh.write_text("solid hand")
    with running("serve", "ws://127.0.0.1:0", "--packages", str(tmp_path)) as (_, url):
        base = url.replace("ws", "http", 1)
        with urllib.request.urlopen(f"{base}/packages/arm/meshes/hand.stl", timeout=60) as answer:
            assert (answer.headers["Content-Type"], answer.read()) == ("model/stl", b"solid hand")


def test_a_folder_without_packages_ends_it_with_a_sentence(tmp_path: Path) -> None:
    done = ended("serve", "--packages", str(tmp_path))
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.strip().endswith(
        f"`packages`: {tmp_path}: no packages; expected PACKAGE/meshes/… in it, or a package.xml"
    )


def test_plain_http_on_the_same_port() -> None:
    with running("serve", "ws://127.0.0.1:0", "--demo") as (_, url):
        base = url.replace("ws", "http", 1)
        with urllib.request.urlopen(f"{base}/healthz", timeout=60) as answer:
            assert json.load(answer)["status"] == "ok"
        with urllib.request.urlopen(f"{base}/index", timeout=60) as answer:
            page = answer.read().decode()
        assert url in page
        assert "/cmd_vel" in page


def test_the_demo_says_what_to_do_next() -> None:
    with running("serve", "ws://127.0.0.1:0", "--demo") as (process, url):
        process.send_signal(signal.SIGTERM)
        assert process.stdout is not None
        said = process.stdout.read()  # what `readline` has buffered is lost to `communicate`
        assert "roslib" in said
        assert url in said


def _fails(*arguments: str) -> tuple[int, str]:
    done = ended("serve", *arguments)
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr
    return done.returncode, done.stderr


def test_a_port_in_use_is_one_line() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        code, error = _fails(f"ws://127.0.0.1:{port}")
    assert code == 1
    assert str(port) in error
    assert "in use" in error


@pytest.mark.parametrize("url", ["http://127.0.0.1:9090", "127.0.0.1:9090", "ws://", "ws://127.0.0.1:99999"])
def test_a_bad_url_is_one_line(url: str) -> None:
    code, error = _fails(url)
    assert code == 1
    assert "ws://" in error


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("distor = 'jazzy'", "did you mean `distro`?"),
        ("distro = 'kinetic'", "`distro`"),
        ("listen = 5", "`listen`"),
        ("listen = [", "not TOML"),
        ("default_call_service_timeout = -1", "default_call_service_timeout"),
    ],
)
def test_a_bad_config_is_one_line(tmp_path: Path, text: str, expected: str) -> None:
    config = tmp_path / "rwt.toml"
    config.write_text(text)
    code, error = _fails("--config", str(config))
    assert code == 2
    assert expected in error
    assert str(config) in error


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
    taken = socket.create_server(("127.0.0.1", 0))
    with (
        taken,
        start(
            "serve",
            f"ws://127.0.0.1:{taken.getsockname()[1]}",
            "--check",
            "--config",
            str(config),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        ) as process,
    ):
        said, errors = process.communicate(timeout=60)
    assert (process.returncode, expected in errors) == (code, True), errors
    assert said.startswith("the settings are valid") == (code == 0)


def test_a_missing_config_is_one_line(tmp_path: Path) -> None:
    code, error = _fails("--config", str(tmp_path / "none.toml"))
    assert code == 2
    assert "none.toml" in error


def test_the_config_is_used_and_the_command_line_wins(tmp_path: Path) -> None:
    config = tmp_path / "rwt.toml"
    config.write_text('listen = ["ws://127.0.0.1:1"]\ndistro = "noetic"\ndemo = true\n')
    with running("serve", "--config", str(config), "ws://127.0.0.1:0") as (_, url), connect(url) as wire:
        wire.send(
            json.dumps({"op": "call_service", "service": "/rosapi/topic_type", "args": {"topic": "/odom"}})
        )
        assert json.loads(wire.recv(timeout=60))["values"] == {"type": "nav_msgs/Odometry"}


def test_interfaces_of_ones_own(tmp_path: Path) -> None:
    folder = tmp_path / "my_msgs" / "msg"
    folder.mkdir(parents=True)
    (folder / "Mood.msg").write_text("string name\nuint8 level 3\n")
    with (
        running("serve", "ws://127.0.0.1:0", "--interfaces", str(tmp_path)) as (_, url),
        connect(url) as wire,
    ):
        wire.send(json.dumps({"op": "subscribe", "topic": "/mood", "type": "my_msgs/Mood"}))
        wire.send(json.dumps({"op": "publish", "topic": "/mood", "msg": {"name": "glad"}}))
        assert json.loads(wire.recv(timeout=60))["msg"] == {"name": "glad", "level": 3}


def test_bad_interfaces_are_one_line(tmp_path: Path) -> None:
    folder = tmp_path / "my_msgs" / "msg"
    folder.mkdir(parents=True)
    (folder / "Mood.msg").write_text("string name\nuint8[ level\n")
    code, error = _fails("ws://127.0.0.1:0", "--interfaces", str(tmp_path))
    assert code == 2
    assert "Mood.msg:2" in error


def test_settings_that_cannot_be_used_are_one_line(tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("too short")
    code, error = _fails("ws://127.0.0.1:0", "--set", f"auth.rosauth_secret_file={secret}")
    assert (code, "exactly 16" in error) == (2, True)
    code, error = _fails("ws://127.0.0.1:0", "--set", "tls.certfile=a.pem", "--set", "tls.keyfile=b.pem")
    assert (code, "tls.certfile: a.pem: cannot be read" in error) == (2, True)
    code, error = _fails("wss://127.0.0.1:0")
    assert (code, "tls.certfile" in error) == (1, True)


def test_the_environment_sets_what_a_server_does() -> None:
    viewer = {"RWT_AUTH__DEFAULT_ROLE": "viewer"}
    server = running("serve", "ws://127.0.0.1:0", "--demo", environment=viewer)
    with server as (_, url), connect(url) as wire:
        wire.send(json.dumps({"op": "call_service", "id": "1", "service": "/add_two_ints", "args": [1, 2]}))
        answer = json.loads(wire.recv(timeout=60))
    assert (answer["result"], "roles.viewer.call" in answer["values"]) == (False, True)


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("robot.toml", "[topcs]", "script: {}: unknown key `topcs`; did you mean `topics`?"),
        ("robot.py", "x = 1\n1 / 0", "script: {}:2: ZeroDivisionError: division by zero"),
    ],
)
def test_a_mistake_in_a_script_is_one_line(tmp_path: Path, name: str, text: str, said: str) -> None:
    script = tmp_path / name
    script.write_text(text)
    code, error = _fails("--script", str(script), "ws://127.0.0.1:0")
    assert (code, said.format(script) in error) == (2, True)


def test_help_has_an_example() -> None:
    done = ended("serve", "--help")
    assert "rwt serve --demo" in done.stdout
