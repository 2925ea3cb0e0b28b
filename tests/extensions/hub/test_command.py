"""`rwt hub` and `rwt serve --dial` as their users meet them: two processes, and clients of the hub."""

from __future__ import annotations

import json
import re
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from rwt.extensions.hub.uplink.frames import SUBPROTOCOL as NAME
from tests.processes import ended, running

SUBPROTOCOL = Subprotocol(NAME)
_TOKEN = "0123456789abcdef"


@contextmanager
def _client(url: str) -> Iterator[ClientConnection]:
    """A client of a robot that may still be dialling in."""
    for _ in range(100):
        try:
            wire = connect(url)
        except InvalidStatus as refused:
            assert refused.response.status_code == 404
            time.sleep(0.05)
            continue
        with wire:
            yield wire
        return
    raise AssertionError("the robot did not dial in")


def _add(wire: ClientConnection, a: int, b: int) -> object:
    call = {"op": "call_service", "id": "1", "service": "/add_two_ints", "args": {"a": a, "b": b}}
    wire.send(json.dumps(call))
    return json.loads(wire.recv(timeout=60))["values"]["sum"]


def _page(url: str, path: str, **headers: str) -> httpx.Response:
    return httpx.get(f"{url.replace('ws', 'http', 1)}{path}", headers=headers, timeout=60)


def test_a_robot_behind_a_hub() -> None:
    with running("hub", "ws://127.0.0.1:0", "--token", _TOKEN) as (hub, url):
        robot_url = f"{url}/robots/rosie"
        robot = running(
            *("serve", "--demo", "--dial", robot_url),
            ready="dialing",
            environment={"RWT_DIAL__TOKEN": _TOKEN},
        )
        with robot as (process, said):
            assert said == robot_url
            with _client(f"{url}/rosie") as one, _client(f"{url}/rosie") as two:
                assert (_add(one, 1, 2), _add(two, 30, 4)) == (3, 34)
                listed = _page(url, "/robots").json()["robots"]
                assert listed == [{"name": "rosie", "path": "/rosie", "clients": 2}]
                process.send_signal(signal.SIGTERM)
                for wire in (one, two):
                    with pytest.raises(ConnectionClosed) as closed:
                        wire.recv(timeout=60)
                    assert closed.value.rcvd is not None and closed.value.rcvd.code == 1001
            assert process.wait(timeout=60) == 0
        # 503 until the hub has heard that the robot's connections have ended.
        for _ in range(100):
            if (status := _page(url, "/rosie").status_code) != 503:
                break
            time.sleep(0.1)
        assert status == 404
        assert hub.poll() is None


def test_a_robot_may_listen_as_well() -> None:
    with (
        running("hub", "ws://127.0.0.1:0") as (_, hub),
        running(
            *("serve", "ws://127.0.0.1:0", "--demo", "--dial", f"{hub}/robots/rosie"), ready="listening on"
        ) as (_, near),
        _client(f"{hub}/rosie") as through,
        connect(near) as direct,
    ):
        assert (_add(through, 1, 1), _add(direct, 2, 2)) == (2, 4)
        assert f'rwt_dial_clients{{hub="{hub}/robots/rosie"}} 1\n' in _page(near, "/metrics").text


def _fails(*arguments: str) -> tuple[int, str]:
    done = ended(*arguments)
    assert re.fullmatch(r"rwt: [^\n]+\n", done.stderr), done.stderr
    return done.returncode, done.stderr


@pytest.mark.parametrize(
    ("arguments", "code", "says"),
    [
        (["hub", "tcp://127.0.0.1:0"], 2, "expected ws:// or wss://"),
        (["hub", "ws://0.0.0.0:0"], 2, "requires a token"),
        (["hub", "ws://127.0.0.1:0", "--token", "short"], 2, "16 to 256"),
        (["hub", "ws://127.0.0.1:0", "--token-file", "/no/such/file"], 2, "/no/such/file"),
        (["hub", "wss://127.0.0.1:0"], 1, "needs a certificate"),
        (["hub", "wss://127.0.0.1:0", "--certfile", "x.pem"], 2, "--keyfile together"),
        (["hub", "ws://127.0.0.1:99999"], 1, "port"),
        (["serve", "--dial", "wss://hub.example/rosie"], 2, "its path must be /robots/NAME"),
        (["serve", "--dial", "hub.example"], 2, "wss://hub.example/robots/my_robot"),
        (["serve", "--dial", "wss://h/robots/a", "--set", "dial.token=x"], 2, "dial.token"),
        (["serve", "--dial", "wss://h/robots/a", "--set", "dial.cafile=/no/ca.pem"], 2, "/no/ca.pem"),
        (["serve", "--set", "listen=[]"], 2, "at least one URL"),
    ],
)
def test_what_cannot_be_done_is_one_line(arguments: list[str], code: int, says: str) -> None:
    exit_code, error = _fails(*arguments)
    assert says in error
    assert exit_code == code
    assert "short" not in error


def test_the_dial_token_is_not_shown() -> None:
    done = ended("config", "show", "--set", f"dial.token={_TOKEN}")
    assert _TOKEN not in done.stdout


_ROLES = """
[roles.viewer]
subscribe = ["/camera/image_raw"]
[auth.tokens.tablet]
token = "tablet-0123456789"
role = "viewer"
[auth.tokens.owner]
token = "owner-0123456789a"
role = "admin"
"""


@pytest.fixture(scope="module")
def robot_with_roles(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The URL of a hub, at which a robot called rosie has dialled in."""
    config = tmp_path_factory.mktemp("robot") / "rwt.toml"
    config.write_text(_ROLES)
    with (
        running("hub", "ws://127.0.0.1:0") as (_, url),
        running(
            *("serve", "--demo", "--config", str(config), "--dial", f"{url}/robots/rosie"), ready="dialing"
        ),
        _client(f"{url}/rosie?token=owner-0123456789a"),
    ):
        yield url


def test_pages_and_pictures_of_a_robot_go_through_the_hub(robot_with_roles: str) -> None:
    owner = "token=owner-0123456789a"
    page = _page(robot_with_roles, f"/rosie/?{owner}")
    assert (page.status_code, page.headers["content-type"]) == (200, "text/html; charset=utf-8")
    assert "content-security-policy" in page.headers
    index = _page(robot_with_roles, f"/rosie/index?{owner}")
    assert index.is_success and f"{robot_with_roles}/rosie" in index.text
    picture = _page(robot_with_roles, f"/rosie/snapshot?topic=/camera/image_raw&{owner}")
    assert (picture.headers["content-type"], picture.content[:2]) == ("image/jpeg", b"\xff\xd8")
    metrics = _page(robot_with_roles, f"/rosie/metrics?{owner}")
    assert metrics.is_success and "rwt_dial_clients" in metrics.text
    missing = _page(robot_with_roles, f"/rosie/nothing?{owner}")
    assert missing.status_code == 404 and "/snapshot" in missing.text
    hub_metrics = _page(robot_with_roles, "/metrics").text
    assert re.search(r'^rwt_hub_robot_streams\{robot="rosie"\} [0-9]+$', hub_metrics, re.MULTILINE)
    assert "\nrwt_hub_robots 1\n" in hub_metrics and "\nrwt_hub_clients_total 1\n" in hub_metrics


@pytest.mark.parametrize(
    ("path", "token", "status"),
    [
        ("/rosie/snapshot?topic=/camera/image_raw", "tablet-0123456789", 200),
        ("/rosie/snapshot?topic=/camera/depth/image_raw", "tablet-0123456789", 403),
        ("/rosie/metrics", "tablet-0123456789", 403),
        ("/rosie/snapshot?topic=/camera/image_raw", "", 401),
        ("/rosie/index", "nobody-0123456789", 401),
        ("/rosie/healthz", "", 200),
    ],
)
def test_the_robots_roles_decide_about_its_pages(
    robot_with_roles: str, path: str, token: str, status: int
) -> None:
    headers = {"Authorization": f"Bearer {token}"} if token else {}
    assert _page(robot_with_roles, path, **headers).status_code == status


def test_a_hub_behind_a_proxy_keeps_its_prefix_and_logs_requests() -> None:
    written = ("x-forwarded-for", "x-forwarded-host", "x-forwarded-prefix")
    trusted = ("--proxy", "127.0.0.1", *(each for name in written for each in ("--proxy-header", name)))
    with running("hub", "ws://127.0.0.1:0", *trusted, "--host", "robots.example", "--access-log") as (
        hub,
        url,
    ):
        forwarded = {
            "X-Forwarded-Prefix": "/fleet",
            "X-Forwarded-Host": "robots.example",
            "X-Forwarded-For": "192.0.2.7",
        }
        robot = running("serve", "--demo", "--dial", f"{url}/robots/rosie", ready="dialing")
        with robot, _client(f"{url}/rosie"):
            assert "ws://robots.example/fleet/rosie" in _page(url, "/rosie/index", **forwarded).text
            moved = _page(url, "/rosie?token=x", **forwarded)
            assert (moved.status_code, moved.headers["location"]) == (308, "/fleet/rosie/?token=x")
        hub.terminate()
        _, log = hub.communicate(timeout=60)
    assert re.search(r"192\.0\.2\.7 .*GET /rosie/index.* 200", log), log
    assert "trusting x-forwarded-for, x-forwarded-host, x-forwarded-prefix from 127.0.0.1" in log


def test_a_hub_rejects_headers_that_contradict_each_other() -> None:
    given = ("--proxy", "127.0.0.1", "--proxy-header", "forwarded", "--proxy-header", "x-forwarded-for")
    done = ended("hub", "ws://127.0.0.1:0", *given)
    assert done.returncode == 2 and "both give the client's address" in done.stderr


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="there is no such signal here")
def test_a_hangup_reads_tokens_again_and_a_bad_file_keeps_the_old(tmp_path: Path) -> None:
    tokens = tmp_path / "tokens"
    tokens.write_text(f"{_TOKEN}\n")
    new = "another-long-token"

    def dials_in(url: str, token: str) -> bool:
        try:
            headers = {"Authorization": f"Bearer {token}"}
            with connect(f"{url}/robots/r", additional_headers=headers, subprotocols=[SUBPROTOCOL]):
                return True
        except InvalidStatus:
            return False

    def becomes(url: str, token: str) -> bool:
        for _ in range(200):
            if dials_in(url, token):
                return True
            time.sleep(0.05)
        return False

    with running("hub", "ws://127.0.0.1:0", "--token-file", str(tokens)) as (hub, url):
        stays = {"Authorization": f"Bearer {_TOKEN}"}
        with connect(f"{url}/robots/stays", additional_headers=stays, subprotocols=[SUBPROTOCOL]) as wire:
            tokens.write_text("short\n")
            hub.send_signal(signal.SIGHUP)
            assert dials_in(url, _TOKEN)
            tokens.write_text(f"{new}\n")
            hub.send_signal(signal.SIGHUP)
            assert becomes(url, new)
            assert not dials_in(url, _TOKEN)
            with pytest.raises(ConnectionClosed) as closed:
                wire.recv(timeout=60)
            assert closed.value.rcvd is not None and closed.value.rcvd.code == 1008
            tokens.write_text("")
            hub.send_signal(signal.SIGHUP)
            assert dials_in(url, new)
            assert not dials_in(url, _TOKEN)
        hub.terminate()
        _, log = hub.communicate(timeout=60)
    assert "stay as they were: a token is 16 to 256" in log
    assert "stay as they were: no token is left" in log
    assert "were read again" in log
