"""Selection of topics by patterns, as recordings and `rwt top` use it."""

from __future__ import annotations

from dataclasses import dataclass
from fnmatch import fnmatchcase

from rwt_participant.api import ACTION_PARTS, SERVICE_EVENTS


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

    def takes(self, topic: str) -> bool:
        """Return True if a topic is selected. One that `topics` names in full is, whatever its kind."""
        if any(_fits(topic, pattern) for pattern in self.exclude):
            return False
        if topic in self.topics:
            return True
        if self.topics and not any(_fits(topic, pattern) for pattern in self.topics):
            return False
        if ACTION_PARTS in topic:
            return self.actions
        return self.services or not topic.endswith(SERVICE_EVENTS)


def _fits(topic: str, pattern: str) -> bool:
    # Every absolute name begins with a slash, which people leave away.
    return fnmatchcase(topic, pattern if pattern.startswith(("/", "*")) else f"/{pattern}")


#: Everything that tells of itself as a topic.
EVERYTHING = TopicSelection(services=True, actions=True)
