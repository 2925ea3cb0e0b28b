"""Sessions of the other gateways: Foxglove's protocol, HTTP and MCP."""

from __future__ import annotations

import json
import struct
from functools import partial
from typing import Any, Final

import cbor2

from tests.traces.rosbridge import ADD, ROBOT
from tests.traces.transcript import Session, Transcript
from tests.traces.wires import Http, Wire, raw_exchange, refused, serving


def foxglove(transcript: Transcript, distro: str) -> None:
    """Record Foxglove's protocol with one distribution."""
    binary = "cdr" if distro == "jazzy" else "ros1"
    # The first client stays to the end: channels get other ids once the last client has gone.
    with (
        serving("--script", str(ROBOT), "--distro", distro, "--set", "nodes=rosapi") as url,
        Wire(transcript, "v1", url, ["foxglove.websocket.v1"]) as v1,
    ):
        transcript.title("foxglove.websocket.v1")
        transcript.add(v1.head)
        _catalogue(v1)
        with Wire(transcript, "sdk", url, ["foxglove.sdk.v1"]) as sdk:
            transcript.title("foxglove.sdk.v1")
            transcript.add(sdk.head)
            channels, services = _catalogue(sdk)
            _parameters(transcript, sdk)
            _channels(transcript, sdk, channels)
            _calls(transcript, sdk, services, binary)
            _mistakes(transcript, sdk)
        with Wire(transcript, "writer", url, ["foxglove.sdk.v1"]) as writer:
            transcript.title("channels of a client")
            channels, _ = _catalogue(writer)
            _publications(writer, channels, binary)


def _catalogue(wire: Wire) -> tuple[dict[str, int], dict[str, int]]:
    channels: dict[str, int] = {}
    while True:
        said = wire.hear_json()
        if said["op"] == "advertise":
            channels |= {each["topic"]: each["id"] for each in said["channels"]}
        if said["op"] == "advertiseServices":
            return channels, {each["name"]: each["id"] for each in said["services"]}


def _parameters(transcript: Transcript, wire: Wire) -> None:
    transcript.title("parameters")
    name = "/lab.max_speed"
    for names in ([name], [name, "/lab.label"], ["/nothing"], ["no slash"], []):
        wire.say({"op": "getParameters", "parameterNames": names, "id": "get"})
        wire.hear_until('"parameterValues"')
    for value in (0.75, "text", [1.5, 2], None, {"x": 1}):
        parameter = {"name": "/lab.max_speed", "value": value}
        wire.say({"op": "setParameters", "parameters": [parameter], "id": "set"})
        wire.hear_until('"id":"set"')


def _channels(transcript: Transcript, wire: Wire, channels: dict[str, int]) -> None:
    transcript.title("messages of channels")
    for number, topic in enumerate(("/map_name", "/pose", "/blob")):
        if topic in channels:
            wire.say({"op": "subscribe", "subscriptions": [{"id": number, "channelId": channels[topic]}]})
            if topic == "/map_name":
                wire.hear()
    wire.say({"op": "subscribe", "subscriptions": [{"id": 0, "channelId": channels["/map_name"]}]})
    wire.hear()
    wire.say({"op": "subscribe", "subscriptions": [{"id": 90, "channelId": 9999}]})
    wire.hear()
    wire.say({"op": "unsubscribe", "subscriptionIds": [0, 1, 2, 77]})


def _calls(transcript: Transcript, wire: Wire, services: dict[str, int], binary: str) -> None:
    transcript.title("calls")
    head = b"\0\1\0\0" if binary == "cdr" else b""
    for service, encoding, payload in (
        ("/add", "json", b'{"a": 2, "b": 3}'),
        ("/add", binary, head + struct.pack("<qq", 2, 3)),
        ("/add", binary, head + b"short"),
        ("/add", binary, b""),
        ("/add", "json", b'{"a": 13}'),
        ("/add", "json", b'{"a": "two"}'),
        ("/add", "json", b"nonsense"),
        ("/add", "xml", b"<a/>"),
        ("/switch", "json", b'{"data": true}'),
        ("/rosapi/topics", "json", b"{}"),
        ("/nothing", "json", b"{}"),
    ):
        name = encoding.encode()
        number = services.get(service, 9999)
        wire.say(struct.pack("<BIII", 2, number, 5, len(name)) + name + payload)
        wire.hear()


def _mistakes(transcript: Transcript, wire: Wire) -> None:
    transcript.title("mistakes")
    for frame in (
        "nonsense",
        "[]",
        "{}",
        '{"op":"fly"}',
        '{"op":42}',
        {"op": "subscribe"},
        {"op": "subscribe", "subscriptions": [{"id": -1, "channelId": 1}]},
        {"op": "subscribe", "subscriptions": "all"},
        {"op": "unsubscribe"},
        {"op": "advertise"},
        {"op": "advertise", "channels": [{"id": 1, "topic": "/x", "encoding": "xml", "schemaName": "y"}]},
        {"op": "advertise", "channels": [{"id": 1, "topic": "a b", "encoding": "json", "schemaName": ADD}]},
        {
            "op": "advertise",
            "channels": [{"id": 2, "topic": "/x", "encoding": "json", "schemaName": "no/No"}],
        },
        {
            "op": "advertise",
            "channels": [
                {"id": 3, "topic": "/pose", "encoding": "json", "schemaName": "std_msgs/String"},
            ],
        },
        {"op": "unadvertise", "channelIds": [77]},
        {"op": "getParameters"},
        {"op": "setParameters", "parameters": [{"value": 1}]},
        {"op": "fetchAsset", "uri": "file:///etc/passwd", "requestId": 1},
        {"op": "fetchAsset", "uri": "package://nothing/x", "requestId": 2},
        {"op": "fetchAsset"},
        b"",
        b"\x00",
        b"\x01\x00",
        b"\x09rest",
        struct.pack("<BI", 1, 77) + b"{}",
        b"\x02\x00",
        b"\x03\x00",
        struct.pack("<BBfBQI", 3, 0, 1.0, 0, 0, 1) + b"r",
    ):
        wire.say(frame)
        # Not all of them are answered; the request after each is.
        wire.say({"op": "getParameters", "parameterNames": ["/lab.label"], "id": "mark"})
        wire.hear_until('"id":"mark"')


def _publications(wire: Wire, channels: dict[str, int], binary: str) -> None:
    head = b"\0\1\0\0" if binary == "cdr" else b""
    number = channels["/cmd_vel"]
    wire.say({"op": "subscribe", "subscriptions": [{"id": 7, "channelId": number}]})
    about = {"topic": "/cmd_vel", "schemaName": "geometry_msgs/Twist"}
    offered = [{"id": 1, **about, "encoding": "json"}, {"id": 2, **about, "encoding": binary}]
    wire.say({"op": "advertise", "channels": offered})
    for channel, payload in (
        (1, b'{"linear": {"x": 0.5}}'),
        (2, head + struct.pack("<6d", 1, 2, 3, 4, 5, 6)),
        (1, b'{"linear": {"x": "fast"}}'),
        (1, b"nonsense"),
        (2, head + b"short"),
    ):
        wire.say(struct.pack("<BI", 1, channel) + payload)
        wire.hear()
    wire.say({"op": "advertise", "channels": offered[:1]})
    wire.hear()
    wire.say({"op": "unadvertise", "channelIds": [1, 2]})
    wire.say({"op": "getParameters", "parameterNames": ["/lab.label"], "id": "mark"})
    wire.hear_until('"id":"mark"')


def http_api(transcript: Transcript) -> None:
    """Record the resources below `/api`, and the server's pages."""
    with serving("--script", str(ROBOT)) as url:
        api = Http(transcript, url)
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
        # Without its headers: the length of the body varies.
        transcript.add(Http(Transcript("unused"), url).request("GET", "/healthz")[1])
        transcript.title("forms")
        cbor = {"Accept": "application/cbor"}
        api.request("GET", "/api/topics/map_name", headers=cbor)
        api.request("GET", "/api/topics/map_name", headers={"Accept": "text/plain"})
        headers, _ = api.request("GET", "/api/services")
        api.request("GET", "/api/services", headers={"If-None-Match": headers["ETag"]})
        api.request("HEAD", "/api/services")
        api.request("OPTIONS", "/api/services")
        api.request("GET", "/api/services", headers={"Origin": "https://evil.example"})
        api.request("GET", "/api/services", headers={"Origin": "http://localhost:8000"})
        api.request("GET", "/api/services", headers={"Host": "robot.example"})
        transcript.title("publish")
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
        transcript.title("calls")
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
        api.request("POST", "/api/services/add", '{"a": 1}', cbor)
        transcript.title("goals")
        headers, _ = api.request("POST", "/api/actions/dock/goals", '{"order": 3}')
        events = {"Accept": "text/event-stream"}
        api.request("GET", headers["Location"], headers=events, events=4)
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
        transcript.title("parameters")
        for value in ("0.75", '"text"', "nonsense", '{"a": 1}', "null"):
            api.request("PUT", "/api/parameters/lab:max_speed", value)
        api.request("PUT", "/api/parameters/nobody:x", "1")
        api.request("DELETE", "/api/parameters/lab:label")
        api.request("DELETE", "/api/parameters/lab:nothing")
        transcript.title("events")
        api.request("GET", "/api/topics/map_name", headers=events, events=1)
        api.request("GET", "/api/topics/map_name?throttle=-1", headers=events)
        api.request("GET", "/api/topics/map_name?queue=0", headers=events)
        api.request("GET", "/api/topics/nothing", headers=events)
        transcript.title("pages, without their bodies, which hold figures")
        for path in ("/", "/index", "/stream_viewer?topic=/x"):
            api.request("GET", path, headers={"Accept": "text/html"}, show=False)
        api.request("GET", "/api", headers={"Accept": "text/html"}, show=False)
        transcript.title("requests that are none")
        raw_exchange(transcript, url, b"nonsense\r\n\r\n")
        raw_exchange(transcript, url, b"GET /version HTTP/1.1\r\n\r\n")
        raw_exchange(
            transcript, url, b"GET /version HTTP/3.0\r\nHost: localhost\r\nConnection: close\r\n\r\n"
        )
        refused(transcript, url, {"Origin": "https://evil.example"})
        refused(transcript, url, {"Host": "robot.example"})


def openapi(transcript: Transcript) -> None:
    """Record the description of the HTTP gateway."""
    with serving("--script", str(ROBOT), "--set", "nodes=rosapi") as url:
        headers, text = Http(Transcript("unused"), url).request("GET", "/api/openapi.json")
        transcript.add(f"content-type: {headers['Content-Type']}")
        # One line for each path and each schema, in the order of the document.
        document: dict[str, Any] = json.loads(text)
        for part, value in document.items():
            members = value.get("schemas", value) if isinstance(value, dict) else {"": value}
            for name, member in members.items():
                transcript.add(f"{part} {name} {json.dumps(member, separators=(',', ':'))}")


_ASKED: Final = {
    "Content-Type": "application/json",
    "Accept": "application/json, text/event-stream",
}
_NEWEST: Final = "2026-07-28"
_META: Final = {
    "io.modelcontextprotocol/protocolVersion": _NEWEST,
    "io.modelcontextprotocol/clientCapabilities": {},
}


def mcp(transcript: Transcript) -> None:
    """Record what agents are told, in an older version of MCP and in the newest."""
    arguments = (
        "--script",
        str(ROBOT),
        "--set",
        "gateways=mcp,http",
        "--set",
        "nodes=rosapi",
        "--set",
        "mcp.default_role=admin",
    )
    with serving(*arguments) as url:
        agent = Http(transcript, url)
        transcript.title("2025-06-18")
        asked = {
            "protocolVersion": "2025-06-18",
            "capabilities": {},
            "clientInfo": {"name": "trace", "version": "1"},
        }
        headers, _ = _post(agent, "initialize", asked)
        session = {"Mcp-Session-Id": headers["Mcp-Session-Id"], "Mcp-Protocol-Version": "2025-06-18"}
        quiet = json.dumps({"jsonrpc": "2.0", "method": "notifications/initialized"})
        agent.request("POST", "/mcp", quiet, {**_ASKED, **session})
        _questions(partial(_post, agent, headers=session))
        agent.request("DELETE", "/mcp", headers=session)
        _post(agent, "tools/list", {}, headers=session)
        transcript.title(_NEWEST)

        def newest(method: str, params: dict[str, Any]) -> None:
            name = str(params.get("name") or params.get("uri") or "")
            named = {"Mcp-Name": name} if name else {}
            headers = {"Mcp-Protocol-Version": _NEWEST, "Mcp-Method": method, **named}
            _post(agent, method, {"_meta": _META, **params}, headers=headers)

        newest("server/discover", {})
        _questions(newest)
        transcript.title("requests that are none")
        for body in ("", "nonsense", "[]", "{}", '{"jsonrpc":"1.0"}', '{"jsonrpc":"2.0","id":1}'):
            agent.request("POST", "/mcp", body, _ASKED)
        agent.request("GET", "/mcp")
        agent.request("PUT", "/mcp", "{}", _ASKED)
        agent.request("POST", "/mcp", "{}", {"Content-Type": "text/plain"})


def _post(
    agent: Http, method: str, params: dict[str, Any], headers: dict[str, str] | None = None
) -> tuple[Any, str]:
    body = json.dumps({"jsonrpc": "2.0", "id": 1, "method": method, "params": params})
    return agent.request("POST", "/mcp", body, {**_ASKED, **(headers or {})})


def _questions(ask: Any) -> None:
    for method in ("tools/list", "resources/list", "resources/templates/list", "prompts/list", "nothing"):
        ask(method, {})
    for tool, arguments in (
        ("list_robot", {}),
        ("describe_type", {"type": "geometry_msgs/Twist"}),
        ("describe_type", {"type": "nothing/Nothing"}),
        ("read_topic", {"topic": "/map_name"}),
        ("read_topic", {"topic": "/nothing"}),
        ("read_topic", {}),
        ("read_topic", {"topic": 42}),
        ("publish", {"topic": "/cmd_vel", "message": {"linear": {"x": 0.5}}}),
        ("publish", {"topic": "/cmd_vel", "message": {"speed": 1}}),
        ("call_service", {"service": "/add", "request": {"a": 2, "b": 3}}),
        ("call_service", {"service": "/add", "request": {"a": 13}}),
        ("call_service", {"service": "/nothing"}),
        ("get_parameter", {"name": "/lab:max_speed"}),
        ("get_parameter", {"name": "/lab:nothing"}),
        ("set_parameter", {"name": "/lab:max_speed", "value": 0.75}),
        ("send_goal", {"action": "/dock", "goal": {"order": 3}}),
        ("send_goal", {"action": "/deny"}),
        ("send_goal", {"action": "/nothing"}),
        ("check_goal", {"goal_id": "nothing"}),
        ("look_up_transform", {"target": "map", "source": "base", "timeout": 0.05}),
        ("fly", {}),
    ):
        ask("tools/call", {"name": tool, "arguments": arguments})
    for uri in ("robot://overview", "robot://types/std_msgs/String", "robot://nothing", "file:///etc/passwd"):
        ask("resources/read", {"uri": uri})
    ask("prompts/get", {"name": "nothing"})


SESSIONS: Final[dict[str, Session]] = {
    "foxglove.jazzy": partial(foxglove, distro="jazzy"),
    "foxglove.noetic": partial(foxglove, distro="noetic"),
    "http.api": http_api,
    "http.openapi": openapi,
    "mcp": mcp,
}
