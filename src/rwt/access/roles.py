"""Roles: what each allows, as globs of names for every kind of act."""

from __future__ import annotations

import fnmatch
import re
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Final, Literal, get_args

from rwt.access.errors import NotAllowed
from rwt.access.settings import BUILT_IN_ROLES

if TYPE_CHECKING:
    from rwt.access.settings import AccessSettings, RoleSettings
    from rwt_interfaces.payload import Payload

Act = Literal["publish", "subscribe", "call", "provide", "displace", "goals", "get_param", "set_param"]
"""Something a client may want to do with a name; each is a key of a role's settings."""

ACTS: Final[tuple[Act, ...]] = get_args(Act)

_READ_ONLY: Final[Mapping[Act, tuple[str, ...]]] = {"subscribe": ("*",), "get_param": ("*",)}

#: Services every role may call: rosapi, whose answers hold only what the role may see (CFG-10, API-13).
_ALWAYS_CALLED: Final = ("/rosapi/*",)

#: Decisions a role remembers. Names come from clients, so they are bounded; at the bound all are forgotten.
_MOST_DECISIONS: Final = 4096
_LONGEST_NAME: Final = 256
"""Characters of a name whose decision is kept: a client may ask about names of megabytes."""

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

#: The services and topics of ROS 2 beside an action: the first need the right to its goals, whatever may be
#: called, and the second are open to those who have it.
_BEHIND_ACTION: Final = re.compile(
    r"(?P<action>/.+)/_action/(?:(?P<service>send_goal|cancel_goal|get_result)|feedback|status)"
)


class Role:
    """What clients of one role may do.

    Globs have fnmatch's meaning, in which ``*`` also matches ``/`` (CFG-10), and are compared with resolved
    names, so that a client cannot get round them by another spelling (CFG-11).

    Attributes:
        name: as in the settings.
        unrestricted: whether it may do everything.
        globs: what it may do, by act: globs of absolute names.
        answers: the last answer of each service that lists the graph: as given, and as the role sees it.

    Args:
        name: see above.
        settings: its globs.
    """

    __slots__ = ("_decisions", "_patterns", "_subscribes_to_all", "answers", "globs", "name", "unrestricted")

    def __init__(self, name: str, settings: RoleSettings) -> None:
        self.name = name
        self.globs: Mapping[Act, tuple[str, ...]] = {act: _globs(act, settings) for act in ACTS}
        self.unrestricted = all("*" in self.globs[act] for act in ACTS)
        self._patterns = {act: _pattern(self.globs[act]) for act in ACTS}
        self._subscribes_to_all = any(
            glob.removeprefix("/").strip("*") == "" for glob in self.globs["subscribe"]
        )
        self._decisions: dict[tuple[Act, str], bool] = {}
        self.answers: dict[str, tuple[Payload, Payload]] = {}

    def allows(self, act: Act, name: str) -> bool:
        """Whether this role may do `act` with `name`, which is absolute."""
        if self.unrestricted:
            return True
        decision = self._decisions.get((act, name))
        if decision is None:
            decision = self._decide(act, name)
            if len(name) <= _LONGEST_NAME:
                if len(self._decisions) >= _MOST_DECISIONS:
                    self._decisions.clear()
                self._decisions[act, name] = decision
        return decision

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
        """Refuse unless this role may do `act` with `name`.

        Raises:
            NotAllowed: it may not; the text names the setting that would allow it.
        """
        if not self.unrestricted and not self.allows(act, name):
            behind = _BEHIND_ACTION.fullmatch(name) if act == "call" else None
            setting = "goals" if behind and behind["service"] else act
            raise NotAllowed(f"role {self.name!r} may not {_WORDS[act]} {name} (roles.{self.name}.{setting})")

    @property
    def sees_every_topic(self) -> bool:
        """Whether no topic is hidden: whether one of the globs consists of stars alone."""
        return self.unrestricted or self._subscribes_to_all

    def sees_topic(self, name: str) -> bool:
        """Whether a topic is shown: to those who may subscribe to it or publish on it."""
        return self.allows("subscribe", name) or self.allows("publish", name)

    def sees_service(self, name: str) -> bool:
        """Whether a service is shown: to those who may call or provide it."""
        return self.allows("call", name) or self.allows("provide", name)

    def sees_action(self, name: str) -> bool:
        """Whether an action is shown: to those who may send goals to it or provide it."""
        return self.allows("goals", name) or self.allows("provide", name)

    def sees_parameter(self, name: str) -> bool:
        """Whether a parameter is shown: to those who may read or write it."""
        return self.allows("get_param", name) or self.allows("set_param", name)

    def __repr__(self) -> str:
        return f"<Role {self.name}>"


def roles(settings: AccessSettings) -> Mapping[str, Role]:
    """Every role by its name, the built-in ones included."""
    return {name: Role(name, globs) for name, globs in {**BUILT_IN_ROLES, **settings.roles}.items()}


def _globs(act: Act, settings: RoleSettings) -> tuple[str, ...]:
    given: tuple[str, ...] = getattr(settings, act)
    if settings.read_only:
        given += _READ_ONLY.get(act, ())
    given = given + _ALWAYS_CALLED if act == "call" else given
    return tuple(glob if glob.startswith(("/", "*")) else f"/{glob}" for glob in given)


def _pattern(globs: Iterable[str]) -> re.Pattern[str]:
    """One pattern for all; one that matches nothing where there are none."""
    return re.compile("|".join(map(fnmatch.translate, globs)) or r"(?!)")
