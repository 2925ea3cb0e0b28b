"""Sessions of the command line: help, settings and what is wrong with them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Final

from tests.processes import ROOT
from tests.traces.transcript import Session, Transcript

_PROGRAM: Final = Path(__file__).with_name("print_commands.py")
_WRONG_FILES: Final = {
    "unknown_key": "colour = 'red'",
    "unknown_table": "[limit]\ncalls = 1",
    "unknown_key_of_a_table": "[limits]\ncall = 1",
    "wrong_type": "[limits]\ncalls = 'many'",
    "negative": "[limits]\ncalls = -1",
    "too_large": "[limits]\nmax_depth = 100000",
    "unknown_distro": "distro = 'humble'",
    "unknown_profile": "profile = 'ros3'",
    "unknown_gateway": "gateways = ['soap']",
    "unknown_node": "nodes = ['dancer']",
    "wrong_url": "listen = ['http://127.0.0.1']",
    "not_toml": "listen = [",
    "unknown_role": "[auth]\ndefault_role = 'king'",
    "role_of_no_act": "[roles.x]\nfly = ['*']",
    "token_without_role": "[auth.tokens.x]\ntoken = 'a-token-that-is-long-enough'",
    "short_token": "[auth.tokens.x]\ntoken = 'x'\nrole = 'admin'",
    "rule_about_nothing": "[gate.rules.x]\nemergency = true",
    "lease_without_stop": "[gate.rules.x]\ntopics = ['/x']\nlease = {}",
    "limit_of_nothing": "[gate.rules.x]\ntopics = ['/x']\n[gate.rules.x.fields]\n'x' = {}",
    "wrong_path": "[gate.rules.x]\ntopics = ['/x']\n[gate.rules.x.fields]\n'x y' = {min = 1}",
    "empty_range": "[gate.rules.x]\ntopics = ['/x']\n[gate.rules.x.fields]\n'x' = {min = 2, max = 1}",
    "certificate_without_key": "[tls]\ncertfile = 'x'",
    "wrong_host": "[origins]\nhosts = ['a b']",
    "workers_with_a_gate": "workers = 2\n[gate.rules.x]\nservices = ['/x']",
}
_OPTIONS: Final = (
    "--config|missing.toml",
    "--set|limits.calls",
    "--set|limits.calls=many",
    "--set|nothing=1",
    "--set|limits.calls=7",
    "--set|distro=noetic",
)


@cache
def _printed() -> list[tuple[str, str, str]]:
    with tempfile.TemporaryDirectory(prefix="traces-") as folder:
        for name, text in _WRONG_FILES.items():
            Path(folder, f"{name}.toml").write_text(f"{text}\n")
        asked = [*(f"--config|{name}.toml" for name in _WRONG_FILES), *_OPTIONS]
        own = {name: value for name, value in os.environ.items() if not name.startswith("RWT_")}
        path = os.pathsep.join(str(ROOT / each) for each in ("src", "conformance"))
        process = subprocess.run(
            [sys.executable, str(_PROGRAM), json.dumps(asked)],
            cwd=folder,
            env={**own, "PYTHONPATH": path, "COLUMNS": "80", "NO_COLOR": "1", "HOME": folder},
            capture_output=True,
            text=True,
            timeout=100,
            check=True,
        )
        return [(line, text, code) for line, text, code in json.loads(process.stdout)]


def _note(transcript: Transcript, rows: Iterator[tuple[str, str, str]]) -> None:
    for line, text, code in rows:
        transcript.add(f"$ {line}")
        transcript.add(text.rstrip("\n"))
        transcript.add(f"exit code {code}\n")


def help_texts(transcript: Transcript) -> None:
    """Record the help of each command."""
    _note(transcript, (row for row in _printed() if row[0].endswith("--help")))


def settings(transcript: Transcript) -> None:
    """Record all settings with their defaults, and what is said of wrong ones."""
    _note(transcript, (row for row in _printed() if not row[0].endswith("--help")))


SESSIONS: Final[dict[str, Session]] = {"command.help": help_texts, "command.settings": settings}
