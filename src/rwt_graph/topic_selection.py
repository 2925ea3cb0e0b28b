"""Patterns of names that clients may choose, and the selection of topics for recordings and `rwt top`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

from rwt_participant.api import ACTION_PARTS, SERVICE_EVENTS


def glob_matcher(glob: str) -> Callable[[str], bool]:
    """Return a function that matches whole names with a pattern of the shell: `*`, `?`, `[a-z]` and `[!a-z]`.

    For patterns that clients choose: `fnmatch` and `re` keep patterns in caches of the process, and may take
    long. The time for a name is proportional to its length, whatever the pattern.
    """
    # Bit n of a mask is for the n-th character of a matching name, not counting those of `*`.
    literals: dict[str, int] = {}
    classes: list[tuple[int, Callable[[str], bool]]] = []
    loops = anything = at = 0
    bit = 1
    while at < len(glob):
        character = glob[at]
        # A `]` directly after the bracket, or its `!`, belongs to the class.
        close = glob.find("]", at + 3 if glob.startswith("[!", at) else at + 2) if character == "[" else -1
        if character == "*":
            loops |= bit
        else:
            if close > 0:
                classes.append((bit, _class_of(glob[at + 1 : close])))
                at = close
            elif character == "?":
                anything |= bit
            else:
                literals[character] = literals.get(character, 0) | bit
            bit <<= 1
        at += 1

    def accepted(character: str) -> int:
        in_classes = sum(each for each, has in classes if has(character)) if classes else 0
        return literals.get(character, 0) | anything | in_classes

    return partial(_matches, accepted, loops, bit)


def _matches(accepted: Callable[[str], int], loops: int, end: int, name: str) -> bool:
    states = 1
    for character in name:
        states = ((states & accepted(character)) << 1) | (states & loops)
        if not states:
            return False
    return bool(states & end)


def _class_of(members: str) -> Callable[[str], bool]:
    is_inverted = members.startswith("!")
    rest = members.removeprefix("!")
    ranges: list[tuple[str, str]] = []
    while rest:
        size = 3 if len(rest) > 2 and rest[1] == "-" else 1
        ranges.append((rest[0], rest[size - 1]))
        rest = rest[size:]
    return lambda character: is_inverted is not any(low <= character <= high for low, high in ranges)


@dataclass(frozen=True, slots=True)
class TopicSelection:
    """Selection of topics.

    Attributes:
        topics: patterns of the shell (``/camera/*``), of which one must fit; none stands for all.
        exclude: patterns of which none may fit.
        services: True if topics that tell of service calls are taken.
        actions: True if the topics of ROS 2's actions are taken.
    """

    topics: tuple[str, ...] = ()
    exclude: tuple[str, ...] = ()
    services: bool = False
    actions: bool = False
    _takes: tuple[Callable[[str], bool], ...] = field(init=False, repr=False, compare=False)
    _leaves_out: tuple[Callable[[str], bool], ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_takes", tuple(map(_topic_matcher, self.topics)))
        object.__setattr__(self, "_leaves_out", tuple(map(_topic_matcher, self.exclude)))

    def takes(self, topic: str) -> bool:
        """Return True if a topic is selected. One that `topics` names in full is, whatever its kind."""
        if any(fits(topic) for fits in self._leaves_out):
            return False
        if topic in self.topics:
            return True
        if self.topics and not any(fits(topic) for fits in self._takes):
            return False
        if ACTION_PARTS in topic:
            return self.actions
        return self.services or not topic.endswith(SERVICE_EVENTS)


def _topic_matcher(pattern: str) -> Callable[[str], bool]:
    # Every absolute name begins with a slash, which people leave away.
    return glob_matcher(pattern if pattern.startswith(("/", "*")) else f"/{pattern}")


#: Everything that tells of itself as a topic.
EVERYTHING = TopicSelection(services=True, actions=True)
