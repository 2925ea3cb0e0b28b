"""Sessions of the HTTP gateway, and the server's pages."""

from __future__ import annotations

from typing import Final

import cbor2

from tests.traces.rosbridge import ROBOT
from tests.traces.transcript import Session, Transcript
from tests.traces.wires import Http, raw_exchange, refused, serving

_CBOR: Final = {"Accept": "application/cbor"}
_EVENTS: Final = {"Accept": "text/event-stream"}
_HTML: Final = {"Accept": "text/html"}


def http_api(transcript: Transcript) -> None:
    """Record the resources below `/api`, and the server's pages."""
    with serving("--script", str(ROBOT)) as url:
        api = Http(transcript, url)
        _resources(api)
        # Without its headers: the length of the body varies.
        transcript.add(Http(Transcript("unused"), url).request("GET", "/healthz")[1])
        transcript.title("forms")
        _forms(api)
        transcript.title("publish")
        _publications(api)
        transcript.title("calls")
        _calls(api)
        transcript.title("goals")
        _goals(api)
        transcript.title("parameters")
        _parameters(api)
        transcript.title("events")
        _events(api)
        transcript.title("pages, without their bodies, which hold figures")
        _pages(api)
        transcript.title("requests that are none")
        raw_exchange(transcript, url, b"nonsense\r\n\r\n")
        raw_exchange(transcript, url, b"GET /version HTTP/1.1\r\n\r\n")
        raw_exchange(
            transcript, url, b"GET /version HTTP/3.0\r\nHost: localhost\r\nConnection: close\r\n\r\n"
        )
        refused(transcript, url, {"Origin": "https://evil.example"})
        refused(transcript, url, {"Host": "robot.example"})


def _resources(api: Http) -> None:
    for path in (
        "/api",
        "/api/topics",
        "/api/services",
        "/api/actions",
        "/api/parameters",
        "/api/parameters/lab:max_speed",
        "/api/parameters/lab:nothing",
        "/api/topics/map_name",
        "/api/topics/pose?wait=0",
        "/api/topics/pose?wait=0.05",
        "/api/topics/pose?wait=-1",
        "/api/topics/pose?wait=9999",
        "/api/topics/pose?wait=1&wait=2",
        "/api/topics/pose?colour=red",
        "/api/topics/nothing",
        "/api/topics/a%20b",
        "/api/topics/%2Fmap_name",
        "/api/services/add",
        "/api/services/nothing",
        "/api/actions/dock",
        "/api/actions/nothing",
        "/api/actions/dock/goals/nothing",
        "/api/types/geometry_msgs/Twist",
        "/api/types/geometry_msgs/msg/Twist",
        "/api/types/nothing/Nothing",
        "/api/nothing",
        "/version",
        "/role",
        "/nothing",
    ):
        api.request("GET", path)


def _forms(api: Http) -> None:
    api.request("GET", "/api/topics/map_name", headers=_CBOR)
    api.request("GET", "/api/topics/map_name", headers={"Accept": "text/plain"})
    headers, _ = api.request("GET", "/api/services")
    api.request("GET", "/api/services", headers={"If-None-Match": headers["ETag"]})
    api.request("HEAD", "/api/services")
    api.request("OPTIONS", "/api/services")
    api.request("GET", "/api/services", headers={"Origin": "https://evil.example"})
    api.request("GET", "/api/services", headers={"Origin": "http://localhost:8000"})
    api.request("GET", "/api/services", headers={"Host": "robot.example"})


def _publications(api: Http) -> None:
    for path, body in (
        ("/api/topics/cmd_vel", '{"linear": {"x": 0.5}}'),
        ("/api/topics/cmd_vel", '{"linear": {"x": "fast"}}'),
        ("/api/topics/cmd_vel", '{"speed": 1}'),
        ("/api/topics/cmd_vel", "nonsense"),
        ("/api/topics/cmd_vel", ""),
        ("/api/topics/cmd_vel", "[]"),
        ("/api/topics/cmd_vel?type=std_msgs/String", '{"data": "x"}'),
        ("/api/topics/unknown", '{"data": "x"}'),
        ("/api/topics/made?type=std_msgs/String&latch=true", '{"data": "x"}'),
        ("/api/topics/made?type=nothing/Nothing", "{}"),
        ("/api/topics/a%20b?type=std_msgs/String", "{}"),
        ("/api/topics/made?latch=perhaps", "{}"),
    ):
        api.request("POST", path, body)
    api.request("GET", "/api/topics/made")
    typed = {"Content-Type": "application/cbor"}
    api.request("POST", "/api/topics/cmd_vel", cbor2.dumps({"linear": {"x": 1.0}}), typed)
    api.request("POST", "/api/topics/cmd_vel", b"\xff", typed)
    api.request("POST", "/api/topics/cmd_vel", "<x/>", {"Content-Type": "application/xml"})
    for method in ("PUT", "DELETE", "PATCH"):
        api.request(method, "/api/topics/cmd_vel", "{}")


def _calls(api: Http) -> None:
    for path, body in (
        ("/api/services/add", '{"a": 1, "b": 2}'),
        ("/api/services/add", "[1, 2]"),
        ("/api/services/add", '{"a": 13}'),
        ("/api/services/add", '{"a": "two"}'),
        ("/api/services/add?timeout=0.05", '{"a": 14}'),
        ("/api/services/add?timeout=nonsense", "{}"),
        ("/api/services/nothing", "{}"),
    ):
        api.request("POST", path, body)
    api.request("POST", "/api/services/add", '{"a": 1}', _CBOR)


def _goals(api: Http) -> None:
    headers, _ = api.request("POST", "/api/actions/dock/goals", '{"order": 3}')
    api.request("GET", headers["Location"], headers=_EVENTS, events=4)
    api.request("GET", headers["Location"])
    api.request("DELETE", headers["Location"])
    api.request("GET", headers["Location"])
    headers, _ = api.request("POST", "/api/actions/wait/goals", "{}")
    api.request("GET", headers["Location"])
    api.request("DELETE", headers["Location"])
    for path, body in (
        ("/api/actions/deny/goals", "{}"),
        ("/api/actions/dock/goals", '{"order": "x"}'),
        ("/api/actions/nothing/goals", "{}"),
    ):
        api.request("POST", path, body)


def _parameters(api: Http) -> None:
    for value in ("0.75", '"text"', "nonsense", '{"a": 1}', "null"):
        api.request("PUT", "/api/parameters/lab:max_speed", value)
    api.request("PUT", "/api/parameters/nobody:x", "1")
    api.request("DELETE", "/api/parameters/lab:label")
    api.request("DELETE", "/api/parameters/lab:nothing")


def _events(api: Http) -> None:
    api.request("GET", "/api/topics/map_name", headers=_EVENTS, events=1)
    api.request("GET", "/api/topics/map_name?throttle=-1", headers=_EVENTS)
    api.request("GET", "/api/topics/map_name?queue=0", headers=_EVENTS)
    api.request("GET", "/api/topics/nothing", headers=_EVENTS)


def _pages(api: Http) -> None:
    for path in ("/", "/index", "/stream_viewer?topic=/x"):
        api.request("GET", path, headers=_HTML, show=False)
    api.request("GET", "/api", headers=_HTML, show=False)


SESSIONS: Final[dict[str, Session]] = {"http": http_api}
