"""Parameters that a node declares.

On ROS 2 they are stored in the node; on ROS 1 in the graph's tree, below the node's name, which the node
watches.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TypeAlias

from rwt_graph.accounts import Charges
from rwt_graph.errors import GraphError
from rwt_graph.names import parameter_name
from rwt_graph.parameters.tree import ParameterTree, measured
from rwt_graph.parameters.values import ParameterType, coerce, type_of
from rwt_participant.errors import NotFound, ParameterRejected
from rwt_participant.messages import ParameterValue

logger = logging.getLogger(__name__)

#: Called with a new value before it is stored; raises `ParameterRejected` to reject it.
OnChange: TypeAlias = Callable[[ParameterValue], None]

#: Called after a change: name, old value (None for a new one), new value (None for a deleted one).
OnStored: TypeAlias = Callable[[str, ParameterValue, ParameterValue], None]

#: Runs a function on the graph's thread, and returns or raises its outcome.
_RunAndWait: TypeAlias = Callable[[Callable[[], ParameterValue]], ParameterValue]


@dataclass(frozen=True, slots=True)
class Declaration:
    """Declaration of one parameter of a node.

    Attributes:
        type: fixed type; NOT_SET if the value may be of any type.
    """

    name: str
    type: ParameterType
    description: str
    read_only: bool
    on_change: OnChange | None

    def admitted(self, value: ParameterValue) -> ParameterValue:
        """Return the value to store, after the node's own check.

        Raises:
            ParameterRejected: the parameter is read-only or of another type, or the node rejected the value.
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


class NodeStore:
    """Storage of parameters in the node, by the node's own names (ROS 2)."""

    def __init__(self, on_stored: OnStored) -> None:
        self._values: dict[str, ParameterValue] = {}
        self._charges = Charges()
        self._on_stored = on_stored

    def declare(self, declaration: Declaration, default: ParameterValue) -> ParameterValue:
        """Add a parameter; return its current value."""
        value = default
        if declaration.type is not ParameterType.NOT_SET:
            value = coerce(default, declaration.type)
        self._values[declaration.name] = value
        self._on_stored(declaration.name, None, value)
        return value

    def undeclare(self, name: str) -> None:
        self._charges.drop(name)
        self._on_stored(name, self._values.pop(name), None)

    def get(self, name: str) -> ParameterValue:
        return self._values[name]

    def set(self, declaration: Declaration, value: ParameterValue) -> None:
        value = declaration.admitted(value)
        self._charges.put(declaration.name, measured(value)[1])
        old, self._values[declaration.name] = self._values[declaration.name], value
        self._on_stored(declaration.name, old, value)

    def close(self) -> None:
        """Discard the values, without events: the parameters end with their node."""
        self._values.clear()
        self._charges.drop_below("")


class TreeStore:
    """Storage in the tree, below the node's name (ROS 1); otherwise as :class:`NodeStore`.

    An earlier value takes precedence over the default.
    """

    def __init__(self, tree: ParameterTree, node: str) -> None:
        self._tree = tree
        self._node = node
        self._unwatch: dict[str, Callable[[], None]] = {}

    def _full(self, name: str) -> str:
        return f"{self._node}/{name}"

    def declare(self, declaration: Declaration, default: ParameterValue) -> ParameterValue:
        full = self._full(declaration.name)
        if self._tree.has(full):
            declaration.admitted(self._tree.get(full))
        else:
            self._tree.set(full, default)
        self._unwatch[declaration.name] = self._tree.watch(full, declaration.admitted)
        return self._tree.get(full)

    def undeclare(self, name: str) -> None:
        """Stop watching; the value is kept, as ROS 1's values outlive their nodes."""
        self._unwatch.pop(name)()

    def get(self, name: str) -> ParameterValue:
        """Return the value of a parameter. Raises :exc:`NotFound` if it was deleted from the tree."""
        return self._tree.get(self._full(name))

    def set(self, declaration: Declaration, value: ParameterValue) -> None:
        self._tree.set(self._full(declaration.name), value)

    def close(self) -> None:
        """Stop watching; the values are kept."""
        for unwatch in self._unwatch.values():
            unwatch()
        self._unwatch.clear()


class NodeParameters:
    """Declared parameters of a node; methods may be called from any thread once the graph runs.

    Args:
        node: absolute name, for error texts.
        dynamic: True to allow values without a type in ROS 2 (dictionaries, mixed lists), as on ROS 1.
    """

    def __init__(self, node: str, store: NodeStore | TreeStore, dynamic: bool, run: _RunAndWait) -> None:
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
            name: the node's own name of the parameter (`max_speed`, `arm.gain`).
            default: default value, which fixes the type. With None the type is free on ROS 2, not yet fixed
                on ROS 1.
            on_change: called with each new value before it is stored; raises :exc:`ParameterRejected` to
                reject it. Not called with the default.
            read_only: reject every change, even by the node.

        Returns:
            Current value: the default, or on ROS 1 a value that was set before the node joined.

        Raises:
            ParameterRejected: ROS 2 has no type for the default.
            GraphError: the node has already declared that name.
        """
        parameter_name(name)
        if name in self._declared:
            raise GraphError(f"node {self._node} has declared the parameter {name} already")
        try:
            kind = type_of(default)
        except ParameterRejected:
            if not self._dynamic:
                raise
            kind = ParameterType.NOT_SET
        declaration = Declaration(name, kind, description, read_only, on_change)

        def declare() -> ParameterValue:
            value = self._store.declare(declaration, default)
            self._declared[name] = declaration
            return value

        return self._run(declare)

    def undeclare(self, name: str) -> None:
        """Remove a parameter. Raises :exc:`NotFound`."""
        self.declaration(name)

        def undeclare() -> None:
            del self._declared[name]
            self._store.undeclare(name)

        self._run(undeclare)

    def declaration(self, name: str) -> Declaration:
        """Return the declaration of a parameter. Raises :exc:`NotFound`."""
        declaration = self._declared.get(name)
        if declaration is None:
            raise NotFound(f"node {self._node} has no parameter {name}")
        return declaration

    def has(self, name: str) -> bool:
        """Return True if the node declared the parameter."""
        return name in self._declared

    def get(self, name: str) -> ParameterValue:
        """Return the value of a parameter. Raises :exc:`NotFound`."""
        self.declaration(name)
        return self._store.get(name)

    def set(self, name: str, value: ParameterValue) -> None:
        """Set a parameter.

        Raises:
            ParameterRejected: it is undeclared, read-only or of another type, or the node rejected the value.
        """
        if name not in self._declared:
            raise ParameterRejected(f"parameter {name} cannot be set because it was not declared")
        declaration = self._declared[name]
        self._run(lambda: self._store.set(declaration, value))

    def delete(self, name: str) -> None:
        """Delete a parameter, whose type must not be fixed (ROS 2's rule).

        Raises:
            ParameterRejected: it is undeclared, read-only or of a fixed type.
        """
        if name not in self._declared:
            raise ParameterRejected(f"parameter {name} cannot be deleted because it was not declared")
        declaration = self._declared[name]
        if declaration.read_only or declaration.type is not ParameterType.NOT_SET:
            why = "read-only" if declaration.read_only else "of a fixed type"
            raise ParameterRejected(f"parameter {name} cannot be deleted because it is {why}")
        self.undeclare(name)

    def set_all(self, values: Iterable[tuple[str, ParameterValue]]) -> None:
        """Set several parameters atomically: if one is rejected, the others get their old values back.

        Raises:
            ParameterRejected: one was rejected.
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
        """Return the names of the node's parameters, sorted."""
        return tuple(sorted(self._declared))

    def close(self) -> None:
        """Discard the declarations when the node leaves."""
        self._declared.clear()
        self._store.close()
