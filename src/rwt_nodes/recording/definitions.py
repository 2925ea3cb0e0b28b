"""From the definitions in a recording to types: what a registry does not know, or knows otherwise."""

from __future__ import annotations

import logging
from typing import Final

from rwt_interfaces import InterfaceError, Registry
from rwt_interfaces.definitions.parser import parse_message
from rwt_interfaces.names import two_part
from rwt_nodes.recording.recording import Recording

logger = logging.getLogger(__name__)

_SEPARATOR: Final = "=" * 80
_EVENT: Final = "_Event"


def learn(registry: Registry, recording: Recording) -> None:
    """Add the types of a recording to a registry; those of the recording win.

    Types handed out before do not change. A definition that cannot be read is logged and left out.
    """
    for topic in recording.topics:
        if topic.definition:
            try:
                _learn(registry, topic.type, topic.definition)
            except InterfaceError as error:
                logger.warning("the definition of %s in the recording is not used: %s", topic.type, error)


def _learn(registry: Registry, name: str, text: str) -> None:
    root, *nested = text.replace("\r\n", "\n").split(f"{_SEPARATOR}\n")
    texts = {two_part(name): root.rstrip("\n")}
    for section in nested:
        head, _, body = section.partition("\n")
        texts[two_part(head.removeprefix("MSG:").strip())] = body.rstrip("\n")
    if name.endswith(_EVENT) and "/srv/" in name:
        _learn_service(registry, two_part(name).removesuffix(_EVENT), texts)
    for each, definition in texts.items():
        if not _known(registry, each, definition):
            registry.add_text(definition, each)


def _learn_service(registry: Registry, name: str, texts: dict[str, str]) -> None:
    """Put a service together from the event message that service introspection publishes."""
    request, response = texts.get(f"{name}_Request"), texts.get(f"{name}_Response")
    if request is None or response is None:
        return
    if _known(registry, f"{name}_Request", request) and _known(registry, f"{name}_Response", response):
        return
    registry.add_text(f"{request}\n---\n{response}", name, "srv")


def _known(registry: Registry, name: str, text: str) -> bool:
    """Whether a registry has a message of that name with those fields and constants."""
    try:
        known = registry.definition(name)
    except InterfaceError:
        return False
    return known == parse_message(text, name, distro=registry.distro)


__all__ = ["learn"]
