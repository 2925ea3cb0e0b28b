"""Behind a reverse proxy: who its clients are, what they see; with nginx in front, where it is installed."""

from __future__ import annotations

import json
import shutil
import ssl
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from http.client import HTTPSConnection
from pathlib import Path

import anyio
import httpx
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection, connect

from rwt import Server
from rwt.cli.health import health_of
from rwt_transports.http.routes import Proxies
from tests.core.access.test_reload import certify
from tests.processes import free_port

pytestmark = pytest.mark.slow

PEER = "10.0.0.1"
PROXIES = Proxies(["10.0.0.0/8", "fd00::/8"])


@pytest.mark.parametrize(
    ("headers", "address"),
    [
        ({}, PEER),
        ({"x-forwarded-for": "203.0.113.7"}, "203.0.113.7"),
        # What the client made up stands before what the proxies have added.
        ({"x-forwarded-for": "198.51.100.1, 203.0.113.7, 10.0.0.9"}, "203.0.113.7"),
        ({"x-forwarded-for": "10.0.0.8, 10.0.0.9"}, "10.0.0.8"),
        ({"x-forwarded-for": "203.0.113.7, nonsense"}, PEER),
        ({"forwarded": 'for="[2001:db8::7]:4711";proto=https'}, "2001:db8::7"),
        ({"forwarded": "for=198.51.100.1, for=203.0.113.7;by=10.0.0.2"}, "203.0.113.7"),
        ({"forwarded": "for=unknown"}, PEER),
        ({"forwarded": "for=203.0.113.7", "x-forwarded-for": "198.51.100.1"}, "203.0.113.7"),
    ],
)
def test_the_client_is_the_first_from_the_end_that_is_no_proxy(headers: dict[str, str], address: str) -> None:
    assert PROXIES.resolve(PEER, dict(headers))[0] == address
    assert PROXIES.resolve("192.0.2.1", dict(headers))[0] == "192.0.2.1"


def test_what_a_stranger_says_of_itself_is_dropped() -> None:
    said = {
        "host": "robot",
        "x-forwarded-for": "127.0.0.1",
        "x-forwarded-host": "other",
        "x-forwarded-proto": "https",
        "x-forwarded-prefix": "/robot",
        "forwarded": "for=127.0.0.1;host=other",
    }
    headers = dict(said)
    assert PROXIES.resolve("192.0.2.1", headers) == ("192.0.2.1", "")
    assert headers == {"host": "robot"}
    headers = {**said, "forwarded": ""}
    assert PROXIES.resolve(PEER, headers) == ("127.0.0.1", "/robot")
    assert headers == {"host": "other", "x-forwarded-proto": "https"}


_NGINX_HEAD = """
daemon off; pid {folder}/pid; error_log {folder}/error.log; worker_processes 1;
events {{ }}
http {{
  access_log off;
  client_body_temp_path {folder}/body; proxy_temp_path {folder}/proxy; fastcgi_temp_path {folder}/fastcgi;
  uwsgi_temp_path {folder}/uwsgi; scgi_temp_path {folder}/scgi;
  proxy_http_version 1.1; proxy_buffering off;
"""

_NGINX_BELOW = (
    _NGINX_HEAD
    + """  server {{
    listen 127.0.0.1:{port} ssl; ssl_certificate {folder}/cert.pem; ssl_certificate_key {folder}/key.pem;
    location ~ ^/robot(/|$) {{
      set $page $http_upgrade$uri;
      if ($page = /robot) {{ return 301 /robot/; }}
      rewrite ^/robot/?(.*)$ /$1 break;
      proxy_pass {url};
      proxy_set_header Upgrade $http_upgrade; proxy_set_header Connection "upgrade";
      proxy_set_header Host $http_host;
      # A test has one machine: what it says in front stands for the client's address.
      proxy_set_header X-Forwarded-For $http_x_test_address;
      proxy_set_header X-Forwarded-Proto $scheme; proxy_set_header X-Forwarded-Prefix /robot;
    }}
  }}
}}
"""
)


@contextmanager
def proxy(kind: str, config: str, folder: Path, url: str) -> Iterator[tuple[int, subprocess.Popen[bytes]]]:
    """A proxy in front of a server; its port."""
    port = free_port()
    address = url.removeprefix("ws://")
    text = config.format(folder=folder, port=port, url=f"http://{address}", address=address)
    (folder / "config").write_text(text)
    home = {"HOME": str(folder)}
    with subprocess.Popen(_command(kind, folder), stderr=subprocess.PIPE, env=home) as process:
        try:
            yield port, process
        finally:
            process.terminate()
            process.communicate(timeout=60)


def get(port: int, trust: ssl.SSLContext, path: str) -> tuple[int, str, bytes]:
    """Status, type and body; asked again until nginx listens."""
    until = time.monotonic() + 20
    while True:
        client = HTTPSConnection("127.0.0.1", port, context=trust, timeout=60)
        try:
            client.request("GET", path, headers={"X-Test-Address": "203.0.113.9"})
            answer = client.getresponse()
            return answer.status, answer.headers["content-type"], answer.read()
        except (ConnectionRefusedError, ssl.SSLCertVerificationError):
            if time.monotonic() > until:
                raise
        finally:
            client.close()


def dial(port: int, trust: ssl.SSLContext, address: str) -> ClientConnection:
    return connect(
        f"wss://127.0.0.1:{port}/robot/", ssl=trust, additional_headers={"X-Test-Address": address}
    )


def answers(client: ClientConnection) -> bool:
    client.send(json.dumps({"op": "call_service", "service": "/rosapi/get_time"}))
    return bool(json.loads(client.recv(timeout=60))["result"])


def test_nginx_in_front_below_a_path_with_tls(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    trust = certify(tmp_path, 1)
    with ExitStack() as stack:
        server = Server(
            "ws://127.0.0.1:0",
            demo=True,
            proxies=["127.0.0.1"],
            access_log=True,
            limits={"connections_per_address": 2},
        )
        caplog.set_level("INFO", "rwt_transports.access")
        robot = stack.enter_context(server)
        port, process = stack.enter_context(proxy("nginx", _NGINX_BELOW, tmp_path, server.urls[0]))
        status, kind, page = get(port, trust, "/robot/index")
        assert (status, kind) == (200, "text/html; charset=utf-8")
        assert f"wss://127.0.0.1:{port}/robot/".encode() in page
        assert get(port, trust, "/robot")[0] == 301
        with connect(f"wss://127.0.0.1:{port}/robot", ssl=trust) as direct:
            assert answers(direct)
        assert b'href="/' not in page
        link = "stream_viewer?topic=/camera/image_raw"
        assert f'href="{link}"'.encode() in page
        assert b'src="stream?topic=/camera/image_raw' in get(port, trust, f"/robot/{link}")[2]
        snapshot = get(port, trust, "/robot/snapshot?topic=/camera/image_raw&token=no")
        assert (snapshot[0], snapshot[1], snapshot[2][:2]) == (200, "image/jpeg", b"\xff\xd8")
        assert "203.0.113.9 GET /robot" not in caplog.text
        assert "203.0.113.9 GET /snapshot 200" in caplog.text
        assert "token" not in caplog.text

        first = stack.enter_context(dial(port, trust, "203.0.113.7"))
        second = stack.enter_context(dial(port, trust, "203.0.113.7"))
        with pytest.raises(InvalidStatus) as refused:
            dial(port, trust, "203.0.113.7")
        assert refused.value.response.status_code == 429
        other = stack.enter_context(dial(port, trust, "203.0.113.8"))
        assert [answers(client) for client in (first, second, other)] == [True] * 3
        clients = robot.once("/connected_clients", timeout=60.0).clients
        assert sorted(client.ip_address for client in clients) == ["203.0.113.7"] * 2 + ["203.0.113.8"]

        renewed = certify(tmp_path, 2)
        process.send_signal(1)  # SIGHUP
        assert get(port, renewed, "/robot/healthz")[0] == 200
        assert [answers(client) for client in (first, second, other)] == [True] * 3
        assert process.poll() is None


_NGINX_AT_ROOT = (
    _NGINX_HEAD
    + """  map $http_upgrade $connection_upgrade {{ default upgrade; "" ""; }}
  server {{
    listen 127.0.0.1:{port};
    location / {{
      proxy_pass {url};
      proxy_set_header Upgrade $http_upgrade; proxy_set_header Connection $connection_upgrade;
      proxy_set_header Host $http_host;
      proxy_set_header X-Forwarded-For $proxy_add_x_forwarded_for; proxy_set_header X-Forwarded-Proto $scheme;
    }}
  }}
}}
"""
)

_CADDY_AT_ROOT = """
{{
  admin off
  auto_https off
  storage file_system {folder}/caddy
}}
http://127.0.0.1:{port} {{
  reverse_proxy {address}
}}
"""

_CADDY_BELOW = """
{{
  admin off
  auto_https off
  storage file_system {folder}/caddy
}}
http://127.0.0.1:{port} {{
  @folder {{
    path /robot
    not header Upgrade websocket
  }}
  redir @folder /robot/
  @robot path /robot /robot/*
  handle @robot {{
    uri strip_prefix /robot
    reverse_proxy {address} {{
      header_up X-Forwarded-Prefix /robot
    }}
  }}
}}
"""


_TRAEFIK_AT_ROOT = """
entryPoints: {{web: {{address: "127.0.0.1:{port}"}}}}
providers: {{file: {{filename: "{folder}/routes.yml"}}}}
http:
  routers: {{robot: {{rule: "PathPrefix(`/`)", service: robot}}}}
  services: {{robot: {{loadBalancer: {{servers: [{{url: "{url}"}}]}}}}}}
"""

_TRAEFIK_BELOW = """
entryPoints: {{web: {{address: "127.0.0.1:{port}"}}}}
providers: {{file: {{filename: "{folder}/routes.yml"}}}}
http:
  routers: {{robot: {{rule: "PathPrefix(`/robot/`)", service: robot, middlewares: [below]}}}}
  middlewares: {{below: {{stripPrefix: {{prefixes: [/robot]}}}}}}
  services: {{robot: {{loadBalancer: {{servers: [{{url: "{url}"}}]}}}}}}
"""


def _command(kind: str, folder: Path) -> list[str]:
    name = kind.partition(" ")[0]
    places = f"/usr/sbin:/usr/bin:/sbin:/usr/local/sbin:/usr/local/bin:{Path(sys.executable).parent}"
    program = shutil.which(name, path=places)
    if program is None:
        where = "`make proxies` installs it" if name == "traefik" else "Debian has it"
        pytest.skip(f"{name} is not installed ({where})")
    file = str(folder / "config")
    if name == "traefik":
        # What it listens on is in one file, and where requests go in another, which it reads again.
        begins, _, routes = (folder / "config").read_text().partition("http:")
        (folder / "begins.yml").write_text(begins)
        (folder / "routes.yml").write_text(f"http:{routes}")
        return [program, f"--configFile={folder}/begins.yml"]
    if name == "nginx":
        return [program, "-p", str(folder), "-c", file]
    return [program, "run", "--adapter", "caddyfile", "--config", file]


@pytest.mark.parametrize(
    ("kind", "config", "prefix"),
    [
        ("nginx", _NGINX_AT_ROOT, ""),
        ("caddy", _CADDY_AT_ROOT, ""),
        ("caddy below a path", _CADDY_BELOW, "/robot"),
        ("traefik", _TRAEFIK_AT_ROOT, ""),
        ("traefik below a path", _TRAEFIK_BELOW, "/robot"),
    ],
)
def test_resources_events_and_websockets_through_a_proxy(
    tmp_path: Path, kind: str, config: str, prefix: str
) -> None:
    server = Server("ws://127.0.0.1:0", web={"enabled": False}, proxies=["127.0.0.1"])
    with server as robot:
        robot.publish("/label", {"data": "it is here"}, "std_msgs/String", latch=True)
        with proxy(kind, config, tmp_path, server.urls[0]) as (port, _):
            _use(f"127.0.0.1:{port}", prefix, follows_bare_path="traefik" not in kind)


def _use(address: str, prefix: str, *, follows_bare_path: bool) -> None:
    """Use a robot behind a proxy, as soon as it listens.

    Args:
        follows_bare_path: True if the proxy passes on WebSockets at the prefix without a slash.
    """
    until = time.monotonic() + 20
    with httpx.Client(base_url=f"http://{address}", timeout=60, trust_env=False) as client:
        while True:
            try:
                answer = client.get(f"{prefix}/api")
                if answer.status_code == 200 or time.monotonic() > until:
                    break  # Traefik listens before it knows where requests go.
            except httpx.ConnectError:
                if time.monotonic() > until:
                    raise
            time.sleep(0.05)
        topics = answer.json()["topics"]
        assert topics == f"{prefix}/api/topics"
        assert client.get(f"{topics}/label").json() == {"data": "it is here"}
        if prefix and follows_bare_path:
            answer = client.get(prefix)
            assert (answer.is_redirect, answer.headers["location"]) == (True, f"{prefix}/")
        health = anyio.run(health_of, f"ws://{address}{prefix}", 20.0, None)
        assert health is not None and health.version
        assert client.get(f"{prefix}/api/openapi.json").json()["servers"] == [{"url": prefix or "/"}]
        accept = {"Accept": "text/event-stream"}
        with client.stream("GET", f"{topics}/label", headers=accept) as answer:
            lines = answer.iter_lines()
            assert next(lines).startswith("id: ") and next(lines) == 'data: {"data":"it is here"}'
    # A redirect, as for `/robot`, is an error for a WebSocket client.
    for slash in ("/", "") if follows_bare_path else ("/",):
        with connect(f"ws://{address}{prefix}{slash}") as robot:
            assert answers(robot)
