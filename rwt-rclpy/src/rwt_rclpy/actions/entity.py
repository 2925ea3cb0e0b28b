"""Common part of action clients and servers."""

from __future__ import annotations

from abc import abstractmethod
from collections import deque
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, ClassVar

from rwt_rclpy.destroyable import Destroyable
from rwt_rclpy.endpoints.type_support import action_type as type_behind
from rwt_rclpy.exceptions import NameValidationException
from rwt_rclpy.execution.entity import Entity
from rwt_rclpy.messages.loaded import message_class

if TYPE_CHECKING:
    from rwt_rclpy.nodes.node import Node


class ActionEntity(Entity):
    """Entity of an executor whose parts are services, clients and subscriptions.

    Raises:
        ValueError: ROS does not allow the name.
    """

    _what: ClassVar[str]

    def __init__(self, node: Node, action_type: Any, action_name: str, callback_group: Any) -> None:
        super().__init__(callback_group or node.default_callback_group)
        self._interface = type_behind(action_type)
        self._node = node
        self._action_type = action_type
        self._link = node.context._rwt_link
        self._waiting: deque[Callable[[], object]] = deque()
        self._handle = Destroyable(self._close)
        try:
            self._name = node._rwt_resolved(action_name, "name")
        except NameValidationException as error:
            raise ValueError(
                f"Failed to create {self._what} due to invalid topic name '{action_name}' : {error.error_msg}"
            ) from error

    def _join(self) -> None:
        """Let the node's executor handle the parts."""
        self.callback_group.add_entity(self)
        self._node.add_waitable(self)

    def _wake(self) -> None:
        self._rwt_wake()

    def _later(self, call: Callable[[], object]) -> None:
        """Run a function in the executor."""
        self._waiting.append(call)
        self._rwt_wake()

    @abstractmethod
    def _parts(self) -> Iterable[Entity]:
        """Return the parts in the order in which their work is taken."""

    @abstractmethod
    def _close(self) -> None:
        """Destroy the parts."""

    def _rwt_has_work(self) -> bool:
        """True if a part has work."""
        if not self._handle:
            return False
        return bool(self._waiting) or any(each._rwt_has_work() for each in self._parts())

    def _rwt_take(self) -> Callable[[], object] | None:
        """Return the callback of the first part that has work."""
        if self._waiting:
            return self._waiting.popleft()
        for part in self._parts():
            if part._rwt_has_work():
                call = part._rwt_take()
                if call is not None:
                    return call
        return None

    def destroy(self) -> None:
        """Destroy it. Raises ValueError if it was destroyed."""
        self._node.remove_waitable(self)
        self._handle.destroy_when_not_in_use()


def uuid_message(octets: bytes) -> Any:
    """Return a goal's id as `unique_identifier_msgs/UUID`."""
    return message_class("unique_identifier_msgs/UUID")(uuid=list(octets))
