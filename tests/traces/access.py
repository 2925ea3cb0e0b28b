"""Sessions of servers that refuse: by role, by token, by limit and by the gate."""

from __future__ import annotations

import hashlib
import json
import tempfile
import time
from pathlib import Path
from typing import Any, Final

from rwt.access.gate.node import PUBLISH_SECONDS
from tests.traces.rosbridge import ADD, FIBONACCI, NEXT, ROBOT
from tests.traces.transcript import Session, Transcript
from tests.traces.wires import Http, Wire, raw_exchange, refused, serving

_TOKENS: Final = "\n".join(
    f'[auth.tokens.{role}]\ntoken = "{role}-token-of-the-trace"\nrole = "{role}"\n'
    for role in ("admin", "driver", "agent", "viewer")
)
_ROLES: Final = (
    _TOKENS
    + """
[roles.driver]
subscribe = ["/open*", "/pose"]
publish = ["/open*", "/cmd_vel"]
call = ["/add"]
goals = ["/dock"]
provide = ["/open*"]
get_param = ["/lab:max_speed"]

[roles.agent]
read_only = true
call = ["/switch"]
"""
)
_GATE: Final = (
    'gateways = ["http", "foxglove"]\n\n'
    + _TOKENS
    + """
[roles.driver]
subscribe = ["*"]
publish = ["*"]
call = ["*"]
goals = ["*"]
set_param = ["*"]
get_param = ["*"]

[roles.agent]
subscribe = ["*"]
publish = ["*"]
call = ["*"]
goals = ["*"]

[gate.audit]
file = "audit.jsonl"

[gate.rules.drive]
topics = ["/cmd_vel"]
emergency = true
lease = { seconds = 60, precedence = ["admin"] }
stop = { repeat_seconds = 0 }

[gate.rules.drive.fields]
"linear.x" = { min = -0.3, max = 0.8, beyond = "clamp" }
"linear.y" = { min = 0, max = 0 }
"angular.z" = { max = 1.5 }

[gate.rules.served]
topics = ["/served"]
type = "std_msgs/String"
lease = { seconds = 60, take = "service" }
stop = {}

[gate.rules.rate]
topics = ["/rate"]
messages_per_second = 1

[gate.rules.frames]
topics = ["/frames"]
type = "std_msgs/Header"

[gate.rules.frames.fields]
"frame_id" = { one_of = ["map", "odom"] }

[gate.rules.size]
topics = ["/size"]
largest_bytes = 20

[gate.rules.asked]
services = ["/switch"]
approval = { roles = ["admin"], seconds = 60, remember_seconds = 60 }

[gate.rules.asked_too]
topics = ["/asked"]
approval = { roles = ["admin"], seconds = 60 }

[gate.rules.sums]
services = ["/add"]
emergency = true

[gate.rules.sums.fields]
"a" = { max = 100 }

[gate.rules.goals]
actions = ["/dock"]
emergency = true

[gate.rules.goals.fields]
"order" = { max = 10 }

[gate.rules.parameters]
parameters = ["/lab:label"]
approval = { roles = ["admin"], seconds = 60 }
"""
)
_LEVEL: Final = {"op": "set_level", "level": "info", "id": "level"}


def _token(role: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {role}-token-of-the-trace"}


def roles(transcript: Transcript) -> None:
    """Record what roles are refused, and who is let in."""
    with tempfile.TemporaryDirectory(prefix="traces-") as folder:
        settings = Path(folder, "roles.toml")
        settings.write_text(_ROLES)
        with serving("--script", str(ROBOT), "--config", str(settings)) as url:
            transcript.title("tokens")
            refused(transcript, url)
            refused(transcript, url, {"Authorization": "Bearer of-nobody"})
            refused(transcript, f"{url}/?token=of-nobody")
            with Wire(transcript, "page", url, ["rwt", "bearer.viewer-token-of-the-trace"]) as page:
                transcript.add(page.head)
            with Wire(transcript, "query", f"{url}/?token=viewer-token-of-the-trace") as query:
                transcript.add(query.head)
            api = Http(transcript, url)
            transcript.title("a role that may do some things")
            driver = _token("driver")
            with Wire(transcript, "driver", url, headers=driver) as wire:
                _acts(wire)
            for path in ("/api/topics", "/api/services", "/api/parameters", "/api/topics/nothing"):
                api.request("GET", path, headers=driver)
            for path in ("/api/topics/closed", "/api/services/switch", "/api/actions/deny/goals"):
                api.request("POST", path, "{}", driver)
            api.request("PUT", "/api/parameters/lab:max_speed", "0.5", driver)
            with Wire(transcript, "driver", url, ["foxglove.sdk.v1"], driver) as wire:
                wire.redirect(Transcript("unused"))
                wire.hear()
                wire.redirect(transcript)
                _foxglove_acts(wire)
            transcript.title("what a page may ask of each role")
            for role in ("viewer", "agent", "driver", "admin"):
                api.request("GET", "/role", headers=_token(role))
            transcript.title("HTTP without a token")
            for path in ("/", "/api", "/metrics", "/version", "/nothing"):
                Http(transcript, url).request("GET", path)


def _acts(wire: Wire) -> None:
    text = "std_msgs/String"
    wire.ask(_LEVEL)
    for topic in ("/cmd_vel", "/closed"):
        wire.ask({"op": "advertise", "topic": topic, "type": text, "id": "ad"})
        wire.ask({"op": "publish", "topic": topic, "type": text, "msg": {"data": "x"}})
        wire.ask({"op": "subscribe", "topic": topic, "type": text})
    wire.ask({"op": "advertise_service", "service": "/offered", "type": "std_srvs/Trigger"})
    wire.ask({"op": "advertise_service", "service": "/add", "type": ADD})
    wire.ask({"op": "unadvertise_service", "service": "/add"})
    wire.ask({"op": "advertise_action", "action": "/offered_action", "type": FIBONACCI})
    for service, args in (
        ("/add", {}),
        ("/switch", {}),
        (f"{NEXT}/pose", {}),
        ("/lab/set_parameters", {}),
        ("/rosapi/topics", {}),
        ("/rosapi/get_param", {"name": "/lab:max_speed"}),
        ("/rosapi/get_param", {"name": "/lab:label"}),
        ("/rosapi/set_param", {"name": "/lab:label", "value": '"south"'}),
        ("/rosapi/get_param_names", {}),
    ):
        wire.say({"op": "call_service", "service": service, "id": "call", "args": args})
        wire.hear_until('"op":"service_response"')
        wire.settle()
    for action in ("/dock", "/deny"):
        wire.say({"op": "send_action_goal", "action": action, "action_type": FIBONACCI, "id": "goal"})
        wire.hear_until('"op":"action_result"')
        wire.settle()


def _foxglove_acts(wire: Wire) -> None:
    channel = {"topic": "/closed_channel", "encoding": "json", "schemaName": "std_msgs/String"}
    wire.say({"op": "advertise", "channels": [{"id": 1, **channel}]})
    wire.say({"op": "fly"})
    wire.hear_only('"op":"status"', "fly")


def rosauth(transcript: Transcript) -> None:
    """Record the op `auth`."""
    with tempfile.TemporaryDirectory(prefix="traces-") as folder:
        secret = Path(folder, "secret")
        secret.write_text("abcdefghijklmnop\n")
        secret.chmod(0o600)
        silent = Transcript("unused")
        with serving("--script", str(ROBOT), "--set", f"auth.rosauth_secret_file={secret}") as url:
            for name, frame in (
                ("another op", {"op": "subscribe", "topic": "/x"}),
                ("no message", "nonsense"),
                ("wrong mac", {"op": "auth", **_signed("x" * 16)}),
                ("old", {"op": "auth", **_signed(age=1000)}),
                ("ended", {"op": "auth", **_signed(lasts=-1)}),
                ("missing member", {"op": "auth", "mac": "x"}),
            ):
                transcript.title(name)
                with Wire(silent, "a", url) as wire:
                    wire.say(frame)
                    wire.redirect(transcript)
                    wire.hear_close()
            transcript.title("let in")
            good = {"op": "auth", **_signed()}
            with Wire(silent, "a", url) as wire:
                wire.say(good)
                wire.redirect(transcript)
                wire.ask({"op": "call_service", "service": "/nothing"})
            transcript.title("the same again")
            with Wire(silent, "a", url) as wire:
                wire.say(good)
                wire.redirect(transcript)
                wire.hear_close()


def _signed(secret: str = "abcdefghijklmnop", age: int = 0, lasts: int = 60) -> dict[str, Any]:
    start = int(time.time()) - age
    members = {
        "client": "c",
        "dest": "d",
        "rand": "r",
        "t": start,
        "level": "admin",
        "end": start + age + lasts,
    }
    text = secret + "".join(str(value) for value in members.values())
    return {"mac": hashlib.sha512(text.encode()).hexdigest(), **members}


def limits(transcript: Transcript) -> None:
    """Record what a client is told where it meets a limit."""
    text = "std_msgs/String"
    small = {
        "limits.subscriptions": 2,
        "limits.advertisements": 2,
        "limits.calls": 1,
        "limits.kept_bytes": 1024,
        "limits.parameter_bytes": 1024,
        "limits.max_depth": 10,
        "limits.structure_bytes": 4096,
        "limits.fragmented_messages": 2,
        "limits.fragment_characters": 100,
        "limits.outgoing_message_bytes": 2000,
        "max_message_size": 6000,
    }
    options = [word for key, value in small.items() for word in ("--set", f"{key}={value}")]
    with serving("--script", str(ROBOT), *options) as url:
        with Wire(transcript, "a", url) as a:
            a.ask(_LEVEL)
            for number in range(3):
                a.ask({"op": "subscribe", "topic": f"/s{number}", "type": text, "id": number})
                a.ask({"op": "advertise", "topic": f"/s{number}", "type": text, "id": number})
            a.ask({"op": "advertise_service", "service": "/v", "type": "std_srvs/Trigger"})
            a.ask({"op": "advertise_action", "action": "/w", "type": FIBONACCI})
            never = {"op": "call_service", "service": "/add", "args": {"a": 14}}
            a.say({**never, "id": "first", "timeout": 0})
            a.say({**never, "id": "second"})
            a.hear_until('"id":"second"')
            a.say({"op": "send_action_goal", "action": "/wait", "action_type": FIBONACCI, "id": "third"})
            a.hear_until('"id":"third"')
            deep: Any = 1
            for _ in range(12):
                deep = {"a": deep}
            a.ask({"op": "publish", "topic": "/s0", "msg": deep, "id": "deep"})
            a.ask('{"op":"publish","topic":"/s0","id":"brackets","msg":{"data":' + "[]," * 1500 + "[]}}")
            a.ask({"op": "publish", "id": "long", "topic": "/s0", "msg": {"data": "x" * 7000}})
            for number in range(3):
                cut = {"op": "fragment", "id": f"f{number}", "num": 0, "total": 2}
                a.ask({**cut, "data": "x" * (10 if number else 150)})
            a.ask({"op": "call_service", "service": "/unknown", "id": "y" * 1200, "args": {}})
        with Wire(transcript, "b", url) as b:
            b.ask(_LEVEL)
            b.ask({"op": "advertise", "topic": "/kept", "type": text, "latch": True})
            b.ask({"op": "publish", "topic": "/kept", "msg": {"data": "x" * 1500}})
            b.say(
                {
                    "op": "call_service",
                    "service": "/rosapi/set_param",
                    "id": "p",
                    "args": {"name": "/lab:label", "value": json.dumps("x" * 1500)},
                }
            )
            b.hear_until('"id":"p"')
            b.ask({"op": "subscribe", "topic": "/big", "type": text})
            b.ask({"op": "publish", "topic": "/big", "type": text, "msg": {"data": "x" * 2500}})
        with Wire(transcript, "c", url) as c:
            c.say(b"x" * 7000)
            c.hear_close()
        api = Http(transcript, url)
        raw_exchange(
            transcript,
            url,
            b"POST /api/services/add HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n"
            b"Content-Length: 2000000\r\n\r\n",
        )
        api.request("POST", "/api/topics/big", '{"data": "' + "x" * 5000 + '"}')
    hurried = ("limits.messages_per_second=1", "limits.messages_burst=3", "limits.connections=1")
    options = [word for setting in hurried for word in ("--set", setting)]
    with serving(*options) as url, Wire(transcript, "d", url) as d:
        refused(transcript, url)
        for _ in range(8):
            d.say({"op": "set_level", "level": "none"})
        d.hear_close()


def gate(transcript: Transcript) -> None:
    """Record what the gate refuses over each protocol, and its audit."""
    with tempfile.TemporaryDirectory(prefix="traces-") as folder:
        settings = Path(folder, "gate.toml")
        settings.write_text(_GATE)
        with (
            serving("--script", str(ROBOT), "--config", str(settings), folder=Path(folder)) as url,
            Wire(transcript, "admin", url, headers=_token("admin")) as admin,
            Wire(transcript, "driver", url, headers=_token("driver")) as driver,
            Wire(transcript, "agent", url, headers=_token("agent")) as agent,
            Wire(transcript, "viewer", url, headers=_token("viewer")) as viewer,
        ):
            for wire in (admin, driver, agent):
                wire.ask(_LEVEL)
            _show(viewer, "/gate/stopped", "/gate/leases", "/gate/approvals")
            _limits_of_fields(transcript, driver)
            _leases(transcript, driver, agent, admin, viewer)
            _approvals(transcript, driver, admin, viewer)
            _other_gateways(transcript, url)
            # What nobody has answered would be denied when its client goes, in any order.
            _called(admin, "/gate/approve", id="3", approve=True)
            _called(admin, "/gate/approve", id="4", approve=False)
            _stop(transcript, driver, agent, admin, url)
            _show(viewer, "/gate/stopped", "/gate/leases", "/gate/approvals")
        transcript.title("audit")
        transcript.add(Path(folder, "audit.jsonl").read_text().rstrip("\n"))


def _show(wire: Wire, *topics: str) -> None:
    time.sleep(2 * PUBLISH_SECONDS)  # Of changes in short succession, the last one is published late.
    for topic in topics:
        wire.say({"op": "subscribe", "topic": topic})
        wire.hear()
        wire.say({"op": "unsubscribe", "topic": topic})


def _twist(**fields: Any) -> dict[str, Any]:
    return {"op": "publish", "id": "twist", "topic": "/cmd_vel", "type": "geometry_msgs/Twist", "msg": fields}


def _called(wire: Wire, service: str, **args: Any) -> Any:
    wire.say({"op": "call_service", "id": service, "service": service, "args": args})
    answer = wire.hear_until(f'"id":"{service}"')
    wire.settle()
    return json.loads(answer)


def _limits_of_fields(transcript: Transcript, wire: Wire) -> None:
    transcript.title("limits of fields")
    wire.ask(_twist(linear={"y": 1.0}), _twist(angular={"z": 2.0}), _twist(linear={"x": None}))
    header = "std_msgs/Header"
    for frame in ("map", "moon"):
        wire.ask({"op": "publish", "topic": "/frames", "type": header, "msg": {"frame_id": frame}})
    wire.ask({"op": "publish", "topic": "/size", "type": "std_msgs/String", "msg": {"data": "x" * 30}})
    for _ in range(3):
        wire.ask({"op": "publish", "topic": "/rate", "type": "std_msgs/String"})
    _called(wire, "/add", a=200)
    for order in (3, 20):
        goal = {"op": "send_action_goal", "action": "/dock", "action_type": FIBONACCI}
        wire.say({**goal, "id": "goal", "args": {"order": order}})
        wire.hear_until('"op":"action_result"')
        wire.settle()
    wire.ask({"op": "advertise", "topic": "/cmd_vel", "type": "geometry_msgs/Twist", "latch": True})
    wire.ask({"op": "publish", "topic": "/gate/stopped", "msg": {}})
    wire.ask({"op": "advertise_service", "service": "/gate/stop", "type": "rwt_gate_msgs/Stop"})


def _leases(transcript: Transcript, driver: Wire, agent: Wire, admin: Wire, viewer: Wire) -> None:
    transcript.title("leases")
    driver.ask(_twist(linear={"x": 0.5}), _twist(linear={"x": 2.0}))
    _show(viewer, "/gate/leases")
    agent.ask(_twist(linear={"x": 0.5}))
    served = {"op": "publish", "id": "s", "topic": "/served", "type": "std_msgs/String", "msg": {"data": "x"}}
    driver.ask(served)
    _called(driver, "/gate/take_lease", topic="/served")
    driver.ask(served)
    _called(agent, "/gate/take_lease", topic="/served")
    _called(agent, "/gate/take_lease", topic="/cmd_vel")
    _called(agent, "/gate/take_lease", topic="/no_rule")
    _called(agent, "/gate/release_lease", topic="/cmd_vel")
    _called(driver, "/gate/pass_lease", topic="/served", client="nobody")
    _called(driver, "/gate/pass_lease", topic="/served", to="nobody")
    _called(driver, "/gate/release_lease", topic="/served")
    _called(admin, "/gate/take_lease", topic="/cmd_vel")
    driver.ask(_twist(linear={"x": 0.5}))
    _called(admin, "/gate/release_lease", topic="/cmd_vel")


def _approvals(transcript: Transcript, driver: Wire, admin: Wire, viewer: Wire) -> None:
    transcript.title("approvals")
    for number, yes in ((1, True), (2, False)):
        call = {"op": "call_service", "id": f"switch {number}", "service": "/switch", "args": {"data": yes}}
        driver.say(call)
        driver.settle()
        _show(viewer, "/gate/approvals")
        _called(driver, "/gate/approve", id=str(number), approve=True)
        _called(admin, "/gate/approve", id=str(number), approve=yes)
        driver.hear()
    _called(admin, "/gate/approve", id="99", approve=True)
    asked = {"op": "publish", "id": "asked", "topic": "/asked", "type": "std_msgs/String", "msg": {}}
    driver.ask(asked, asked)


def _other_gateways(transcript: Transcript, url: str) -> None:
    transcript.title("HTTP")
    api = Http(transcript, url)
    driver = _token("driver")
    api.request("POST", "/api/topics/cmd_vel", '{"linear": {"y": 1}}', driver)
    api.request("POST", "/api/services/add", '{"a": 200}', driver)
    api.request("POST", "/api/actions/dock/goals", '{"order": 20}', driver)
    api.request("POST", "/api/topics/asked?type=std_msgs/String", "{}", driver)
    transcript.title("Foxglove")
    with Wire(transcript, "viewer", url, ["foxglove.sdk.v1"], driver) as viewer:
        viewer.redirect(Transcript("unused"))
        viewer.hear_until('"op":"advertiseServices"')
        viewer.redirect(transcript)
        channel = {"topic": "/size", "encoding": "json", "schemaName": "std_msgs/String"}
        viewer.say({"op": "advertise", "channels": [{"id": 1, **channel}]})
        viewer.say(b"\x01\x01\x00\x00\x00" + b'{"data": "' + b"x" * 40 + b'"}')
        viewer.hear_until('"op":"status"')


def _stop(transcript: Transcript, driver: Wire, agent: Wire, admin: Wire, url: str) -> None:
    transcript.title("emergency stop")
    driver.ask(_twist(linear={"x": 0.5}))
    wait = {"op": "send_action_goal", "action": "/dock", "action_type": FIBONACCI, "id": "running"}
    _called(agent, "/gate/stop", reason="somebody is in the way")
    driver.ask(_twist(linear={"x": 0.5}))
    _called(driver, "/add", a=1)
    driver.say(wait)
    driver.hear_until('"op":"action_result"')
    Http(transcript, url).request("POST", "/api/services/add", "{}", _token("driver"))
    _called(driver, "/gate/release_stop", reason="")
    _called(admin, "/gate/stop", reason="again")
    _called(admin, "/gate/release_stop", reason="clear")
    _called(admin, "/gate/release_stop", reason="twice")
    _called(driver, "/add", a=1)


def access(transcript: Transcript) -> None:
    """Record what servers refuse by token, role, op `auth`, limit and gate."""
    for session in (roles, rosauth, limits, gate):
        session(transcript)


SESSIONS: Final[dict[str, Session]] = {"access": access}
