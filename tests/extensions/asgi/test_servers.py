"""The robot within the servers and apps of others, each in a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import httpx
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

from tests.processes import free_port

ROOT = Path(__file__).parents[3]

SERVERS = {
    "uvicorn": ["-m", "uvicorn", "--loop", "uvloop", "--http", "httptools", "--port", "{port}"],
    "hypercorn": ["-m", "hypercorn", "--worker-class", "trio", "--bind", "127.0.0.1:{port}"],
}


@contextmanager
def serving(server: str, app: str) -> Iterator[int]:
    """Serve an app of `apps`, or that of `django_app`, by an ASGI server; yields its port."""
    port = free_port()
    module = "django_app:application" if app == "django" else f"apps:{app}"
    command = [part.format(port=port) for part in SERVERS[server]]
    path = os.pathsep.join([str(ROOT), str(ROOT / "src")])
    with subprocess.Popen(
        [sys.executable, *command, f"tests.extensions.asgi.{module}"],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": path},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            yield port
        finally:
            process.terminate()
            _, said = process.communicate(timeout=60)
    assert "Traceback" not in said, said


def get(client: httpx.Client, path: str, **headers: str) -> httpx.Response:
    """A page; asked again until the server listens."""
    until = time.monotonic() + 25
    while True:
        try:
            return client.get(path, headers=headers)
        except httpx.ConnectError:
            if time.monotonic() > until:
                raise
            time.sleep(0.05)


@pytest.mark.timeout(120)
@pytest.mark.parametrize(
    ("server", "app", "prefix"),
    [
        ("uvicorn", "fastapi", "/shop/robot"),
        ("uvicorn", "alone", ""),
        ("uvicorn", "django", "/shop/robot"),
        ("hypercorn", "starlette", "/shop/robot"),
        ("hypercorn", "alone", ""),
    ],
)
def test_everything_works_within(server: str, app: str, prefix: str) -> None:
    with (
        serving(server, app) as port,
        httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=60, trust_env=False) as client,
    ):
        assert get(client, f"{prefix}/api/topics/label").json() == {"data": "it is here"}
        assert client.get(f"{prefix}/api").json()["topics"] == f"{prefix}/api/topics"
        assert client.post(f"{prefix}/api/services/add", json={"a": 1, "b": 2}).json() == {"sum": 3}
        assert client.get(f"{prefix}/nothing").status_code == 404
        assert client.post(f"{prefix}/api/topics/label", content=b"x" * 1_100_000).status_code == 413
        foreign = client.post(f"{prefix}/api/services/add", json={}, headers={"Origin": "https://x.example"})
        assert foreign.status_code == 403
        with client.stream(
            "GET", f"{prefix}/api/topics/label", headers={"Accept": "text/event-stream"}
        ) as answer:
            lines = answer.iter_lines()
            assert next(lines).startswith("id: ") and next(lines) == 'data: {"data":"it is here"}'
        if app in ("fastapi", "django"):
            assert client.get("/shop").json() == {"label": "shop"}
        _speak_rosbridge(f"ws://127.0.0.1:{port}{prefix}/?x=1")


def _speak_rosbridge(url: str) -> None:
    with connect(url, subprotocols=[Subprotocol("rwt")]) as robot:
        assert robot.subprotocol == "rwt"
        robot.send('{"op": "call_service", "service": "/add", "args": {"a": 20, "b": 22}, "id": "1"}')
        assert json.loads(robot.recv(timeout=60))["values"] == {"sum": 42}
        robot.send('{"op": "subscribe", "topic": "/label", "compression": "cbor"}')
        assert isinstance(robot.recv(timeout=60), bytes)
        robot.send('{"op": "call_service", "service": "/add", "id": "2", "x": "' + "x" * 100_000 + '"}')
        answer = json.loads(robot.recv(timeout=60))
        assert answer["id"] == "2" and "max_message_size" in answer["values"]
        robot.send('{"op": "publish", "topic": "/late", "type": "std_msgs/String", "msg": {"data": "é"}}')
        robot.send('{"op": "subscribe", "topic": "/late"}')
        assert json.loads(robot.recv(timeout=60))["msg"] == {"data": "é"}
    with connect(url, origin=Origin("http://127.0.0.1:1")) as page:
        page.send("[]")
    with pytest.raises(InvalidStatus) as refused, connect(url, origin=Origin("https://elsewhere.example")):
        pass
    assert refused.value.response.status_code == 403


@pytest.mark.timeout(120)
def test_clients_are_told_when_the_server_ends() -> None:
    with serving("uvicorn", "alone") as port, ExitStack() as stack:
        with httpx.Client(base_url=f"http://127.0.0.1:{port}", trust_env=False) as client:
            get(client, "/healthz")
        robot = stack.enter_context(connect(f"ws://127.0.0.1:{port}/"))
        stack.pop_all()  # The server ends first.
    with robot, pytest.raises(ConnectionClosed) as closed:
        robot.recv(timeout=60)
    assert closed.value.rcvd is not None and closed.value.rcvd.code in (1001, 1012)
