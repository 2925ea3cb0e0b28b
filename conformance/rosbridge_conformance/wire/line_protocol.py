"""Commands to a client library's program, as lines of JSON (docs/how-to/conformance.md)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

COMMANDS: Final[Mapping[str, tuple[str, ...]]] = {
    "connect": ("url", "wait"),
    "reconnect": ("url",),
    "close": (),
    "subscribe": (
        "as", "topic", "type", "throttle_rate", "queue_length", "fragment_size", "compression", "qos",
    ),
    "unsubscribe": ("of",),
    "advertise": ("as", "topic", "type", "latch", "queue_size", "qos"),
    "publish": ("of", "topic", "type", "msg"),
    "unadvertise": ("of",),
    "call_service": ("as", "service", "type", "args", "timeout", "fragment_size"),
    "advertise_service": ("as", "service", "type", "answer"),
    "unadvertise_service": ("of",),
    "send_goal": ("as", "action", "type", "args", "feedback"),
    "cancel_goal": ("of",),
    "advertise_action": ("as", "action", "type", "answer"),
    "unadvertise_action": ("of",),
    "actionlib_goal": ("as", "server", "type", "goal"),
    "actionlib_cancel": ("of",),
    "actionlib_serve": ("as", "server", "type", "answer"),
    "tf_subscribe": ("as", "fixed_frame", "frame"),
    "get_param": ("as", "name"),
    "set_param": ("as", "name", "value"),
    "delete_param": ("as", "name"),
    "ask": ("as", "what", "of_what"),
    "set_level": ("level", "id"),
    "authenticate": ("mac", "client", "dest", "rand", "t", "level", "end"),
}  # fmt: skip
"""Commands and their keys. `as` names a new object, `of` refers to an existing one."""

EVENTS: Final[Mapping[str, tuple[str, ...]]] = {
    "message": ("of", "value"),
    "response": ("of", "value"),
    "failed": ("of", "error"),
    "request": ("of", "value"),
    "feedback": ("of", "value"),
    "result": ("of", "value", "status"),
    "goal": ("of", "value"),
    "cancel": ("of",),
    "transform": ("of", "value"),
    "status": ("level", "msg", "id"),
    "closed": (),
    "complaint": ("text",),
    "uncaught": ("text",),
}
"""Events of a program, and their keys besides `event`."""

ASIDE: Final = ("status", "closed", "complaint", "uncaught")
"""Events that may occur at any time; only steps that expect them receive them.

A library reports errors as `complaint`; an unhandled exception is `uncaught`, with which a
case is non-strict at best.
"""
