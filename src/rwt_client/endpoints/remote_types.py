"""Types of the robot, from its live graph or the standard set."""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable, Iterable
from contextlib import suppress
from functools import partial
from typing import Final, Literal, TypeVar

import anyio
import msgspec

from rwt_client.rosapi import FieldInfo, RosApi, TypeInfo
from rwt_client.wire.arrays import ArrayKind
from rwt_client.wire.decoding import MessageReader
from rwt_interfaces import JAZZY, Distro, InterfaceError, InvalidName, Registry
from rwt_interfaces.names import parse_type_name
from rwt_interfaces.structs import ActionType, MessageType, ServiceType
from rwt_participant.errors import CallTimeout, NotFound, ProviderNotFound, UnknownType
from rwt_participant.messages import check_interface
from rwt_participant.rosapi_parameters import ADVICE_SECONDS, UNANSWERED, Ask
from rwt_participant.spelling import did_you_mean

logger = logging.getLogger("rwt_client")

T = TypeVar("T")
Interface = TypeVar("Interface", ServiceType, ActionType)

_SEPARATOR: Final = "=" * 80

_OWN_NAMES: Final = {
    "boolean": "bool", "float": "float32", "double": "float64", "octet": "byte",
}  # fmt: skip
"""Scalar types by the names of ROS 2's rosapi (API-04)."""


class RemoteTypes:
    """Types of one robot.

    ``types["nav_msgs/Odometry"]`` is the class of that message; called without arguments it makes a complete
    message. Types that are not in the standard set must be fetched first.

    Attributes:
        registry: registry of all types known so far.
        distro: ROS distribution of the robot; None while unknown.
        is_reported: True if the robot itself has reported its distribution, and so answers such questions.
    """

    def __init__(self, ask: Ask) -> None:
        self._ask = ask
        self._api = RosApi(ask)
        self.registry = Registry(JAZZY)
        self.distro: Distro | None = None
        self.is_reported = False
        self._names: dict[tuple[str, str], str] = {}
        self._checked: set[tuple[str, str, str]] = set()

    # -- for programs ----------------------------------------------------------------------------------------

    def __getitem__(self, name: str) -> type[msgspec.Struct]:
        """Return the class of a message, or of a part of a service or action (``AddTwoInts_Request``).

        Raises:
            UnknownType: it is not in the standard set and has not been fetched.
        """
        try:
            return self.registry.message(name).struct
        except InterfaceError as error:
            raise UnknownType(f"{error}; a type of the robot's own comes with `await types.fetch`") from None

    async def fetch(self, name: str) -> type[msgspec.Struct]:
        """Return the class of a message; asks the robot if it is unknown.

        Raises:
            UnknownType: the robot does not know it either.
        """
        return (await self.message(name)).struct

    def add_text(self, text: str, name: str, kind: Literal["msg", "srv", "action"] = "msg") -> None:
        """Add a definition, in the form of its file.

        Raises:
            UnknownType: the text or the name is invalid.
        """
        try:
            self.registry.add_text(text, name, kind)
        except InterfaceError as error:
            raise UnknownType(f"{name}: {error}") from None

    # -- for the client --------------------------------------------------------------------------------------

    def set_distro(self, distro: Distro | None) -> None:
        """Use the names and times of that distribution; None: of the default one."""
        self.distro = distro
        wanted = distro or JAZZY
        if wanted is not self.registry.distro:
            self.registry = Registry(wanted)

    def reader(self, message_type: MessageType, arrays: ArrayKind = "list") -> MessageReader:
        return MessageReader(message_type, arrays, trusted=self.distro is not None)

    def wire_name(self, interface: MessageType | ServiceType | ActionType) -> str:
        """Return the server's name of a type."""
        return interface.name if self.distro is None else self.registry.type_name(interface)

    def full_text(self, name: str) -> str:
        """Return the definition of a known message and all it contains, as one text (API-06)."""
        return self.registry.full_text(self.registry.message(name))

    def known_message(self, name: str | None) -> MessageType | None:
        """Return a message type if it is known without asking the robot."""
        return None if name is None else _found(self.registry.message, name)

    def known_service(self, name: str) -> ServiceType | None:
        """Return a service type if it is known without asking the robot."""
        return _found(self.registry.service, name)

    def known_action(self, name: str) -> ActionType | None:
        """Return an action type if it is known without asking the robot."""
        return _found(self.registry.action, name)

    async def message(self, name: str) -> MessageType:
        """Return a message type; raises UnknownType."""
        return await self._known(name, self.registry.message, partial(self._fetch_message, name))

    async def service(self, name: str) -> ServiceType:
        """Return a service type; raises UnknownType."""
        parts = (self._api.service_request_details, self._api.service_response_details)
        fetch = partial(self._fetch_parts, name, "srv", parts)
        return await self._known(name, self.registry.service, fetch)

    async def action(self, name: str) -> ActionType:
        """Return an action type; raises UnknownType."""
        api = self._api
        parts = (api.action_goal_details, api.action_result_details, api.action_feedback_details)
        fetch = partial(self._fetch_parts, name, "action", parts)
        return await self._known(name, self.registry.action, fetch)

    async def of_topic(self, topic: str) -> str:
        """Return the type name of a topic; raises NotFound, or UnknownType if the robot does not answer."""
        return await self._name_of("topic", topic)

    async def of_service(self, service: str) -> str:
        """Return the type name of a service; raises ProviderNotFound, or UnknownType as for topics."""
        return await self._cached_name("service", service)

    async def of_action(self, action: str) -> str:
        """Return the type name of an action; raises ProviderNotFound, or UnknownType as for topics."""
        return await self._cached_name("action", action)

    async def service_of(self, service: str, type: str | None) -> ServiceType:
        """Return the type of a service; raises WrongType if `type` is another, else as :meth:`of_service`.

        `type` is not checked if the robot does not report the actual one.
        """
        found = await self.service(type or await self.of_service(service))
        if type is not None:
            await self._check("service", service, found, self.service)
        return found

    async def action_of(self, action: str, type: str | None) -> ActionType:
        """Return the type of an action, as :meth:`service_of`."""
        found = await self.action(type or await self.of_action(action))
        if type is not None:
            await self._check("action", action, found, self.action)
        return found

    async def _check(
        self, what: str, name: str, stated: Interface, find: Callable[[str], Awaitable[Interface]]
    ) -> None:
        if not self.is_reported or (what, name, stated.name) in self._checked:
            return
        try:
            reported = await self._reported_name(what, name)
            package, _, short = parse_type_name(reported)
            if f"{package}/{short}" != stated.name:
                check_interface(name, stated, await find(reported))
            self._checked.add((what, name, stated.name))
        except (*UNANSWERED, InterfaceError) as error:
            self.is_reported = not isinstance(error, CallTimeout)
            logger.debug("the type of %s is not checked: %s", name, error)

    async def refresh(self) -> None:
        """Fetch the definitions of all topics of the live graph; they replace the standard ones (API-06)."""
        answer = await self._ask("topics_and_raw_types", {})
        if not isinstance(answer, dict):
            return
        texts = dict(zip(answer.get("types", ()), answer.get("typedefs_full_text", ()), strict=False))
        for name, text in texts.items():
            if isinstance(name, str) and isinstance(text, str) and name:
                self._add_full_text(name, text)

    # -- fetching ------------------------------------------------------------------------------------------

    async def _known(self, name: str, find: Callable[[str], T], fetch: Callable[[], Awaitable[None]]) -> T:
        try:
            return find(name)
        except (UnknownType, InvalidName) as error:
            unknown = error
        try:
            await fetch()
            return find(name)
        except (*UNANSWERED, InterfaceError) as error:
            # Later answers for this distribution are the same.
            if str(error) == str(unknown):
                raise UnknownType(f"{unknown} (the robot does not know it either)") from None
            raise UnknownType(f"{unknown}; the robot's answer: {error}") from None

    async def _cached_name(self, what: str, name: str) -> str:
        if (what, name) not in self._names:
            self._names[what, name] = await self._name_of(what, name)
        return self._names[what, name]

    async def _name_of(self, what: str, name: str) -> str:
        try:
            found = await self._reported_name(what, name)
        except UNANSWERED as error:
            raise UnknownType(f"the robot does not tell the type of {name}, so name it: {error}") from None
        if not found:
            # A topic that only has subscribers is listed, too.
            others = [each for each in await self._listed(what) if each != name]
            meant = did_you_mean(name, others) or "; name its type if it will come"
            raise (NotFound if what == "topic" else ProviderNotFound)(
                f"the robot knows no {what} {name}{meant}"
            )
        return found

    async def _reported_name(self, what: str, name: str) -> str:
        """Return the type name that the robot reports; empty without one."""
        ask = {"topic": self._api.topic_type, "service": self._api.service_type}
        return await ask.get(what, self._api.action_type)(name)

    async def meant(self, what: str, name: str) -> str:
        """Return `; did you mean X?` with the nearest name that the robot lists; empty if it lists `name`.

        Args:
            what: `topic`, `service` or `action`.
        """
        return did_you_mean(name, await self._listed(what))

    async def _listed(self, what: str) -> tuple[str, ...]:
        with anyio.move_on_after(ADVICE_SECONDS), suppress(*UNANSWERED):
            if what == "topic":
                return tuple(each.name for each in await self._api.topics())
            return await (self._api.services() if what == "service" else self._api.action_servers())
        return ()

    async def _fetch_message(self, name: str) -> None:
        for each, text in definition_texts(await self._api.message_details(name)).items():
            self._add_unknown(each, text)

    async def _fetch_parts(
        self,
        name: str,
        kind: Literal["srv", "action"],
        parts: tuple[Callable[[str], Awaitable[tuple[TypeInfo, ...]]], ...],
    ) -> None:
        sections: list[str] = []
        for ask in parts:
            first, *nested = definition_texts(await ask(name)).items() or [("", "")]
            sections.append(first[1])
            for each, text in nested:
                self._add_unknown(each, text)
        self.registry.add_text("\n---\n".join(sections), name, kind)

    def _add_unknown(self, name: str, text: str) -> None:
        try:
            self.registry.definition(name)
        except InterfaceError:
            self.registry.add_text(text, name)

    def _add_full_text(self, name: str, text: str) -> None:
        root, *nested = text.split(f"\n{_SEPARATOR}\n")
        try:
            package, _, short = parse_type_name(name)
            self._add_changed(f"{package}/{short}", root)
            for section in nested:
                head, _, body = section.partition("\n")
                self._add_changed(head.removeprefix("MSG:").strip(), body)
        except InterfaceError as error:
            logger.warning("the robot's definition of %s cannot be read: %s", name, error)

    def _add_changed(self, name: str, text: str) -> None:
        try:
            known = self.registry.definition(name).text
        except UnknownType:
            known = None
        if known is None or known.strip() != text.strip():
            self.registry.add_text(text, name)


def _found(find: Callable[[str], T], name: str) -> T | None:
    try:
        return find(name)
    except (UnknownType, InvalidName):
        return None


def definition_texts(types: Iterable[TypeInfo]) -> dict[str, str]:
    """Return the definitions that rosapi describes, the requested one first (API-03)."""
    found: dict[str, str] = {}
    for each in types:
        if "/" in each.name:
            package, _, short = parse_type_name(each.name)
            found[f"{package}/{short}"] = "\n".join(map(_line, each.fields))
    return found


def _line(field: FieldInfo) -> str:
    own, length = _OWN_NAMES.get(field.type, field.type), field.array_length
    array = "" if length < 0 else f"[{length or ''}]"
    return f"{own}{array} {field.name}"
