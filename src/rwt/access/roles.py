"""Roles: permissions for every kind of act, as globs of names."""

from __future__ import annotations

import copy
import fnmatch
import re
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Final, Literal, TypeVar, get_args

from rwt.access.errors import NotAllowed
from rwt.access.settings import BUILT_IN_ROLES, AccessSettings, RoleSettings

if TYPE_CHECKING:
    from rwt_interfaces.payload import Payload

Act = Literal["publish", "subscribe", "call", "provide", "displace", "goals", "get_param", "set_param"]
"""Kind of act on a name; a key of a role's settings."""

ACTS: Final[tuple[Act, ...]] = get_args(Act)

_READ_ONLY: Final[Mapping[Act, tuple[str, ...]]] = {"subscribe": ("*",), "get_param": ("*",)}

#: Services that every role may call: rosapi, whose responses are filtered by role (CFG-10, API-13).
_ALWAYS_CALLED: Final = ("/rosapi/*",)

#: Maximum number of entries of a cache by name: names come from clients. At the limit the cache is cleared.
_MAX_NAMES: Final = 4096

#: Maximum number of characters of a cached name: clients may send names of megabytes.
_MAX_NAME: Final = 256

A = TypeVar("A", bound=str)
V = TypeVar("V")

_WORDS: Final[Mapping[Act, str]] = {
    "publish": "publish on",
    "subscribe": "subscribe to",
    "call": "call",
    "provide": "provide",
    "displace": "take the place of the robot's own",
    "goals": "send goals to",
    "get_param": "read the parameter",
    "set_param": "write the parameter",
}

#: Hidden services and topics of a ROS 2 action. The services require permission for its goals, not for calls;
#: with that permission the topics may be subscribed to, too.
_BEHIND_ACTION: Final = re.compile(
    r"(?P<action>/.+)/_action/(?:(?P<service>send_goal|cancel_goal|get_result)|feedback|status)"
)


class NameCache(dict[tuple[A, str], V]):
    """Bounded cache of values by act and name.

    Args:
        find: returns the value that is not in the cache.
    """

    def __init__(self, find: Callable[[A, str], V]) -> None:
        super().__init__()
        self._find = find

    def __missing__(self, key: tuple[A, str]) -> V:
        value = self._find(*key)
        if len(key[1]) <= _MAX_NAME:
            if len(self) >= _MAX_NAMES:
                self.clear()
            self[key] = value
        return value


class Role:
    """Permissions of the clients of one role.

    Globs follow fnmatch, where ``*`` also matches ``/`` (CFG-10). They are compared with resolved names, so
    another spelling of a name cannot bypass them (CFG-11).

    Attributes:
        name: name in the settings.
        credential: name of the token that gave the role, or `rosauth`; empty without credentials. For people:
            a token may be called `rosauth`, too.
        token: name of the token that gave the role; empty without one. It identifies the role's client.
        unrestricted: True if the role may do everything.
        globs: permissions by act: globs of absolute names.
        answers: last response of each service that lists the graph, as given and as filtered for the role.
    """

    __slots__ = (
        "_decisions", "_patterns", "_subscribes_to_all", "answers", "credential", "globs", "name", "token",
        "unrestricted",
    )  # fmt: skip

    def __init__(self, name: str, settings: RoleSettings) -> None:
        self.name = name
        self.credential = self.token = ""
        self.globs: Mapping[Act, tuple[str, ...]] = {act: _globs(act, settings) for act in ACTS}
        self.unrestricted = all("*" in self.globs[act] for act in ACTS)
        self._patterns = {act: glob_pattern(self.globs[act]) for act in ACTS}
        self._subscribes_to_all = any(
            glob.removeprefix("/").strip("*") == "" for glob in self.globs["subscribe"]
        )
        self._decisions: NameCache[Act, bool] = NameCache(self._decide)
        self.answers: dict[str, tuple[Payload, Payload]] = {}

    def given_by(self, credential: str, *, is_token: bool = True) -> Role:
        """Return the role as a credential gives it; both share their cached decisions.

        Args:
            credential: name of the credential; empty for none.
            is_token: True if it is a token, which identifies its client.
        """
        given = copy.copy(self)
        given.credential = credential
        given.token = credential if is_token else ""
        return given

    @property
    def described(self) -> str:
        """Name of the role, and of the credential that gave it, for logs."""
        kind = "token " if self.token else ""
        return f"{self.name} ({kind}{self.credential})" if self.credential else self.name

    def allows(self, act: Act, name: str) -> bool:
        """Return True if the role allows `act` on `name`, an absolute name."""
        return self.unrestricted or self._decisions[act, name]

    def _decide(self, act: Act, name: str) -> bool:
        allowed = self._patterns[act].fullmatch(name) is not None
        if act in ("call", "subscribe") and (behind := _BEHIND_ACTION.fullmatch(name)):
            to_goals = self._patterns["goals"].fullmatch(behind["action"]) is not None
            if act == "call" and behind["service"]:
                return to_goals
            if act == "subscribe" and not behind["service"]:
                return allowed or to_goals
        return allowed

    def require(self, act: Act, name: str) -> None:
        """Raise NotAllowed unless the role allows `act` on an absolute name; the text names the setting."""
        if not self.unrestricted and not self.allows(act, name):
            behind = _BEHIND_ACTION.fullmatch(name) if act == "call" else None
            setting = "goals" if behind and behind["service"] else act
            raise NotAllowed(f"role {self.name!r} may not {_WORDS[act]} {name} (roles.{self.name}.{setting})")

    @property
    def sees_every_topic(self) -> bool:
        """True if no topic is hidden: a glob consists of stars only."""
        return self.unrestricted or self._subscribes_to_all

    def sees_topic(self, name: str) -> bool:
        """Return True if the role may subscribe to a topic or publish on it."""
        return self.allows("subscribe", name) or self.allows("publish", name)

    def sees_service(self, name: str) -> bool:
        """Return True if the role may call or provide a service."""
        return self.allows("call", name) or self.allows("provide", name)

    def sees_action(self, name: str) -> bool:
        """Return True if the role may send goals to an action or provide it."""
        return self.allows("goals", name) or self.allows("provide", name)

    def sees_parameter(self, name: str) -> bool:
        """Return True if the role may read or write a parameter."""
        return self.allows("get_param", name) or self.allows("set_param", name)

    def __repr__(self) -> str:
        return f"<Role {self.name}>"


def roles(settings: AccessSettings) -> Mapping[str, Role]:
    """Return every role by name, including the built-in ones."""
    return {name: Role(name, globs) for name, globs in {**BUILT_IN_ROLES, **settings.roles}.items()}


def _globs(act: Act, settings: RoleSettings) -> tuple[str, ...]:
    given: tuple[str, ...] = getattr(settings, act)
    if settings.read_only:
        given += _READ_ONLY.get(act, ())
    given = given + _ALWAYS_CALLED if act == "call" else given
    return absolute_globs(given)


def absolute_globs(globs: Iterable[str]) -> tuple[str, ...]:
    """Return globs for absolute names."""
    return tuple(glob if glob.startswith(("/", "*")) else f"/{glob}" for glob in globs)


def glob_pattern(globs: Iterable[str]) -> re.Pattern[str]:
    """Return a pattern that matches what one of the globs matches; without globs, nothing."""
    return re.compile("|".join(map(fnmatch.translate, globs)) or r"(?!)")
