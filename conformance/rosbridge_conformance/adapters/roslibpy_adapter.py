"""Adapter of roslibpy for the rosbridge conformance suite; requires only roslibpy.

    rosbridge-conformance client --target roslibpy -- python roslibpy_adapter.py

Commands come as JSON lines on standard input; answers and events go to standard output.
"""

from __future__ import annotations

import json
import logging
import sys
import threading
import time
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

import roslibpy
import roslibpy.ros1.actionlib as actionlib
import roslibpy.tf

#: Commands, messages and the library's objects, which are untyped.
Value = Any

_SECONDS = 5.0

#: Method of each query, and the field of the response with the answer.
_QUESTIONS = {
    "topics": ("get_topics", "topics"),
    "topic_type": ("get_topic_type", "type"),
    "topics_for_type": ("get_topics_for_type", "topics"),
    "services": ("get_services", "services"),
    "service_type": ("get_service_type", "type"),
    "services_for_type": ("get_services_for_type", "services"),
    "nodes": ("get_nodes", "nodes"),
    "params": ("get_params", "names"),
    "action_servers": ("get_action_servers", "action_servers"),
    "message_details": ("get_message_details", "typedefs"),
}
_OUTPUT = threading.Lock()


class Unsupported(Exception):
    """The library has no such call; the text names it."""


def say(line: dict[str, Value]) -> None:
    """Write one line of JSON."""
    with _OUTPUT:
        sys.stdout.write(json.dumps(line, default=_plain) + "\n")
        sys.stdout.flush()


def _plain(value: Value) -> Value:
    return dict(value) if hasattr(value, "keys") else str(value)


def event(name: str, of: str, **more: Value) -> None:
    """Report an event of the library."""
    say({"event": name, "of": of, **more})


class Complaints(logging.Handler):
    """Handler that collects what the library logs as an error."""

    def emit(self, record: logging.LogRecord) -> None:
        """Report one log record."""
        cause = f": {record.exc_info[1]!r}" if record.exc_info else ""
        say({"event": "complaint", "text": record.getMessage() + cause})


class Adapter:
    """Commands of the line protocol, one method each."""

    def __init__(self) -> None:
        self._ros: Value = None
        self._made: dict[str, Value] = {}

    # The connection

    def connect(self, url: str, wait: bool = True) -> None:
        """Open a new connection, and reset all state."""
        self._made = {}
        ros = self._ros = roslibpy.Ros(url)
        ros.on("close", lambda _: say({"event": "closed"}))
        if wait:
            ros.run(timeout=_SECONDS)
        else:
            ros.factory.manager.run()

    def reconnect(self, url: str) -> None:
        """No-op: the library reconnects on its own."""
        deadline = time.monotonic() + 2 * _SECONDS
        while not self._ros.is_connected:
            if time.monotonic() > deadline:
                raise TimeoutError("it did not connect again")
            time.sleep(0.02)

    def close(self) -> None:
        """Disconnect without reconnecting."""
        ros, self._ros = self._ros, None
        if ros is None:
            return
        ros.factory.stopTrying()
        if ros.is_connected:
            closed = threading.Event()
            ros.on("close", lambda _: closed.set())
            ros.close(timeout=_SECONDS)
            closed.wait(_SECONDS)

    # Topics

    def _topic(self, topic: str, type: str | None = None, **options: Value) -> Value:
        for name in ("fragment_size", "qos"):
            if name in options:
                raise Unsupported(f"topics have no option {name}")
        if options.get("compression", "none") not in roslibpy.Topic.SUPPORTED_COMPRESSION_TYPES:
            raise Unsupported(f"no compression {options['compression']}")
        return roslibpy.Topic(self._ros, topic, type, **options)

    def subscribe(self, **options: Value) -> None:
        """Subscribe, and report every message."""
        name = options.pop("as")
        self._made[name] = self._topic(**options)
        self._made[name].subscribe(lambda value: event("message", name, value=value))

    def unsubscribe(self, of: str) -> None:
        """Unsubscribe."""
        self._made[of].unsubscribe()

    def advertise(self, **options: Value) -> None:
        """Advertise."""
        name = options.pop("as")
        self._made[name] = self._topic(**options)
        self._made[name].advertise()

    def unadvertise(self, of: str) -> None:
        """Unadvertise."""
        self._made[of].unadvertise()

    def publish(self, msg: Value, of: str = "", topic: str = "", type: str = "") -> None:
        """Publish on an advertised topic, or on another one."""
        publisher = self._made[of] if of else self._topic(topic, type)
        publisher.publish(roslibpy.Message(msg))

    # Services

    def _call(self, name: str, service: str, type: str | None, args: Value) -> None:
        roslibpy.Service(self._ros, service, type).call(roslibpy.ServiceRequest(args), *_tells_response(name))

    def call_service(self, service: str, type: str | None = None, args: Value = None, **more: Value) -> None:
        """Call a service; the response is an event."""
        name = more.pop("as")
        for option in more:
            raise Unsupported(f"calls that do not block have no {option}")
        self._call(name, service, type, args)

    def advertise_service(self, service: str, type: str, answer: Value = None, **more: Value) -> None:
        """Offer a service with a constant response."""
        name, said = more["as"], answer or {}

        def handle(request: Value, response: Value) -> bool:
            event("request", name, value=request)
            if "throw" in said:
                raise RuntimeError(said["throw"])
            response.update(said.get("values", {}))
            return bool(said.get("result", True))

        self._made[name] = roslibpy.Service(self._ros, service, type)
        self._made[name].advertise(handle)

    def unadvertise_service(self, of: str) -> None:
        """Withdraw a service."""
        self._made[of].unadvertise()

    # Actions

    def send_goal(
        self, action: str, type: str, args: Value = None, feedback: bool = True, **more: Value
    ) -> None:
        """Send a goal; feedback and result are events."""
        name = more["as"]
        if not feedback:
            raise Unsupported("goals always ask for feedback")
        client = roslibpy.ActionClient(self._ros, action, type)
        goal = client.send_goal(
            roslibpy.Goal(args),
            lambda end: event("result", name, value=end["values"], status=end["status"].value),
            lambda value: event("feedback", name, value=value),
            lambda end: event("failed", name, error=end["values"]),
        )
        self._made[name] = lambda: client.cancel_goal(goal)

    def cancel_goal(self, of: str) -> None:
        """Cancel a goal."""
        self._made[of]()

    def actionlib_goal(self, server: str, type: str, goal: Value, **more: Value) -> None:
        """Send a goal over topics; the library waits for a first status before it sends."""
        name = more["as"]

        def send() -> None:
            sent = actionlib.Goal(actionlib.ActionClient(self._ros, server, type), roslibpy.Message(goal))
            sent.on("feedback", lambda value: event("feedback", name, value=value))
            sent.on("result", lambda value: event("result", name, value=value, status=sent.status["status"]))
            self._made[name] = sent
            sent.send()

        threading.Thread(target=send, daemon=True).start()

    def actionlib_cancel(self, of: str) -> None:
        """Cancel a goal over topics."""
        self._made[of].cancel()

    def actionlib_serve(self, server: str, type: str, answer: Value = None, **more: Value) -> None:
        """Serve goals over topics."""
        name, said = more["as"], answer or {}
        if said.get("end") == "abort":
            raise Unsupported("its action server cannot abort")
        serving = actionlib.SimpleActionServer(self._ros, server, type)

        def work(goal: Value) -> None:
            event("goal", name, value=goal)
            for feedback in said.get("feedback", []):
                serving.send_feedback(feedback)
            if said.get("end") != "wait":
                serving.set_succeeded(said.get("values", {}))

        def stop() -> None:
            event("cancel", name)
            serving.set_preempted()

        serving.on("cancel", stop)
        serving.start(work)

    def tf_subscribe(self, fixed_frame: str, frame: str, **more: Value) -> None:
        """Request a transform."""
        name = more["as"]
        client = roslibpy.tf.TFClient(self._ros, fixed_frame)
        client.subscribe(frame, lambda value: event("transform", name, value=value))

    # rosapi, status, authentication

    def get_param(self, name: str, **more: Value) -> None:
        """Read a parameter."""
        roslibpy.Param(self._ros, name).get(*_tells_response(more["as"]))

    def set_param(self, name: str, value: Value, **more: Value) -> None:
        """Set a parameter."""
        roslibpy.Param(self._ros, name).set(value, *_tells_response(more["as"]))

    def delete_param(self, name: str, **more: Value) -> None:
        """Delete a parameter."""
        roslibpy.Param(self._ros, name).delete(*_tells_response(more["as"]))

    def ask(self, what: str, of_what: str | None = None, **more: Value) -> None:
        """Query rosapi by the library's own method."""
        if what not in _QUESTIONS:
            raise Unsupported(f"no question {what}")
        method, key = _QUESTIONS[what]
        given = [] if of_what is None else [of_what]
        answered, failed = _tells_response(more["as"])
        # Some methods pass the whole response to their callback, some only the requested field.
        getattr(self._ros, method)(
            *given, lambda value: answered(value[key] if hasattr(value, "keys") else value), failed
        )

    def set_level(self, level: str, id: str | None = None) -> None:
        """Set the level of status messages."""
        self._ros.set_status_level(level, id)

    def authenticate(self, **given: Value) -> None:
        """Authenticate."""
        names = ("mac", "client", "dest", "rand", "t", "level", "end")
        self._ros.authenticate(*(given[name] for name in names))


def _tells_response(name: str) -> tuple[Callable[[Value], None], Callable[[Value], None]]:
    return (
        lambda value: event("response", name, value=value),
        lambda error: event("failed", name, error=error),
    )


def answer(adapter: Adapter, command: dict[str, Value]) -> dict[str, Value]:
    """Execute one command."""
    name = command.pop("do")
    what = getattr(adapter, name, None)
    if what is None:
        return {"unsupported": f"no call for {name}"}
    try:
        what(**command)
    except Unsupported as error:
        return {"unsupported": str(error)}
    except Exception as error:  # Whatever the library raises is the suite's to judge.
        return {"error": repr(error)}
    return {"ok": True}


def main() -> None:
    """Execute commands until standard input ends."""
    logging.basicConfig(level=logging.ERROR, handlers=[Complaints()])
    adapter = Adapter()
    say({"event": "ready", "library": "roslibpy", "version": version("roslibpy")})
    for line in sys.stdin:
        command = json.loads(line)
        number = command.pop("n")
        say({"n": number, **answer(adapter, command)})


if __name__ == "__main__":
    main()
