"""The parameters that a node declares.

On ROS 2 they live in the node; on ROS 1 in the graph's tree, below the node's name, and the node watches
them.
"""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol, TypeAlias, TypeVar

from rwt_graph.errors import GraphError
from rwt_graph.names import parameter_name
from rwt_graph.parameters.accounts import Charges
from rwt_graph.parameters.tree import ParameterTree, measured
from rwt_graph.parameters.values import ParameterType, coerce, type_of
from rwt_participant.errors import NotFound, ParameterRejected
from rwt_participant.messages import ParameterValue

logger = logging.getLogger(__name__)

T = TypeVar("T")

#: Called with a new value before it is stored; raises `ParameterRejected` to refuse it.
OnChange: TypeAlias = Callable[[ParameterValue], None]

#: Called with what was stored: name, old value (None when it is new), new value (None when it was deleted).
OnStored: TypeAlias = Callable[[str, ParameterValue, ParameterValue], None]


@dataclass(frozen=True, slots=True)
class Declaration:
    """The declaration of one parameter of a node.

    Attributes:
        type: NOT_SET when the value may be of any type.
    """

    name: str
    type: ParameterType
    description: str
    read_only: bool
    on_change: OnChange | None

    def admitted(self, value: ParameterValue) -> ParameterValue:
        """The value as it will be stored, after the node has agreed.

        Raises:
            ParameterRejected: the parameter is read-only, of another type, or the node refused.
        """
        if self.read_only:
            raise ParameterRejected(f"parameter {self.name} is read-only")
        if self.type is not ParameterType.NOT_SET:
            value = coerce(value, self.type)
        if self.on_change is not None:
            try:
                self.on_change(value)
            except ParameterRejected:
                raise
            except Exception as error:
                logger.exception("the node failed on a new value of its parameter %s", self.name)
                raise ParameterRejected(str(error) or type(error).__name__) from error
        return value


class Store(ABC):
    """Where a node's parameters live; names are the node's own."""

    @abstractmethod
    def declare(self, declaration: Declaration, default: ParameterValue) -> ParameterValue:
        """Add a parameter; the value it has now."""

    @abstractmethod
    def undeclare(self, name: str) -> None:
        """Remove a parameter."""

    @abstractmethod
    def get(self, name: str) -> ParameterValue:
        """The value of a parameter. Raises :exc:`NotFound`."""

    @abstractmethod
    def set(self, declaration: Declaration, value: ParameterValue) -> None:
        """Set a parameter. Raises :exc:`ParameterRejected`."""

    @abstractmethod
    def close(self) -> None:
        """The node leaves."""


class NodeStore(Store):
    """Parameters that live in the node (ROS 2)."""

    def __init__(self, on_stored: OnStored) -> None:
        self._values: dict[str, ParameterValue] = {}
        self._charges = Charges()
        self._on_stored = on_stored

    def declare(self, declaration: Declaration, default: ParameterValue) -> ParameterValue:
        """Add a parameter with its default."""
        value = default
        if declaration.type is not ParameterType.NOT_SET:
            value = coerce(default, declaration.type)
        self._values[declaration.name] = value
        self._on_stored(declaration.name, None, value)
        return value

    def undeclare(self, name: str) -> None:
        """Remove a parameter."""
        self._charges.drop(name)
        self._on_stored(name, self._values.pop(name), None)

    def get(self, name: str) -> ParameterValue:
        """The value of a parameter."""
        return self._values[name]

    def set(self, declaration: Declaration, value: ParameterValue) -> None:
        """Set a parameter. Raises :exc:`ParameterRejected`."""
        value = declaration.admitted(value)
        self._charges.put(declaration.name, measured(value)[1])
        old, self._values[declaration.name] = self._values[declaration.name], value
        self._on_stored(declaration.name, old, value)

    def close(self) -> None:
        """Forget the values, without events: the parameters end with their node."""
        self._values.clear()
        self._charges.drop_below("")


class TreeStore(Store):
    """Parameters in the tree, below the node's name (ROS 1). A value set before the node joined wins over its
    default."""

    def __init__(self, tree: ParameterTree, node: str) -> None:
        self._tree = tree
        self._node = node
        self._unwatch: dict[str, Callable[[], None]] = {}

    def _full(self, name: str) -> str:
        return f"{self._node}/{name}"

    def declare(self, declaration: Declaration, default: ParameterValue) -> ParameterValue:
        """Add a parameter, and watch it."""
        full = self._full(declaration.name)
        if self._tree.has(full):
            declaration.admitted(self._tree.get(full))
        else:
            self._tree.set(full, default)
        self._unwatch[declaration.name] = self._tree.watch(full, lambda value: _watch(declaration, value))
        return self._tree.get(full)

    def undeclare(self, name: str) -> None:
        """Stop watching; the value stays, as values of ROS 1 outlive their nodes."""
        self._unwatch.pop(name)()

    def get(self, name: str) -> ParameterValue:
        """The value of a parameter. Raises :exc:`NotFound` when it was deleted from the tree."""
        return self._tree.get(self._full(name))

    def set(self, declaration: Declaration, value: ParameterValue) -> None:
        """Set a parameter. Raises :exc:`ParameterRejected`."""
        self._tree.set(self._full(declaration.name), value)

    def close(self) -> None:
        """Stop watching; the values stay."""
        for unwatch in self._unwatch.values():
            unwatch()
        self._unwatch.clear()


def _watch(declaration: Declaration, value: ParameterValue) -> None:
    declaration.admitted(value)


class RunOnGraph(Protocol):
    """Runs a function on the graph's thread and waits for what it returns or raises."""

    def __call__(self, function: Callable[[], T], /) -> T:
        """Run it."""
        ...


class NodeParameters:
    """A node's declared parameters; its methods may be called from any thread once the graph runs.

    Args:
        node: absolute name, for error texts.
        dynamic: whether values that ROS 2 has no type for (dictionaries, mixed lists) are allowed (ROS 1).
        run: runs a function on the graph's thread and waits for it.
    """

    def __init__(self, node: str, store: Store, dynamic: bool, run: RunOnGraph) -> None:
        self._run = run
        self._node = node
        self._store = store
        self._dynamic = dynamic
        self._declared: dict[str, Declaration] = {}

    def declare(
        self,
        name: str,
        default: ParameterValue,
        *,
        description: str = "",
        on_change: OnChange | None = None,
        read_only: bool = False,
    ) -> ParameterValue:
        """Add a parameter.

        Args:
            name: the node's own name for it (`max_speed`, `arm.gain`).
            default: its value; the type is fixed by it. None lets it be of any type (ROS 2), of none yet.
            on_change: called with each new value before it is stored; raises :exc:`ParameterRejected` to
                refuse. Not called with the default.
            read_only: it cannot be set, not even by the node.

        Returns:
            The value now: the default, or on ROS 1 what was set before the node joined.

        Raises:
            ParameterRejected: the default is of no type that ROS 2 has.
            GraphError: the node declared that name already.
        """
        parameter_name(name)
        if name in self._declared:
            raise GraphError(f"node {self._node} has declared the parameter {name} already")
        kind = self._type_of(default)
        declaration = Declaration(name, kind, description, read_only, on_change)

        def declare() -> ParameterValue:
            value = self._store.declare(declaration, default)
            self._declared[name] = declaration
            return value

        return self._run(declare)

    def _type_of(self, default: ParameterValue) -> ParameterType:
        try:
            return type_of(default)
        except ParameterRejected:
            if self._dynamic:
                return ParameterType.NOT_SET
            raise

    def undeclare(self, name: str) -> None:
        """Remove a parameter. Raises :exc:`NotFound`."""
        self.declaration(name)

        def undeclare() -> None:
            del self._declared[name]
            self._store.undeclare(name)

        self._run(undeclare)

    def declaration(self, name: str) -> Declaration:
        """The declaration of a parameter. Raises :exc:`NotFound`."""
        declaration = self._declared.get(name)
        if declaration is None:
            raise NotFound(f"node {self._node} has no parameter {name}")
        return declaration

    def has(self, name: str) -> bool:
        """Whether the node declared a parameter."""
        return name in self._declared

    def get(self, name: str) -> ParameterValue:
        """The value of a parameter. Raises :exc:`NotFound`."""
        self.declaration(name)
        return self._store.get(name)

    def set(self, name: str, value: ParameterValue) -> None:
        """Set a parameter.

        Raises:
            ParameterRejected: not declared, read-only, of another type, or refused by the node.
        """
        if name not in self._declared:
            raise ParameterRejected(f"parameter {name} cannot be set because it was not declared")
        declaration = self._declared[name]
        self._run(lambda: self._store.set(declaration, value))

    def delete(self, name: str) -> None:
        """Delete a parameter, which must be of any type (ROS 2's rule).

        Raises:
            ParameterRejected: not declared, read-only or of a fixed type.
        """
        if name not in self._declared:
            raise ParameterRejected(f"parameter {name} cannot be deleted because it was not declared")
        declaration = self._declared[name]
        if declaration.read_only or declaration.type is not ParameterType.NOT_SET:
            why = "read-only" if declaration.read_only else "of a fixed type"
            raise ParameterRejected(f"parameter {name} cannot be deleted because it is {why}")
        self.undeclare(name)

    def set_all(self, values: Iterable[tuple[str, ParameterValue]]) -> None:
        """Set several parameters or none: when one is refused, those before it get their old values back.

        Raises:
            ParameterRejected: one was refused.
        """
        done: list[tuple[str, ParameterValue]] = []
        try:
            for name, value in values:
                old = self._store.get(name) if name in self._declared else None
                self.set(name, value)
                done.append((name, old))
        except ParameterRejected:
            for name, old in reversed(done):
                self.set(name, old)
            raise

    def names(self) -> tuple[str, ...]:
        """The names of the node's parameters, sorted."""
        return tuple(sorted(self._declared))

    def close(self) -> None:
        """Forget the declarations; the node leaves."""
        self._declared.clear()
        self._store.close()
