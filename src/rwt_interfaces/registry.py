"""Registry of types: the standard types of one distribution, and user-defined types.

Everything is loaded lazily: a look-up splits one package's texts, and parses and compiles only the requested
definition and its nested ones.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Sequence
from os import PathLike
from pathlib import Path
from typing import Final, TypeVar

from rwt_interfaces import standard
from rwt_interfaces.definitions import actionlib, parser
from rwt_interfaces.definitions.model import (
    PRIMITIVES,
    ActionDefinition,
    Field,
    MessageDefinition,
    ServiceDefinition,
)
from rwt_interfaces.definitions.parser import MOST_ELEMENTS
from rwt_interfaces.distro import JAZZY, Distro
from rwt_interfaces.errors import DefinitionError, InvalidName, UnknownType
from rwt_interfaces.names import KINDS, Kind, parse_type_name, three_part
from rwt_interfaces.spelling import Words
from rwt_interfaces.structs import ActionType, MessageType, ServiceType

_SEPARATOR = "=" * 80
_NOUNS: dict[Kind, str] = {"msg": "a message", "srv": "a service", "action": "an action"}

#: Maximum depth of nested messages.
MOST_LEVELS: Final = 50

#: Names of primitives in other languages.
_OTHER_LANGUAGES: Final = {
    "boolean": "bool",
    "int": "int32",
    "integer": "int32",
    "long": "int64",
    "uint": "uint32",
    "float": "float32 or float64",
    "double": "float64",
    "str": "string",
    "bytes": "uint8[]",
}

_Definition = MessageDefinition | ServiceDefinition | ActionDefinition
_PARSERS: Final[dict[Kind, Callable[..., _Definition]]] = {
    "msg": parser.parse_message,
    "srv": parser.parse_service,
    "action": parser.parse_action,
}
_Found = TypeVar("_Found", bound=_Definition)
_Type = TypeVar("_Type", MessageType, ServiceType, ActionType)


class Registry:
    """Types of one distribution, and user-defined types. Thread-safe.

    Names are accepted in both spellings (``std_msgs/String``, ``std_msgs/msg/String``). :meth:`message` also
    knows the derived messages on either distribution: parts of services and actions (``SetBool_Request`` and
    ``SetBoolRequest``), and ROS 1's action messages (``FibonacciAction``, ``FibonacciActionGoal``, …). A part
    is one type in either spelling; it reports the distribution's.

    User definitions override standard ones, in this registry only. Types returned earlier do not change, so
    add definitions first.

    Attributes:
        distro: distribution of the standard types and of the spelling of :meth:`type_name`.
        advice: end of the text of errors about unknown types: how to add them.
    """

    def __init__(self, distro: Distro = JAZZY) -> None:
        self.distro = distro
        self.advice = ""
        self._lock = threading.RLock()
        self._user: dict[tuple[Kind, str], _Definition] = {}
        self._definitions: dict[tuple[Kind, str], _Definition] = {}
        # Keyed by the requested spelling, so that repeated requests are one dictionary look-up.
        self._messages: dict[str, MessageType] = {}
        self._services: dict[str, ServiceType] = {}
        self._actions: dict[str, ActionType] = {}
        # Keyed by type: lists of a whole robot request every name.
        self._type_names: dict[MessageType | ServiceType | ActionType, str] = {}
        self._known: dict[Kind, _Known] = {}

    # Types

    def message(self, name: str) -> MessageType:
        """Return a message by name, compiled on first use.

        Raises:
            UnknownType: it or a nested message is unknown; the text names similar names.
            DefinitionError: it contains itself.
        """
        found = self._messages.get(name)
        return found or self._compiled(
            self._messages, "msg", name, self._message_definition, self._new_message
        )

    def service(self, name: str) -> ServiceType:
        """Return a service by name; raises UnknownType."""
        found = self._services.get(name)
        return found or self._compiled(
            self._services, "srv", name, self._service_definition, self._new_service
        )

    def action(self, name: str) -> ActionType:
        """Return an action by name, in ROS 1 also ``FibonacciAction``; raises UnknownType."""
        found = self._actions.get(name)
        return found or self._compiled(
            self._actions, "action", name, self._action_or_its_message, self._new_action
        )

    def _compiled(
        self,
        known: dict[str, _Type],
        kind: Kind,
        name: str,
        find: Callable[[str, str], _Found | None],
        make: Callable[[_Found], _Type],
    ) -> _Type:
        with self._lock:
            definition = self._wanted(kind, name, find)
            compiled = known.get(definition.name)
            if compiled is None:
                compiled = known.setdefault(definition.name, make(definition))
            known[_cache_key(name)] = compiled
            return compiled

    def _new_message(self, definition: MessageDefinition) -> MessageType:
        self._check_nested(definition)
        return MessageType(definition, self)

    def _new_service(self, definition: ServiceDefinition) -> ServiceType:
        return ServiceType(definition.name, *(self.message(part.name) for part in _parts(definition)))

    def _new_action(self, definition: ActionDefinition) -> ActionType:
        return ActionType(definition.name, *(self.message(part.name) for part in _parts(definition)))

    # The user's own

    def add_text(self, text: str, name: str, kind: Kind = "msg") -> None:
        """Add a definition, replacing any other of the same name.

        Args:
            text: content of the ``.msg``, ``.srv`` or ``.action`` file.
            name: two-part or three-part, for example ``my_robot/Status``.
            kind: ``msg``, ``srv`` or ``action``.

        Raises:
            DefinitionError: the text is invalid; the error names the line.
            InvalidName: `name` is not a type name, or `kind` not a kind.
        """
        if kind not in KINDS:
            raise InvalidName(f'"{kind}" is not a kind of interface: expected msg, srv or action')
        self._add([(kind, self._parse(kind, name, text, ""))])

    def add_messages(self, definitions: Iterable[MessageDefinition]) -> None:
        """Add messages that another registry has parsed."""
        self._add([("msg", each) for each in definitions])

    def add_directory(self, path: str | PathLike[str]) -> None:
        """Add a package, or every package below a folder; nothing is added on errors.

        A package has a folder ``msg``, ``srv`` or ``action`` with such files, and the name in its
        ``package.xml``, or else its folder's name.

        Raises:
            DefinitionError: a file is invalid; the error names the file and the line.
        """
        from rwt_interfaces.definitions.package_directories import interface_files  # Few have own types.

        found: dict[tuple[Kind, str], tuple[_Definition, Path]] = {}
        for file in interface_files(Path(path)):
            name = f"{file.package}/{file.name}"
            definition = self._parse(file.kind, name, file.read(), str(file.path))
            earlier, where = found.setdefault((file.kind, name), (definition, file.path))
            if earlier != definition:
                raise DefinitionError(f"{file.path}: {name} is defined differently in {where}")
        self._add((kind, definition) for (kind, _), (definition, _) in found.items())

    def verify(self) -> None:
        """Check that all messages in user definitions are known. Call after adding all of them.

        Raises:
            UnknownType: a definition refers to an unknown message.
            DefinitionError: a definition contains itself.
        """
        with self._lock:
            for definition in self._user.values():
                for part in _parts(definition):
                    self._check_nested(part)

    def _add(self, definitions: Iterable[tuple[Kind, _Definition]]) -> None:
        added = {(kind, definition.name): definition for kind, definition in definitions}
        with self._lock:
            changed = any(self._definitions.get(key, added[key]) != added[key] for key in added) or any(
                kind == "msg" and (kind, name) not in self._definitions and name in self._messages
                for kind, name in added
            )
            self._user.update(added)
            self._definitions.update(added)
            self._type_names, self._known = {}, {}
            if changed:
                # Compiled types may contain the replaced one. Definitions are added at start-up, so
                # recompiling all types is acceptable.
                self._definitions = dict(self._user)
                self._messages, self._services, self._actions = {}, {}, {}

    def _parse(self, kind: Kind, name: str, text: str, source: str) -> _Definition:
        return _PARSERS[kind](text, name, source=source, distro=self.distro)

    # Definitions

    def definition(self, name: str) -> MessageDefinition:
        """Return the definition of a message, or of a part of a service or action; raises UnknownType."""
        return self._wanted("msg", name, self._message_definition)

    def known_definition(self, name: str) -> MessageDefinition | None:
        """Return the :meth:`definition`, or None if it is unknown: fast, without suggestions."""
        try:
            package, _, short = parse_type_name(name)
        except InvalidName:
            return None
        with self._lock:
            return self._message_definition(package, short)

    def _message_definition(self, package: str, name: str) -> MessageDefinition | None:
        found = self._read("msg", package, name)
        if isinstance(found, MessageDefinition):
            return found
        return (
            self._part(self._service_definition, actionlib.SERVICE_PARTS, package, name)
            or self._action_part(package, name)
            or self._wrapper(package, name)
            or self._introspected(package, name)
        )

    def _service_definition(self, package: str, name: str) -> ServiceDefinition | None:
        found = self._read("srv", package, name)
        return found if isinstance(found, ServiceDefinition) else self._action_service(package, name)

    def _action_service(self, package: str, name: str) -> ServiceDefinition | None:
        """Return `X_SendGoal` or `X_GetResult`, which only ROS 2 has."""
        for which in actionlib.ACTION_SERVICES if self.distro.action_transport == "services" else ():
            if name.endswith(which):
                action = self._action_definition(package, name.removesuffix(which))
                return None if action is None else actionlib.action_service(action, which)
        return None

    def _introspected(self, package: str, name: str) -> MessageDefinition | None:
        """Return `X_Event` of a service or `X_FeedbackMessage` of an action, which only ROS 2 has."""
        if name.endswith(actionlib.FEEDBACK_MESSAGE) and self.distro.action_transport == "services":
            action = self._action_definition(package, name.removesuffix(actionlib.FEEDBACK_MESSAGE))
            return None if action is None else actionlib.feedback_message(action)
        if name.endswith(actionlib.EVENT) and self.distro.introspects_calls:
            service = self._service_definition(package, name.removesuffix(actionlib.EVENT))
            return None if service is None else actionlib.service_event(service)
        return None

    def _action_definition(self, package: str, name: str) -> ActionDefinition | None:
        found = self._read("action", package, name)
        return found if isinstance(found, ActionDefinition) else None

    def _action_or_its_message(self, package: str, name: str) -> ActionDefinition | None:
        return self._action_definition(package, name) or self._action_definition(
            package, name.removesuffix("Action")
        )

    def _part(
        self, find: Callable[[str, str], _Found | None], suffixes: tuple[str, ...], package: str, name: str
    ) -> MessageDefinition | None:
        """Return the request of a service, the goal of an action and so on."""
        short, part = actionlib.split_part(name, suffixes)
        found = find(package, short) if short else None
        return None if found is None else _parts(found)[suffixes.index(part)]

    def _action_part(self, package: str, name: str) -> MessageDefinition | None:
        return self._part(self._action_definition, actionlib.ACTION_PARTS, package, name)

    def _wrapper(self, package: str, name: str) -> MessageDefinition | None:
        for which in actionlib.WRAPPERS:
            if name.endswith(which):
                action = self._action_definition(package, name.removesuffix(which))
                return None if action is None else actionlib.wrapper(action, which)
        return None

    def _read(self, kind: Kind, package: str, name: str) -> _Definition | None:
        key = (kind, f"{package}/{name}")
        found = self._definitions.get(key)
        if found is None:
            text = standard.package(self.distro.name, package).get((kind, name))
            if text is not None:
                found = self._definitions.setdefault(key, self._parse(kind, key[1], text, ""))
        return found

    def _wanted(self, kind: Kind, name: str, find: Callable[[str, str], _Found | None]) -> _Found:
        try:
            package, _, short = parse_type_name(name)
        except InvalidName as error:
            raise UnknownType(f"{error}{self._meant(kind, name)}") from None
        with self._lock:
            found = find(package, short)
        if found is None:
            raise UnknownType(self._unknown(kind, f"{package}/{short}") + self.advice)
        return found

    def _check_nested(self, definition: MessageDefinition) -> None:
        """Check that nested messages are known, within limits, and not recursive."""
        # Depth of each message, including its own level, and number of its fixed elements.
        checked: dict[str, tuple[int, int]] = {}

        def check(current: MessageDefinition, within: tuple[str, ...]) -> tuple[int, int]:
            if current.name in within:
                raise DefinitionError(
                    f"{current.name} contains itself: {' > '.join((*within, current.name))}"
                )
            if current.name in checked:
                return checked[current.name]
            levels, elements = 0, 0
            for field in current.fields:
                deep, each = 0, 1
                if not field.type.is_primitive:
                    if len(within) >= MOST_LEVELS:
                        raise DefinitionError(_too_deep(within[0]))
                    try:
                        nested = self.definition(field.type.name)
                    except UnknownType as error:
                        raise UnknownType(self._unknown_field(current, field, str(error))) from None
                    deep, each = check(nested, (*within, current.name))
                sequence = field.type.is_array and field.type.length is None
                elements += 0 if sequence else each * (field.type.length or 1)
                levels = max(levels, deep)
            if levels >= MOST_LEVELS:
                raise DefinitionError(_too_deep(current.name))
            if elements > MOST_ELEMENTS:
                raise DefinitionError(
                    f"{current.name} has {elements} elements in fields and arrays of fixed lengths, "
                    f"and {MOST_ELEMENTS} is the limit"
                )
            checked[current.name] = levels + 1, elements
            return levels + 1, elements

        check(definition, ())

    # Names and texts

    def names(self, kind: Kind) -> tuple[str, ...]:
        """Return the sorted two-part names of all known interfaces of that kind.

        On ROS 1 the messages include the parts and topic messages of actions, which are files there; on ROS 2
        they are known but not listed. Parts of services are never listed.
        """
        found = {
            f"{package}/{name}"
            for package in standard.packages(self.distro.name)
            for present, name in standard.package(self.distro.name, package)
            if present == kind
        }
        found.update(name for present, name in self._user if present == kind)
        if kind == "msg" and self.distro.action_transport == "topics":
            suffixes = (*actionlib.ACTION_PARTS, *actionlib.WRAPPERS)
            found.update(f"{action}{suffix}" for action in self.names("action") for suffix in suffixes)
        return tuple(sorted(found))

    def full_name(self, name: str) -> str:
        """Return the three-part name of a message; the middle part is its folder
        (``std_srvs/srv/SetBool_Request``).

        Raises:
            UnknownType: the message is unknown.
        """
        definition = self.definition(name)
        package, short = definition.name.split("/")
        return three_part(definition.name, self._kind_of(package, short))

    def _kind_of(self, package: str, short: str) -> Kind:
        """Return the folder of the definition of a message."""
        if self._read("msg", package, short) is not None:
            return "msg"
        service = short.removesuffix(actionlib.EVENT)
        asked = actionlib.split_part(service, actionlib.SERVICE_PARTS)[0] or service
        if self._action_service(package, asked) is not None:
            return "action"
        if self._service_definition(package, asked) is not None:
            return "srv"
        made_by_rule = short.endswith(actionlib.FEEDBACK_MESSAGE)
        return "action" if made_by_rule or self._action_part(package, short) is not None else "msg"

    def type_name(self, interface: MessageType | ServiceType | ActionType) -> str:
        """Return the name of a type in this distribution: ``std_msgs/msg/String`` or ``std_msgs/String``."""
        if not self.distro.has_three_part_names:
            return interface.name
        name = self._type_names.get(interface)
        if name is None:
            name = self._type_names[interface] = self._three_part_name(interface)
        return name

    def _three_part_name(self, interface: MessageType | ServiceType | ActionType) -> str:
        owner = interface.parts[0].registry
        if owner is not self:  # A type that contradicts this registry, whose name may be unknown here.
            return owner.type_name(interface)
        if isinstance(interface, ServiceType):
            package, short = interface.name.split("/")
            made_by_rule = self._read("srv", package, short) is None
            return three_part(interface.name, "action" if made_by_rule else "srv")
        if isinstance(interface, ActionType):
            return three_part(interface.name, "action")
        return self.full_name(interface.name)

    def full_text(self, message: MessageType) -> str:
        """Return the definitions of a message and of all nested ones, as one text (API-06).

        The message comes first; an empty line, a line of 80 ``=`` and ``MSG: pkg/Name`` precede each other
        one. Texts are as written, including comments; standard interfaces have none.
        """
        nested: dict[str, str] = {}
        self._collect(message.definition, nested)
        sections = (f"\n{_SEPARATOR}\nMSG: {name}\n{text}" for name, text in nested.items())
        return "".join((message.definition.text, *sections))

    def _collect(self, definition: MessageDefinition, nested: dict[str, str]) -> None:
        for field in definition.fields:
            if not field.type.is_primitive and field.type.name not in nested:
                inner = self.definition(field.type.name)
                nested[field.type.name] = inner.text
                self._collect(inner, nested)

    def _unknown(self, kind: Kind, name: str) -> str:
        package, short = name.split("/")
        text = f'no {_NOUNS[kind].split()[1]} "{name}" is known'
        for other in KINDS:
            if other != kind and self._read(other, package, short) is not None:
                return f"{text}: it is {_NOUNS[other]}"
        return f"{text}{self._meant(kind, name)}"

    def _unknown_field(self, definition: MessageDefinition, field: Field, text: str) -> str:
        where = field.where or f"{definition.name}, field {field.name}"
        package, word = field.type.name.split("/")
        if package != definition.name.split("/")[0]:
            return f"{where}: {text}"
        # A name without a package may stand for a primitive or for a message of any package.
        messages: dict[str, str] = {}
        own = f"{package}/"
        for name in sorted(
            self.names("msg"), key=lambda name: (not name.startswith(own), *_commonness(name))
        ):
            messages.setdefault(name.split("/")[1], name)
        primitives = PRIMITIVES if self.distro.has_time_primitives else PRIMITIVES - {"time", "duration"}
        near = Words([*sorted(primitives), *messages]).similar(word, cutoff=0.75)
        meant = _OTHER_LANGUAGES.get(word.lower()) or " or ".join(messages.get(each, each) for each in near)
        known = f'no primitive is called "{word}", and no message of {package}'
        return f"{where}: {known}{f'; did you mean {meant}?' if meant else ''}"

    def _meant(self, kind: Kind, name: str) -> str:
        """Return suggestions: the same word in other packages, or else similar names."""
        known = self._known.get(kind)
        if known is None:
            known = self._known[kind] = _Known(self.names(kind))
        near = known.elsewhere.get(name.rpartition("/")[2].lower(), [])[:3]
        near = near or known.words.similar(name, count=3, cutoff=0.75)
        return f"; did you mean {' or '.join(near)}?" if near else ""


class _Known:
    """Names of one kind of interface, for suggestions.

    Attributes:
        elsewhere: names by their word without the package, the most common first.
        words: index for similar names.
    """

    __slots__ = ("elsewhere", "words")

    def __init__(self, names: Sequence[str]) -> None:
        self.elsewhere: dict[str, list[str]] = {}
        for name in sorted(names, key=_commonness):
            self.elsewhere.setdefault(name.partition("/")[2].lower(), []).append(name)
        self.words = Words(names)


def _commonness(name: str) -> tuple[bool, str]:
    """Return a sort key: standard packages before those that only repeat their names."""
    return not name.startswith("std_"), name


def _too_deep(name: str) -> str:
    return f"{name} contains messages within messages deeper than {MOST_LEVELS} levels"


def _cache_key(name: str) -> str:
    """Return the cache key of a spelling, without redundant slashes, which peers could vary endlessly."""
    package, kind, short = parse_type_name(name)
    return f"{package}/{kind}/{short}" if kind else f"{package}/{short}"


def _parts(definition: _Definition) -> tuple[MessageDefinition, ...]:
    if isinstance(definition, MessageDefinition):
        return (definition,)
    if isinstance(definition, ServiceDefinition):
        return (definition.request, definition.response)
    return (definition.goal, definition.result, definition.feedback)
