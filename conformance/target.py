"""What is known about the server under test: a small TOML file."""

from __future__ import annotations

import fnmatch
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, get_args

from conformance.case import PROFILES, Case

SHIPPED = Path(__file__).parent / "targets"
"""Targets that come with the suite; `--target NAME` finds them by name."""

Probe = Literal["loopback", "get_time"]

FEATURES = ("auto-advertise", "call-timeout", "new-rosapi", "no-auth")
"""Optional things inside profiles that a target declares by name; cases ask for them in `needs`."""

WIRE_FEATURES = ("auto-advertise", "call-timeout", "new-rosapi", "no-auth")

    def __init__(self, path: str, fields: dict[str, object]) -> None:
        self._path = path
        self._fields = fields

    def target(self) -> Target:
        for key in self._fields:
            if key not in self._KNOWN:
                raise self._error(key, f"unknown; known are {', '.join(self._KNOWN)}")
        default = Target()
        secret = self._fields.get("auth_secret")
        return Target(
            name=self._text("name", Path(self._path).stem),
            ros=self._ros(),
            type_names="two" if self._choice("type_names", ("two", "three"), "three") == "two" else "three",
            profiles=self._names("profiles", PROFILES, default.profiles),
            features=self._names("features", FEATURES, default.features),
            settle=self._seconds("settle", default.settle),
            timeout=self._seconds("timeout", default.timeout),
            probe="get_time"
            if self._choice("probe", get_args(Probe), "loopback") == "get_time"
            else "loopback",
            auth_secret=None if secret is None else self._text("auth_secret", ""),
            expected=self._expected(),
        )

    def _error(self, key: str, text: str) -> TargetError:
        return TargetError(f"{self._path}: `{key}`: {text}")

    def _text(self, key: str, default: str) -> str:
        value = self._fields.get(key, default)
        if not isinstance(value, str):
            raise self._error(key, f"expected text, got {value!r}")
        return value

    def _ros(self) -> int:
        value = self._fields.get("ros", 2)
        if value not in (1, 2) or not isinstance(value, int):
            raise self._error("ros", f"expected 1 or 2, got {value!r}")
        return value

    def _choice(self, key: str, among: tuple[str, ...], default: str) -> str:
        value = self._text(key, default)
        if value not in among:
            raise self._error(key, f"expected one of {', '.join(among)}, got {value!r}")
        return value

    def _names(self, key: str, among: tuple[str, ...], default: tuple[str, ...]) -> tuple[str, ...]:
        value = self._fields.get(key, list(default))
        if not isinstance(value, list):
            raise self._error(key, f"expected a list, got {value!r}")
        for name in value:
            if name not in among:
                raise self._error(key, f"expected names out of {', '.join(among)}, got {name!r}")
        return tuple(value)

    def _seconds(self, key: str, default: float) -> float:
        value = self._fields.get(key, default)
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= 60:
            raise self._error(key, f"expected seconds from 0 to 60, got {value!r}")
        return float(value)

    def _expected(self) -> dict[str, str]:
        value = self._fields.get("expected_failures", {})
        if not isinstance(value, dict):
            raise self._error("expected_failures", "expected a table of case ids and reasons")
        for key, why in value.items():
            if not isinstance(why, str) or not why:
                raise self._error(f"expected_failures.{key}", "expected the reason as text")
        return dict(value)
