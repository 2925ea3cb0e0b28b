"""Globs of the settings that match nothing on the robot, and names that no rule guards."""

from __future__ import annotations

import json
import logging
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

import anyio.lowlevel

from rwt.access.gate.rules import RULE_KEYS, Rules
from rwt.access.roles import absolute_globs, glob_pattern
from rwt.access.settings import NamesOf, Table
from rwt.observability.supervision import Periodic
from rwt_participant.spelling import nearest
from rwt_transports.http.routes import Audience, HttpExtension, HttpResponse, Reader, Route

if TYPE_CHECKING:
    from rwt.settings.models import Settings
    from rwt_graph.api import Graph, TopicInfo

logger = logging.getLogger(__name__)

CHECK_SECONDS: Final = 10.0
"""Time that the robot's programs have to appear, and between two checks."""

_STEP_NAMES: Final = 100
"""Names that are looked up in one turn of the event loop."""

_MAX_FOUND: Final = 100
"""Maximum number of globs that are reported."""

_DRIVING: Final = frozenset({"geometry_msgs/Twist", "geometry_msgs/TwistStamped"})
"""Types of topics that move a robot."""

#: Nodes of the server itself: a topic that only they use is not the robot's.
_OWN_NODES: Final = frozenset({"/gate"})


class Unmatched(NamedTuple):
    """Glob that matches no name, or name that no glob matches.

    Attributes:
        setting: key of the setting, such as `gate.rules.drive.topics`.
        glob: the glob, or the name.
        text: description, with the nearest name.
        advice: what to do.
    """

    setting: str
    glob: str
    text: str
    advice: str


def globs_of(table: Table, above: str = "") -> Iterator[tuple[str, NamesOf, tuple[str, ...]]]:
    """Yield key, kinds of names, and globs of each setting that lists names of the robot."""
    for name, field in type(table).model_fields.items():
        value, key = getattr(table, name), f"{above}{name}"
        kinds = next((each for each in field.metadata if isinstance(each, NamesOf)), None)
        if kinds is not None:
            yield key, kinds, value
        elif isinstance(value, Table):
            yield from globs_of(value, f"{key}.")
        elif isinstance(value, Mapping):
            for inner, each in value.items():
                if isinstance(each, Table):
                    yield from globs_of(each, f"{key}.{inner}.")


class GlobCheck:
    """Periodic check of all globs against the names in the graph.

    Attributes:
        found: globs that matched nothing at the last check.
    """

    def __init__(self, graph: Graph, settings: Settings) -> None:
        self.found: tuple[Unmatched, ...] = ()
        self._is_checking = False
        self._graph = graph
        self._timer = Periodic(graph.clock, CHECK_SECONDS, self._check)
        self.take(settings)

    @property
    def unguarded(self) -> tuple[Unmatched, ...]:
        """Topics that move the robot, and that no rule of the gate guards.

        They are not warned of in the log, as a robot may be meant to have no gate.
        """
        return tuple(
            Unmatched(
                "gate.rules",
                each.name,
                f"no gate rule guards `{each.name}` ({each.type.name}), which drives the robot",
                "add a rule to `gate.rules`, and reload",
            )
            for each in self._topics_of_robot()
            if each.type is not None and each.type.name in _DRIVING and each.subscribers
            if not self._rules.of("publish", each.name)
        )[:_MAX_FOUND]

    @property
    def http(self) -> HttpExtension[Reader]:
        """Page of the globs that match nothing and of unguarded names, for clients that see every topic."""
        page = Route[Reader]("/unmatched", lambda request, reader: self._page(), Audience.EVERY_TOPIC)
        return HttpExtension(routes=(page,))

    def _page(self) -> HttpResponse:
        body = json.dumps([each._asdict() for each in (*self.found, *self.unguarded)]).encode()
        return HttpResponse(body, content_type="application/json")

    def take(self, settings: Settings) -> None:
        """Check other settings from now on."""
        self._globs = tuple((key, kinds, globs) for key, kinds, globs in globs_of(settings) if globs)
        self._rules = Rules(settings.gate)
        self._logged: set[tuple[str, str]] = set()

    def close(self) -> None:
        """Stop checking."""
        self._timer.close()

    def _check(self) -> None:
        if not self._globs:
            self.found = ()
        elif not self._is_checking:
            self._is_checking = True
            self._graph.spawn(self._check_in_steps, "check of globs")

    async def _check_in_steps(self) -> None:
        """Check all globs, in turns of the event loop: a robot may have very many names."""
        try:
            await self._compare(self._globs)
        finally:
            self._is_checking = False

    async def _names(self, kinds: set[str]) -> dict[str, list[str]]:
        """Return the names of these kinds in the graph."""
        names: dict[str, list[str]] = {kind: [] for kind in kinds}
        if "topic" in kinds:
            for number, name in enumerate(self._graph.topic_names()):
                if number % _STEP_NAMES == 0:
                    await anyio.lowlevel.checkpoint()
                topic = self._graph.topic(name)
                if topic is not None and _is_of_robot(topic):
                    names["topic"].append(name)
        if "service" in kinds:
            names["service"] = [each.name for each in self._graph.services()]
            await anyio.lowlevel.checkpoint()
        if "action" in kinds:
            names["action"] = list(self._graph.action_names())
        return names

    async def _compare(self, every: Sequence[tuple[str, NamesOf, tuple[str, ...]]]) -> None:
        names = await self._names({kind for _, kinds, _ in every for kind in kinds.kinds})
        found: list[Unmatched] = []
        for setting, kinds, globs in every:
            known = [name for kind in kinds.kinds for name in names[kind]]
            for glob, absolute in zip(globs, absolute_globs(globs), strict=True):
                await anyio.lowlevel.checkpoint()
                if len(found) < _MAX_FOUND and not _matches(absolute, known):
                    text = self._text(setting, kinds, absolute, known)
                    found.append(Unmatched(setting, glob, text, f"correct `{setting}`, and reload"))
        self.found = tuple(found)
        for each in found:
            if each[:2] not in self._logged:
                self._logged.add(each[:2])
                logger.warning("%s", each.text)

    def _topics_of_robot(self) -> Iterator[TopicInfo]:
        return filter(_is_of_robot, self._graph.topics())

    def _text(self, setting: str, kinds: NamesOf, glob: str, known: list[str]) -> str:
        what = " or ".join(kinds.kinds)
        near = nearest(glob, known)
        if not setting.startswith("gate.rules."):
            return f"`{setting}`: {glob} matches no {what}" + (f"; near: {near}" if near else "")
        text = f"gate rule `{glob}` guards no {what} (`{setting}`)"
        key = setting.rpartition(".")[2]
        act = next(act for act, its in RULE_KEYS.items() if its == key)
        if near is None:
            return text
        is_guarded = bool(self._rules.of(act, near))
        return f"{text}; near: `{near}`, which is {'guarded' if is_guarded else 'not guarded'}"


def _is_of_robot(topic: TopicInfo) -> bool:
    return not _OWN_NODES.issuperset(end.node for end in (*topic.publishers, *topic.subscribers))


def _matches(glob: str, known: list[str]) -> bool:
    """Return True if a glob matches a known name, every name, or names that the graph does not list."""
    if (
        re.fullmatch(r"/?\*+", glob)
        or glob.startswith(("/rosapi/", "/gate/", "/rosout"))
        or "/_action/" in glob
    ):
        return True
    return glob in known or any(map(glob_pattern((glob,)).fullmatch, known))
