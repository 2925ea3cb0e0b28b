"""Target under test, a server or a client library, described by a small TOML file."""

from __future__ import annotations

import fnmatch
import tomllib
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Literal, get_args

from rosbridge_conformance.suite.case import PROFILES, Case

SHIPPED = Path(__file__).parents[1] / "targets"
"""Target files of servers in the suite, for `--target NAME`."""

SHIPPED_CLIENTS = Path(__file__).parents[1] / "targets-client"
"""Target files of client libraries in the suite."""

Probe = Literal["loopback", "get_time"]

FEATURES = (
    "auto-advertise", "call-timeout", "global-parameters", "new-rosapi", "no-auth", "unasked-status",
)  # fmt: skip
"""Optional features that a target declares by name; cases require them in `needs`."""

CLIENT_FEATURES = ("tf-topics", "tf-service")
"""Optional features of client libraries: the interface of tf2_web_republisher that they use."""

WIRE_FEATURES = ("messages", "lines", "stream", "several-clients")
"""Features that follow from the URL and are not declared."""


class TargetError(ValueError):
    """A target file is invalid; the text gives file, location and expected value."""


@dataclass(frozen=True, slots=True)
class Target:
    """A server or client library under test.

    Attributes:
        name: name in reports.
        ros: 1 or 2; determines the form of times and the selected cases.
        type_names: form of type names in introspection, `pkg/Name` or `pkg/msg/Name`.
        profiles: supported parts of the protocol.
        features: supported optional features.
        settle: seconds until what one client did can be seen by another (discovery), at the most; after a
            case for clients, seconds in which nothing may come.
        timeout: maximum wait for a frame, in seconds.
        probe: request that probes whether a connection is alive; not used for clients.
        auth_secret: secret of the mac, in AUTH cases and for authentication in others.
        expected: reason of an expected failure, by case id or glob; a stale entry is an error.
        unstable: reason of an occasional failure, by case id or glob.
        alone: ids or globs of cases that must run alone, because they block all connections of the server.
    """

    name: str = "unnamed server"
    ros: int = 2
    type_names: Literal["two", "three"] = "three"
    profiles: tuple[str, ...] = ("CORE",)
    features: tuple[str, ...] = ()
    settle: float = 0.05
    timeout: float = 2.0
    probe: Probe = "loopback"
    auth_secret: str | None = None
    expected: Mapping[str, str] = field(default_factory=dict)
    unstable: Mapping[str, str] = field(default_factory=dict)
    alone: tuple[str, ...] = ()

    def asked(self, case: Case) -> bool:
        """True if the case applies to this ROS generation."""
        return self.ros in case.ros

    def missing(self, case: Case, wire_features: frozenset[str]) -> tuple[str, ...]:
        """Return the features that the case requires and the target does not declare."""
        has = {*self.features, *self.profiles, *wire_features}
        needed = [] if case.profile in self.profiles else [f"profile {case.profile}"]
        return (*needed, *(name for name in case.needs if name not in has))

    def alone_with(self, case: Case) -> bool:
        """True if no other case may run at the same time."""
        return case.alone or any(fnmatch.fnmatchcase(case.id, glob) for glob in self.alone)

    def reason(self, case_id: str) -> str | None:
        """Return the reason for an expected failure, always or at times, or None."""
        known = (*self.expected.items(), *self.unstable.items())
        return next((why for key, why in known if fnmatch.fnmatchcase(case_id, key)), None)


def check_ids(target: Target, ids: Collection[str]) -> None:
    """Check that a target names existing cases.

    Args:
        ids: ids of all cases.

    Raises:
        TargetError: an id or glob fits no case; names similar ones.
    """
    for key in (*target.expected, *target.unstable, *target.alone):
        if not any(fnmatch.fnmatchcase(each, key) for each in ids):
            meant = "".join(f"; did you mean {each}?" for each in get_close_matches(key, ids, 1))
            raise TargetError(f"{target.name}: no case has the id {key}{meant}")


def shipped() -> tuple[str, ...]:
    """Return the names of the servers in the suite."""
    return _names_in(SHIPPED)


def shipped_clients() -> tuple[str, ...]:
    """Return the names of the client libraries in the suite."""
    return _names_in(SHIPPED_CLIENTS)


def find_target(name: str) -> Target:
    """Return a server by file name, or by the name of one in the suite.

    Raises:
        TargetError: it does not exist, or is invalid.
    """
    return _find(name, SHIPPED, FEATURES)


def find_client_target(name: str) -> Target:
    """Return a client library, like `find_target`."""
    return _find(name, SHIPPED_CLIENTS, CLIENT_FEATURES)


def with_known(target: Target, path: Path, suite: str) -> Target:
    """Return the target with the `[expected_failures]` and `[unstable]` of a file added.

    Args:
        target: target without the file.
        path: file; its `suite` is the version that it is for.
        suite: version of the cases.

    Raises:
        TargetError: the file cannot be read, or was made for a suite in which other cases may fail.
    """
    fields = _read(path)
    if unknown := sorted(set(fields) - {"suite", "expected_failures", "unstable"}):
        raise TargetError(f"{path}: `{unknown[0]}`: unknown; known are suite, expected_failures and unstable")
    wanted = fields.pop("suite", suite)
    if not isinstance(wanted, str) or wanted.split(".")[0] != suite.split(".")[0]:
        raise TargetError(
            f"{path}: `suite`: it was made with {wanted!r}, and this is {suite}; look at its failures again"
        )
    known = _Fields(str(path), fields, ()).target()
    return replace(
        target, expected={**target.expected, **known.expected}, unstable={**target.unstable, **known.unstable}
    )


def _read(path: Path) -> dict[str, object]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise TargetError(f"{path}: cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise TargetError(f"{path}: not TOML: {error}") from error


def _names_in(folder: Path) -> tuple[str, ...]:
    return tuple(sorted(path.stem for path in folder.glob("*.toml")))


def _find(name: str, folder: Path, features: tuple[str, ...]) -> Target:
    path = Path(name)
    if not path.suffix and name in _names_in(folder):
        path = folder / f"{name}.toml"
    if not path.is_file():
        raise TargetError(
            f"{name}: there is no such file; shipped targets are {', '.join(_names_in(folder))}"
        )
    return _Fields(str(path), _read(path), features).target()


class _Fields:
    """Parser of the fields of one target file."""

    _KNOWN = (
        "name", "ros", "type_names", "profiles", "features", "settle", "timeout", "probe", "auth_secret",
        "expected_failures", "unstable", "alone",
    )  # fmt: skip

    def __init__(self, path: str, fields: dict[str, object], features: tuple[str, ...]) -> None:
        self._path = path
        self._fields = fields
        self._features = features

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
            features=self._names("features", self._features, default.features),
            settle=self._seconds("settle", default.settle),
            timeout=self._seconds("timeout", default.timeout),
            probe="get_time"
            if self._choice("probe", get_args(Probe), "loopback") == "get_time"
            else "loopback",
            auth_secret=None if secret is None else self._text("auth_secret", ""),
            expected=self._reasons("expected_failures"),
            unstable=self._reasons("unstable"),
            alone=self._globs("alone"),
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

    def _globs(self, key: str) -> tuple[str, ...]:
        value = self._fields.get(key, [])
        if not isinstance(value, list) or not all(isinstance(glob, str) and glob for glob in value):
            raise self._error(key, f"expected ids or globs of cases, got {value!r}")
        return tuple(value)

    def _seconds(self, key: str, default: float) -> float:
        value = self._fields.get(key, default)
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= 60:
            raise self._error(key, f"expected seconds from 0 to 60, got {value!r}")
        return float(value)

    def _reasons(self, key: str) -> dict[str, str]:
        value = self._fields.get(key, {})
        if not isinstance(value, dict):
            raise self._error(key, "expected a table of case ids and reasons")
        for case, why in value.items():
            if not isinstance(why, str) or not why:
                raise self._error(f"{key}.{case}", "expected the reason as text")
        return dict(value)
