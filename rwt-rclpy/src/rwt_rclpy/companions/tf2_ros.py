"""`tf2_ros` and `tf2_py`: transforms over time, on this project's own buffer."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, Final

from rwt_rclpy.clocks import timekeeper
from rwt_rclpy.clocks.duration import S_TO_NS, Duration
from rwt_rclpy.clocks.time import Time
from rwt_rclpy.endpoints.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from rwt_rclpy.execution.blocking import Wait
from rwt_rclpy.execution.task import Future
from rwt_rclpy.messages.loaded import classes, message_class
from rwt_tf2 import Buffer as Frames
from rwt_tf2.errors import ConnectivityError as NoChain
from rwt_tf2.errors import ExtrapolationError as OutOfReach
from rwt_tf2.errors import InvalidTransform, LookupFailed
from rwt_tf2.feed import Feed
from rwt_tf2.messages import read_transform, stamp_ns
from rwt_tf2.transform import StampedTransform

if TYPE_CHECKING:
    from rwt_rclpy.nodes.node import Node


class TransformException(Exception):  # tf2's name
    """Base of tf2's exceptions."""


class LookupException(TransformException):
    """A frame is unknown."""


class ConnectivityException(LookupException):
    """Two frames belong to different trees."""


class ExtrapolationException(LookupException):
    """The requested time is outside of the history."""


class InvalidArgumentException(TransformException):
    """A transform or a frame is invalid."""


class TimeoutException(TransformException):
    """The transform was not available in time."""


class TypeException(Exception):  # tf2_ros's name
    """No transformation is registered for this type."""


class NotImplementedException(Exception):
    """The buffer cannot do this."""


#: Exceptions by the codes of `tf2_msgs/TF2Error`.
_ERRORS: Final[dict[int, type[TransformException]]] = {
    1: LookupException,
    2: ConnectivityException,
    3: ExtrapolationException,
    4: InvalidArgumentException,
    5: TimeoutException,
}
_PADDING: Final = Duration(seconds=2.0)


def _ns(time: Any) -> int:
    return time.nanoseconds if isinstance(time, Time) else stamp_ns(time)


class TransformRegistration:
    """Registry of functions that transform messages, by class; `tf2_geometry_msgs` adds some."""

    _functions: ClassVar[dict[type, Callable[[Any, Any], Any]]] = {}

    def add(self, key: type, callback: Callable[[Any, Any], Any]) -> None:
        """Register the function of a class."""
        self._functions[key] = callback

    def get(self, key: type) -> Callable[[Any, Any], Any]:
        """Return the function of a class. Raises TypeException, which names the module to import."""
        try:
            return self._functions[key]
        except KeyError:
            raise TypeException(f"Type {key} is not loaded or supported: import tf2_geometry_msgs") from None


class BufferInterface:
    """Queries of a buffer of transforms."""

    def __init__(self) -> None:
        self.registration = TransformRegistration()

    def transform(
        self, object_stamped: Any, target_frame: str, timeout: Duration | None = None, new_type: Any = None
    ) -> Any:
        """Return a stamped message in another frame.

        Raises:
            TypeException: messages of its class cannot be transformed.
            LookupException: the transform is not available.
        """
        do_transform = self.registration.get(type(object_stamped))
        header = object_stamped.header
        found = self.lookup_transform(target_frame, header.frame_id, Time.from_msg(header.stamp), timeout)
        return do_transform(object_stamped, found)

    def lookup_transform(
        self, target_frame: str, source_frame: str, time: Any, timeout: Duration | None = None
    ) -> Any:
        """Return the transform from one frame to another."""
        raise NotImplementedException


class Buffer(BufferInterface):
    """Buffer of the transforms of the last seconds.

    Args:
        cache_time: duration of the history; ten seconds by default.
        node: node that offers `tf2_frames`, if given.
    """

    def __init__(
        self, cache_time: Duration | None = None, node: Node | None = None, qos: QoSProfile | None = None
    ) -> None:
        super().__init__()
        self._frames = Frames(10_000_000_000 if cache_time is None else cache_time.nanoseconds)
        self._feed = Feed(self._frames)
        self._keeper = timekeeper.current()
        self._condition = self._keeper.condition()
        self._waiting: list[tuple[Future, Callable[[], bool]]] = []
        self._lock = threading.RLock()
        if node is not None:
            service = classes().service("tf2_msgs/FrameGraph")
            self.frame_server = node.create_service(service, "tf2_frames", self._answer_frames)

    def _answer_frames(self, request: Any, response: Any) -> Any:
        response.frame_yaml = self.all_frames_as_yaml()
        return response

    # Filling

    def set_transform(self, transform: Any, authority: str) -> None:
        """Add a `geometry_msgs/TransformStamped`. Raises InvalidArgumentException."""
        self._put(transform, static=False)

    def set_transform_static(self, transform: Any, authority: str) -> None:
        """Add a static transform. Raises InvalidArgumentException."""
        self._put(transform, static=True)

    def _put(self, transform: Any, *, static: bool) -> None:
        try:
            with self._lock:
                self._frames.set_transform(read_transform(transform), static=static)
        except InvalidTransform as error:
            raise InvalidArgumentException(str(error)) from None
        self._new_data()

    def take(self, message: Any, *, static: bool) -> None:
        """Handle a message of `/tf` or `/tf_static`; errors are logged."""
        with self._lock:
            self._feed.take(message, static=static)
        self._new_data()

    def clear(self) -> None:
        """Remove all non-static transforms."""
        with self._lock:
            self._frames.clear()

    def _new_data(self) -> None:
        with self._condition:
            self._condition.notify_all()
        # Several threads may add transforms: only one of them sets each future.
        with self._lock:
            waiting, self._waiting = self._waiting, []
            found: list[Future] = []
            for future, ready in waiting:
                if ready():
                    found.append(future)
                else:
                    self._waiting.append((future, ready))
        for future in found:
            future.set_result(True)

    # Asking

    def can_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: Any,
        timeout: Duration | None = None,
        return_debug_tuple: bool = False,
    ) -> Any:
        """True if a transform becomes available within the timeout."""
        check = partial(self._frames.can_transform, target_frame, source_frame, _ns(time))
        verdict = self._wait(check, timeout)
        return (bool(verdict), verdict.reason) if return_debug_tuple else bool(verdict)

    def _wait(self, check: Callable[[], Any], timeout: Duration | None) -> Any:
        """Wait until a check of the frames is true; return its last verdict."""

        def verdict() -> Any:
            with self._lock:
                return check()

        if timeout is not None and timeout.nanoseconds > 0 and not verdict():
            with self._condition:
                deadline = self._keeper.steady_ns() + timeout.nanoseconds
                self._keeper.wait_for(self._condition, verdict, deadline)
        return verdict()

    def lookup_transform(
        self, target_frame: str, source_frame: str, time: Any, timeout: Duration | None = None
    ) -> Any:
        """Return the transform of `source_frame` in `target_frame`, as `geometry_msgs/TransformStamped`.

        Args:
            time: time of the transform; `Time()` for the latest.
            timeout: maximum wait; needs an executor in another thread.

        Raises:
            LookupException: a frame is unknown.
            ConnectivityException: the frames are not connected.
            ExtrapolationException: the history does not contain the time.
        """
        arguments = (target_frame, source_frame, _ns(time))
        self._wait(partial(self._frames.can_transform, *arguments), timeout)
        with self._lock, _as_tf2():
            return _message(self._frames.lookup_transform(*arguments))

    def lookup_transform_full(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
        timeout: Duration | None = None,
    ) -> Any:
        """Return `source_frame` at one time in `target_frame` at another time, over a fixed frame.

        Raises:
            LookupException: as :meth:`lookup_transform`.
        """
        arguments = (target_frame, _ns(target_time), source_frame, _ns(source_time), fixed_frame)
        self._wait(partial(self._frames.can_transform_full, *arguments), timeout)
        with self._lock, _as_tf2():
            return _message(self._frames.lookup_transform_full(*arguments))

    def can_transform_full(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
        timeout: Duration | None = None,
        return_debug_tuple: bool = False,
    ) -> Any:
        """True if :meth:`lookup_transform_full` has a result."""
        arguments = (target_frame, _ns(target_time), source_frame, _ns(source_time), fixed_frame)
        verdict = self._wait(partial(self._frames.can_transform_full, *arguments), timeout)
        return (bool(verdict), verdict.reason) if return_debug_tuple else bool(verdict)

    def _when(self, ready: Callable[[], bool]) -> Future:
        future = Future()
        with self._lock:  # Otherwise the transform could come between check and append.
            is_ready = ready()
            if not is_ready:
                self._waiting.append((future, ready))
        if is_ready:
            future.set_result(True)
        return future

    def wait_for_transform_async(self, target_frame: str, source_frame: str, time: Any) -> Future:
        """Return a future that is done once the transform is available."""
        return self._when(lambda: self.can_transform(target_frame, source_frame, time))

    def wait_for_transform_full_async(
        self, target_frame: str, target_time: Any, source_frame: str, source_time: Any, fixed_frame: str
    ) -> Future:
        """Return a future that is done once :meth:`lookup_transform_full` has a result."""
        arguments = (target_frame, target_time, source_frame, source_time, fixed_frame)
        return self._when(lambda: self.can_transform_full(*arguments))

    async def lookup_transform_async(self, target_frame: str, source_frame: str, time: Any) -> Any:
        """Return :meth:`lookup_transform` in a coroutine."""
        await self.wait_for_transform_async(target_frame, source_frame, time)
        return self.lookup_transform(target_frame, source_frame, time)

    async def lookup_transform_full_async(
        self, target_frame: str, target_time: Any, source_frame: str, source_time: Any, fixed_frame: str
    ) -> Any:
        """Return :meth:`lookup_transform_full` in a coroutine."""
        arguments = (target_frame, target_time, source_frame, source_time, fixed_frame)
        await self.wait_for_transform_full_async(*arguments)
        return self.lookup_transform_full(*arguments)

    def get_latest_common_time(self, source_frame: str, dest_frame: str) -> Time:
        """Return the latest common time of both frames. Raises LookupException."""
        with self._lock, _as_tf2():
            return Time(nanoseconds=self._frames.latest_common_time(dest_frame, source_frame))

    def all_frames_as_yaml(self) -> str:
        """Return all frames as YAML."""
        with self._lock:
            return self._frames.all_frames_as_yaml()

    def all_frames_as_string(self) -> str:
        """Return all frames as text for people."""
        with self._lock:
            return self._frames.tree()

    lookup_transform_core = lookup_transform
    lookup_transform_full_core = lookup_transform_full


BufferCore = Buffer


class BufferClient(BufferInterface):
    """Queries of a buffer in another process, which answers goals of `tf2_msgs/LookupTransform`.

    An executor must spin the node in another thread.

    Args:
        node: node of the action client.
        ns: name of the action.
        check_frequency: accepted as by tf2; nothing is polled.
        timeout_padding: time for the answer beyond the timeout of a query.
    """

    def __init__(
        self,
        node: Node,
        ns: str,
        check_frequency: float = 10.0,
        timeout_padding: Duration = _PADDING,
    ) -> None:
        from rwt_rclpy.actions.client import ActionClient

        super().__init__()
        self.node = node
        self.action_client = ActionClient(node, classes().action("tf2_msgs/LookupTransform"), ns)
        self.check_frequency = check_frequency
        self.timeout_padding = timeout_padding

    def lookup_transform(
        self, target_frame: str, source_frame: str, time: Any, timeout: Duration | None = None
    ) -> Any:
        """Return the transform of `source_frame` in `target_frame`.

        Raises:
            TransformException: it is not available, of the class that the server names.
            TimeoutException: the server is missing or does not answer in time.
        """
        return self._result(timeout, target_frame=target_frame, source_frame=source_frame, source_time=time)

    def lookup_transform_full(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
        timeout: Duration | None = None,
    ) -> Any:
        """Return `source_frame` at one time in `target_frame` at another time, over a fixed frame.

        Raises:
            TransformException: as :meth:`lookup_transform`.
        """
        return self._result(
            timeout,
            target_frame=target_frame,
            target_time=target_time.to_msg(),
            source_frame=source_frame,
            source_time=source_time,
            fixed_frame=fixed_frame,
            advanced=True,
        )

    def can_transform(self, *arguments: Any, **options: Any) -> bool:
        """True if :meth:`lookup_transform` returns a transform."""
        return self._works(self.lookup_transform, *arguments, **options)

    def can_transform_full(self, *arguments: Any, **options: Any) -> bool:
        """True if :meth:`lookup_transform_full` returns a transform."""
        return self._works(self.lookup_transform_full, *arguments, **options)

    def destroy(self) -> None:
        """Destroy the action client."""
        self.action_client.destroy()

    @staticmethod
    def _works(lookup: Callable[..., Any], *arguments: Any, **options: Any) -> bool:
        try:
            lookup(*arguments, **options)
        except TransformException:
            return False
        return True

    def _result(self, timeout: Duration | None, *, source_time: Any, **fields: Any) -> Any:
        if not self.action_client.server_is_ready():
            raise TimeoutException("The BufferServer is not ready.")
        span = timeout or Duration()
        time = source_time.to_msg() if isinstance(source_time, Time) else source_time
        goal = self.action_client._action_type.Goal(source_time=time, timeout=span.to_msg(), **fields)
        sent = self.action_client.send_goal_async(goal)
        wait = Wait(self.node.context)
        sent._rwt_resume_with(wait.wake)
        limit_ns = span.nanoseconds + self.timeout_padding.nanoseconds
        if not wait.until(sent.done, limit_ns / S_TO_NS) or not sent.result().accepted:
            raise TimeoutException("The BufferServer did not accept the query in time.")
        result = sent.result().get_result().result
        if result.error.error != result.error.NO_ERROR:
            raise _ERRORS.get(result.error.error, TransformException)(result.error.error_string)
        return result.transform


@contextmanager
def _as_tf2() -> Iterator[None]:
    """Raise tf2's exceptions for the buffer's."""
    try:
        yield
    except NoChain as error:
        raise ConnectivityException(str(error)) from None
    except OutOfReach as error:
        side = "future" if error.future else "past"  # Programs search the text for tf2's phrase.
        raise ExtrapolationException(f"Lookup would require extrapolation into the {side}: {error}") from None
    except LookupFailed as error:
        raise LookupException(str(error)) from None


def _message(stamped: StampedTransform) -> Any:
    message: Any = message_class("geometry_msgs/TransformStamped")()
    message.header.stamp = Time(nanoseconds=max(0, stamped.stamp_ns)).to_msg()
    message.header.frame_id = stamped.parent
    message.child_frame_id = stamped.child
    moved, turned = message.transform.translation, message.transform.rotation
    moved.x, moved.y, moved.z = map(float, stamped.transform.translation)
    turned.x, turned.y, turned.z, turned.w = map(float, stamped.transform.rotation)
    return message


_STATIC = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_STATIC_HISTORY = QoSProfile(
    depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL, history=HistoryPolicy.KEEP_LAST
)


class TransformListener:
    """Listener that fills a buffer from `/tf` and `/tf_static`.

    Args:
        buffer: buffer.
        node: node that subscribes.
        spin_thread: True to spin the node in a separate thread.
    """

    def __init__(
        self,
        buffer: Buffer,
        node: Node,
        *,
        spin_thread: bool = False,
        qos: QoSProfile | int = 100,
        static_qos: QoSProfile = _STATIC_HISTORY,
        tf_topic: str = "/tf",
        tf_static_topic: str = "/tf_static",
    ) -> None:
        from rwt_rclpy.execution.callback_groups import ReentrantCallbackGroup

        self.buffer = buffer
        self.node = node
        self.group = ReentrantCallbackGroup()
        message = message_class("tf2_msgs/TFMessage")
        self.tf_sub = node.create_subscription(
            message, tf_topic, self.callback, qos, callback_group=self.group
        )
        self.tf_static_sub = node.create_subscription(
            message, tf_static_topic, self.static_callback, static_qos, callback_group=self.group
        )
        if spin_thread:
            from rwt_rclpy.execution.executors import SingleThreadedExecutor

            self.executor = SingleThreadedExecutor(context=node.context)
            self.executor.add_node(node)
            self.dedicated_listener_thread = threading.Thread(target=self.executor.spin, daemon=True)
            self.dedicated_listener_thread.start()

    def callback(self, data: Any) -> None:
        """Add the transforms of a message of `/tf`."""
        self.buffer.take(data, static=False)

    def static_callback(self, data: Any) -> None:
        """Add the transforms of a message of `/tf_static`."""
        self.buffer.take(data, static=True)

    def unregister(self) -> None:
        """Stop listening."""
        if hasattr(self, "executor"):
            self.executor.shutdown()
        self.node.destroy_subscription(self.tf_sub)
        self.node.destroy_subscription(self.tf_static_sub)


class TransformBroadcaster:
    """Broadcaster on `/tf`."""

    def __init__(self, node: Node, qos: QoSProfile | int = 100) -> None:
        self.pub_tf = node.create_publisher(message_class("tf2_msgs/TFMessage"), "/tf", qos)

    def sendTransform(self, transform: Any) -> None:  # tf2_ros's name
        """Publish one or several `geometry_msgs/TransformStamped`."""
        self.pub_tf.publish(self.pub_tf.msg_type(transforms=_listed(transform)))


class StaticTransformBroadcaster:
    """Broadcaster on `/tf_static`, which is latched."""

    def __init__(self, node: Node, qos: QoSProfile | None = None) -> None:
        self.pub_tf = node.create_publisher(message_class("tf2_msgs/TFMessage"), "/tf_static", qos or _STATIC)
        self._sent: dict[str, Any] = {}

    def sendTransform(self, transform: Any) -> None:  # tf2_ros's name
        """Publish one or several `geometry_msgs/TransformStamped`, with all earlier ones."""
        self._sent.update({each.child_frame_id: each for each in _listed(transform)})
        self.pub_tf.publish(self.pub_tf.msg_type(transforms=list(self._sent.values())))


def _listed(transform: Any) -> list[Any]:
    return list(transform) if isinstance(transform, (list, tuple)) else [transform]
