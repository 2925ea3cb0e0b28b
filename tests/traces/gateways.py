"""Sessions of Foxglove's protocol and of MCP."""

from __future__ import annotations

import json
import struct
from functools import partial
from typing import Any, Final

from tests.traces.rosbridge import ADD, ROBOT
from tests.traces.transcript import Session, Transcript
from tests.traces.wires import Http, Wire, serving


def foxglove(transcript: Transcript) -> None:
    """Record Foxglove's protocol."""
    # The first client stays to the end: channels get other ids once the last client has gone.
    with (
        serving("--script", str(ROBOT), "--set", "nodes=rosapi") as url,
        Wire(transcript, "v1", url, ["foxglove.websocket.v1"]) as v1,
    ):
        transcript.title("foxglove.websocket.v1")
        transcript.add(v1.head)
        with Wire(transcript, "sdk", url, ["foxglove.sdk.v1"]) as sdk:
            transcript.title("foxglove.sdk.v1")
            transcript.add(sdk.head)
            channels, services = _catalogue(sdk)
            _parameters(transcript, sdk)
            _channels(transcript, sdk, channels)
            _calls(transcript, sdk, services)
            _mistakes(transcript, sdk)
        with Wire(transcript, "writer", url, ["foxglove.sdk.v1"]) as writer:
            transcript.title("channels of a client")
            writer.redirect(Transcript("unused"))
            channels, _ = _catalogue(writer)
            writer.redirect(transcript)
            _publications(writer, channels)


def foxglove_noetic(transcript: Transcript) -> None:
    """Record the forms of ROS 1 in Foxglove's protocol."""
    with (
        serving("--script", str(ROBOT), "--distro", "noetic", "--set", "nodes=rosapi") as url,
        Wire(transcript, "sdk", url, ["foxglove.sdk.v1"]) as sdk,
    ):
        channels, services = _catalogue(sdk)
        for name in ("/lab.max_speed", "/lab/max_speed"):
            sdk.say({"op": "getParameters", "parameterNames": [name], "id": "get"})
            sdk.hear_until('"parameterValues"')
        sdk.say({"op": "subscribe", "subscriptions": [{"id": 1, "channelId": channels["/map_name"]}]})
        sdk.hear()
        for encoding, payload in (
            (b"json", b'{"a": 2, "b": 3}'),
            (b"ros1", struct.pack("<qq", 2, 3)),
            (b"ros1", b"short"),
            (b"cdr", b""),
        ):
            sdk.say(struct.pack("<BIII", 2, services["/add"], 5, len(encoding)) + encoding + payload)
            sdk.hear()
        sdk.say({"op": "subscribe", "subscriptions": [{"id": 7, "channelId": channels["/cmd_vel"]}]})
        channel = {"id": 2, "topic": "/cmd_vel", "schemaName": "geometry_msgs/Twist", "encoding": "ros1"}
        sdk.say({"op": "advertise", "channels": [channel]})
        sdk.say(struct.pack("<BI6d", 1, 2, 1, 2, 3, 4, 5, 6))
        sdk.hear()


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


def _calls(transcript: Transcript, wire: Wire, services: dict[str, int]) -> None:
    transcript.title("calls")
    head = b"\0\1\0\0"
    for service, encoding, payload in (
        ("/add", "json", b'{"a": 2, "b": 3}'),
        ("/add", "cdr", head + struct.pack("<qq", 2, 3)),
        ("/add", "cdr", head + b"short"),
        ("/add", "cdr", b""),
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


def _publications(wire: Wire, channels: dict[str, int]) -> None:
    head = b"\0\1\0\0"
    number = channels["/cmd_vel"]
    wire.say({"op": "subscribe", "subscriptions": [{"id": 7, "channelId": number}]})
    about = {"topic": "/cmd_vel", "schemaName": "geometry_msgs/Twist"}
    offered = [{"id": 1, **about, "encoding": "json"}, {"id": 2, **about, "encoding": "cdr"}]
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
        newest("nothing", {})
        newest("tools/call", {"name": "list_robot", "arguments": {}})
        newest("tools/call", {"name": "fly", "arguments": {}})
        newest("resources/read", {"uri": "robot://types/std_msgs/String"})
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
    # The lists of what there is are in docs/reference/agents.md.
    show = not method.endswith("/list")
    return agent.request("POST", "/mcp", body, {**_ASKED, **(headers or {})}, show=show)


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
    "foxglove": foxglove,
    "foxglove.noetic": foxglove_noetic,
    "mcp": mcp,
}
