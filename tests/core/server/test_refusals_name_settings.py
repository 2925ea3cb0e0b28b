"""Whoever is refused hears which setting it met: each limit stands, by its whole name, in a refusal."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import rwt
from rwt.cli import parser_for
from rwt.settings.models import LimitSettings

SOURCE: Final = Path(rwt.__file__).parents[1]

REFUSE_NOTHING: Final = {
    **dict.fromkeys(("work_burst", "messages_burst"), "named with the rate that it belongs to"),
    **dict.fromkeys(("data_bytes", "data_frames"), "samples are dropped, and counted: nobody is refused"),
    "fragment_seconds": "pieces are forgotten, of which nobody asks any more",
    **dict.fromkeys(
        ("idle_http_seconds", "stalled_http_seconds", "ping_seconds", "pong_seconds", "idle_peer_seconds",
         "close_seconds"),
        "whoever is silent for so long is not told anything any more",
    ),
}  # fmt: skip
"""Limits that refuse nothing, and why."""


def _texts(module: ast.Module) -> Iterator[str]:
    """All strings of a module that are not its documentation."""
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    docstrings = {
        id(node.body[0].value)
        for node in ast.walk(module)
        if isinstance(node, documented) and node.body and isinstance(node.body[0], ast.Expr)
    }
    for node in ast.walk(module):
        if isinstance(node, ast.Constant) and id(node) not in docstrings:
            if isinstance(node.value, bytes):
                yield node.value.decode("latin-1")
            elif isinstance(node.value, str):
                yield node.value


def _refusals() -> str:
    files = [
        file
        for file in SOURCE.rglob("*.py")
        if file.name not in ("settings.py", "part.py", "command.py")
        and not {"settings", "cli", "command", "commands"} & set(file.parts)
    ]
    assert len(files) > 500
    return "\n".join(text for file in files for text in _texts(ast.parse(file.read_text("utf-8"))))


def _quotas() -> set[str]:
    """Limits whose refusals are made by one function, `limits.{the name that it was given}`."""
    module = ast.parse((SOURCE / "rwt" / "access" / "quotas.py").read_text("utf-8"))
    assert "is the limit (limits." in "".join(_texts(module))
    return {
        node.args[0].value
        for node in ast.walk(module)
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id == "Quota"
        and isinstance(node.args[0], ast.Constant)
        and isinstance(node.args[0].value, str)
    }


def test_each_limit_is_named_where_it_refuses() -> None:
    refusals, quotas = _refusals(), _quotas()
    unnamed = {
        name for name in LimitSettings.model_fields if f"limits.{name}" not in refusals and name not in quotas
    }
    assert unnamed == set(REFUSE_NOTHING)
    assert "max_message_size" in refusals


def test_the_options_that_bound_recordings_are_named() -> None:
    assert "--chunk-bytes allows more" in _refusals()
    assert parser_for("bag").parse_args(["bag", "info", "x", "--chunk-bytes", "2000"]).chunk_bytes == 2000
