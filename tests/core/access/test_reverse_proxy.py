"""Behind nginx, Caddy and Traefik, where they are installed: who the clients are, and what they see."""

from __future__ import annotations

import json
import re
import shutil
import socket
import ssl
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from http.client import HTTPSConnection
from pathlib import Path
from typing import Any, Final

import anyio
import httpx
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection, connect

from rwt import Server
from rwt.cli.health import health_of
from rwt_transports.http.proxies import PROXY_HEADERS, behind_proxy
from tests.core.access.test_reload import certify
from tests.core.transports.test_proxies import HOSTILE
from tests.processes import ROOT, ended, free_port

pytestmark = pytest.mark.slow

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
            proxy_headers=["x-forwarded-for", "x-forwarded-proto", "x-forwarded-prefix"],
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
        snapshot = get(port, trust, "/robot/snapshot?topic=/camera/image_raw&quality=50")
        assert (snapshot[0], snapshot[1], snapshot[2][:2]) == (200, "image/jpeg", b"\xff\xd8")
        assert "203.0.113.9 GET /robot" not in caplog.text
        assert "203.0.113.9 GET /snapshot 200" in caplog.text
        assert "quality" not in caplog.text

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


_BLOCK: Final = re.compile(r"^```nginx\n(.*?)^```", re.MULTILINE | re.DOTALL)


def _nginx_of_page(which: int) -> str:
    """Return a configuration with one of the two nginx blocks of the page."""
    blocks = _BLOCK.findall((ROOT / "docs" / "how-to" / "secure.md").read_text(encoding="utf-8"))
    assert len(blocks) == 2
    block = blocks[which].replace("{", "{{").replace("}", "}}")
    assert "http://127.0.0.1:9090" in block
    block = block.replace("http://127.0.0.1:9090", "{url}")
    return f"{_NGINX_HEAD} server {{{{ listen 127.0.0.1:{{port}};\n{block} }}}}\n}}}}\n"


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
        ("nginx", _nginx_of_page(0), ""),
        ("nginx below a path", _nginx_of_page(1), "/robot"),
        ("caddy", _CADDY_AT_ROOT, ""),
        ("caddy below a path", _CADDY_BELOW, "/robot"),
        ("traefik", _TRAEFIK_AT_ROOT, ""),
        ("traefik below a path", _TRAEFIK_BELOW, "/robot"),
    ],
)
def test_resources_events_and_websockets_through_a_proxy(
    tmp_path: Path, kind: str, config: str, prefix: str
) -> None:
    headers = [*PROXY_HEADERS, "x-forwarded-prefix"] if prefix else PROXY_HEADERS
    server = Server("ws://127.0.0.1:0", web={"enabled": False}, proxies=["127.0.0.1"], proxy_headers=headers)
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
            assert answer.is_redirect
            assert answer.headers["location"].removeprefix(f"http://{address}") == f"{prefix}/"
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


# -- hostile clients behind a proxy ------------------------------------------------------------------------


async def _echo(scope: Any, receive: Any, send: Any) -> None:
    """An ASGI app that answers with what the server tells it of a request."""
    if scope["type"] != "http":
        return
    told = {
        "client": scope["client"][0],
        "scheme": scope["scheme"],
        "root": scope["root_path"],
        "headers": [[name.decode(), value.decode()] for name, value in scope["headers"]],
    }
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": json.dumps(told).encode()})


def _dial_from(port: int) -> socket.socket:
    """A connection from an address that is not the proxy's."""
    return socket.create_connection(("127.0.0.1", port), timeout=60, source_address=("127.0.0.2", 0))


def _ask_raw(port: int, path: str, name: str, value: str) -> tuple[int, bytes]:
    """Status and body; the value may have line breaks."""
    with _dial_from(port) as wire:
        head = (
            f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nConnection: close\r\n{name}: {value}\r\n\r\n"
        )
        wire.sendall(head.encode())
        answer = b""
        while data := wire.recv(65536):
            answer += data
    head_bytes, _, body = answer.partition(b"\r\n\r\n")
    status = int(head_bytes.split()[1]) if head_bytes else 0
    if b"chunked" in head_bytes:
        body = body.partition(b"\r\n")[2].partition(b"\r\n")[0]
    return status, body


#: The block for nginx below a path, without TLS.
_NGINX_BELOW_PLAIN = _NGINX_BELOW.replace(
    "{port} ssl; ssl_certificate {folder}/cert.pem; ssl_certificate_key {folder}/key.pem;", "{port};"
).replace("$http_x_test_address", "$proxy_add_x_forwarded_for")


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has all of 127.0.0.0/8")
@pytest.mark.parametrize(
    ("kind", "config", "prefix"),
    [
        ("nginx", _nginx_of_page(0), ""),
        ("nginx below a path", _nginx_of_page(1), "/robot"),
        ("nginx below a path", _NGINX_BELOW_PLAIN, "/robot"),
        ("caddy", _CADDY_AT_ROOT, ""),
        ("caddy below a path", _CADDY_BELOW, "/robot"),
        ("traefik", _TRAEFIK_AT_ROOT, ""),
        ("traefik below a path", _TRAEFIK_BELOW, "/robot"),
    ],
)
def test_no_header_of_a_client_gets_past_a_proxy(tmp_path: Path, kind: str, config: str, prefix: str) -> None:
    headers = [*PROXY_HEADERS, "x-forwarded-prefix"] if prefix else PROXY_HEADERS
    server = Server(
        "ws://127.0.0.1:0",
        web={"enabled": False},
        proxies=["127.0.0.1"],
        proxy_headers=headers,
        mounts={"/echo": _echo},
        limits={"connections_per_address": 4},
    )
    with server, ExitStack() as stack:
        port, _ = stack.enter_context(proxy(kind, config, tmp_path, server.urls[0]))
        _wait_for(port, f"{prefix}/echo")
        for name, value in HOSTILE:
            status, body = _ask_raw(port, f"{prefix}/echo", name, value)
            if status == 400:
                continue  # The proxy itself refuses it.
            assert status == 200, (name, value, body)
            told = json.loads(body)
            seen = dict(told["headers"])
            assert told["client"] == behind_proxy("127.0.0.2"), (name, value)
            assert (told["scheme"], told["root"]) == ("http", f"{prefix}/echo"), (name, value)
            assert seen["host"] == f"127.0.0.1:{port}", (name, value)
            assert seen.keys() <= {"host", "x-forwarded-proto", "connection", "accept-encoding", "user-agent"}
        # A proxy may drop its own headers as those of the connection; then its clients are one.
        for name in headers:
            told = json.loads(_ask_raw(port, f"{prefix}/echo", "Connection", f"close, {name}")[1])
            assert told["client"] in (behind_proxy("127.0.0.2"), behind_proxy("127.0.0.1"))
            assert told["scheme"] == "http"
        # What names other addresses does not make more of one client.
        opened = 0
        for name, value in HOSTILE:
            if "\r" not in value:
                opened += _opens(stack, port, prefix, {name: value})
        assert opened == 4


@pytest.mark.parametrize(
    ("settings", "verdict", "text"),
    [
        ({"proxies": ["127.0.0.1"]}, "ok", "trusts x-forwarded-for, x-forwarded-proto"),
        ({"proxies": ["127.0.0.1"], "proxy_headers": ["x-real-ip"]}, "warning", "x-forwarded-for"),
        ({}, "warning", "x-forwarded-for"),
    ],
)
def test_the_doctor_examines_the_headers_of_a_proxy(
    tmp_path: Path, settings: dict[str, Any], verdict: str, text: str
) -> None:
    server = Server("ws://127.0.0.1:0", web={"enabled": False}, **settings)
    with server, proxy("nginx", _nginx_of_page(0), tmp_path, server.urls[0]) as (port, _):
        _wait_for(port, "/healthz")
        told = json.loads(ended("doctor", f"ws://127.0.0.1:{port}", "--json").stdout)
    (found,) = (each for each in told["findings"] if each["name"] == "proxies")
    assert (found["verdict"], text in found["text"]) == (verdict, True)


def _opens(stack: ExitStack, port: int, prefix: str, headers: dict[str, str]) -> bool:
    """Open a WebSocket until the end of the stack; False if it is refused."""
    url, sock = f"ws://127.0.0.1:{port}{prefix}/", _dial_from(port)
    try:
        stack.enter_context(connect(url, sock=sock, additional_headers=headers, open_timeout=60.0))
    except InvalidStatus as refused:
        assert refused.response.status_code in (400, 429)
        return False
    return True


def _wait_for(port: int, path: str) -> None:
    until = time.monotonic() + 20
    while True:
        try:
            if _ask_raw(port, path, "Accept", "*/*")[0] == 200:
                return
        except ConnectionRefusedError:
            pass
        assert time.monotonic() < until
        time.sleep(0.05)
