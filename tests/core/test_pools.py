"""The table of shared pools is complete: each has a driver, and each limit of all clients is a pool."""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from types import MappingProxyType
from typing import Final

from pydantic import BaseModel

import rwt
import rwt_webrtc
from rwt import parts
from rwt.settings.models import settings_type
from tests.faults.isolation.greedy_clients import DRIVERS

SOURCES: Final = (Path(rwt.__file__).parents[1], Path(rwt_webrtc.__file__).parents[1])

NOT_SHARED: Final = MappingProxyType(
    {
        "limits.connections_per_address": "of one address",
        **dict.fromkeys(
            ("limits.subscriptions", "limits.advertisements", "limits.calls", "limits.kept_bytes",
             "limits.parameter_bytes", "limits.messages_per_second", "limits.messages_burst",
             "limits.fragmented_messages", "limits.fragment_characters", "limits.data_bytes",
             "limits.data_frames", "limits.control_bytes", "limits.control_frames"),
            "of one client, or of one address",
        ),
        **dict.fromkeys(
            ("limits.max_depth", "limits.structure_bytes", "limits.outgoing_message_bytes",
             "auth.message_bytes", "web.message_bytes", "max_message_size", "mcp.request_bytes",
             "recorder.recording_bytes"),
            "of one message, request or recording",
        ),
        "api.goals": "of one client",
        "mcp.requests_per_address": "of one address: the share of `mcp.requests` and `mcp.sessions`",
        "mcp.requests": "each address has a share of its own (mcp.requests_per_address)",
        "mcp.sessions": "each address has a share of its own (mcp.requests_per_address)",
        "mcp.goals": "each agent has a quarter; its own oldest is forgotten for it",
        "webrtc.channels": "of one peer",
        "webrtc.candidates": "of one peer",
        **dict.fromkeys(
            ("gate.audit.file_bytes", "gate.audit.files", "gate.audit.queue_bytes"),
            "lines of one source are written at its rate only (rwt.access.gate.record)",
        ),
        **dict.fromkeys(("workers", "zenoh.domain"), "not a limit of clients"),
    }
)  # fmt: skip
"""Numbers of the settings that are no limit of all clients together, with the reason."""


def _numbers(model: type[BaseModel], prefix: str = "") -> Iterator[str]:
    """Yield the keys of the settings that are whole numbers."""
    for name, field in model.model_fields.items():
        annotation = field.annotation
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            yield from _numbers(annotation, f"{prefix}{name}.")
        elif annotation is int:
            yield f"{prefix}{name}"


def test_each_pool_has_a_greedy_client() -> None:
    names = [row.name for row in parts.pools()]
    assert sorted(names) == sorted(set(names))
    assert set(names) == set(DRIVERS)


def test_each_row_of_the_source_is_in_the_table() -> None:
    found = [
        node.args[0].value
        for source in SOURCES
        for file in source.rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text("utf-8")))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id == "PoolRow"
        and isinstance(node.args[0], ast.Constant)
    ]
    assert sorted(set(found), key=str) == sorted({row.name for row in parts.pools()})


def test_each_limit_of_all_clients_is_a_pool() -> None:
    tables = frozenset((kind, name) for _, kind, name in parts.settings_keys())
    numbers = set(_numbers(settings_type(tables)))
    shared = {row.setting for row in parts.pools()} & numbers
    assert numbers - shared == set(NOT_SHARED)
    # The others are options of a command, or constants.
    assert {row.setting for row in parts.pools()} - shared == {
        "--waiting-bytes",
        "--connections",
        "--links",
        "--robots",
        "",
    }


NO_ROOM_OF_OTHERS: Final = MappingProxyType(
    {
        "rwt/extensions/asgi/application.py": ("the server is closing",),
        "rwt/extensions/hub/ends.py": ("the robot does not answer", "the robot is gone"),
        "rwt/extensions/hub/hub.py": ("the robot is unreachable", "its node is unreachable"),
        "rwt/extensions/hub/nodes/links.py": ("the robot is unreachable",),
        "rwt/extensions/mcp/gateway.py": ("the server is closing", "mcp.requests has shares of its own"),
        "rwt/extensions/video/server.py": ("the image cannot be made",),
        "rwt_webrtc/transport/signalling.py": ("a pool has taken the share", "the server is closing"),
    }
)
"""Refusals with 503 that no pool makes, with the reason of each."""


def test_each_refusal_for_want_of_room_is_of_a_pool() -> None:
    found: Counter[str] = Counter()
    for source in SOURCES:
        for file in source.rglob("*.py"):
            for node in ast.walk(ast.parse(file.read_text("utf-8"))):
                if (
                    isinstance(node, ast.Call)
                    and isinstance(node.func, ast.Name)
                    and node.func.id.endswith("Refused")
                    and node.args
                    and isinstance(node.args[0], ast.Constant)
                    and node.args[0].value == 503
                ):
                    found[str(file.relative_to(source))] += 1
    assert found == {file: len(reasons) for file, reasons in NO_ROOM_OF_OTHERS.items()}
