"""`rclpy.node.Node`."""

from __future__ import annotations

import copy
import weakref
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Self

from rwt_graph.errors import TypeConflict
from rwt_rclpy.clocks.clock import Clock, ROSClock
from rwt_rclpy.clocks.duration import S_TO_NS
from rwt_rclpy.clocks.time_source import TimeSource
from rwt_rclpy.clocks.timer import Rate, Timer
from rwt_rclpy.destroyable import Destroyable
from rwt_rclpy.endpoints.client import Client, wait_until
from rwt_rclpy.endpoints.content_filter import ContentFilterOptions
from rwt_rclpy.endpoints.event_handler import EventHandler
from rwt_rclpy.endpoints.event_watches import Watched
from rwt_rclpy.endpoints.events import PublisherEventCallbacks, SubscriptionEventCallbacks
from rwt_rclpy.endpoints.overriding import QoSOverridingOptions, _declare_qos_parameters
from rwt_rclpy.endpoints.publisher import Publisher
from rwt_rclpy.endpoints.qos import (
    QoSProfile,
    graph_qos,
    qos_profile_parameter_events,
    qos_profile_rosout_default,
    qos_profile_services_default,
)
from rwt_rclpy.endpoints.service import Service
from rwt_rclpy.endpoints.subscription import Subscription
from rwt_rclpy.endpoints.type_support import check_is_valid_srv_type, message_type, service_type
from rwt_rclpy.endpoints.type_variables import MsgType as MsgType
from rwt_rclpy.endpoints.type_variables import SrvType as SrvType
from rwt_rclpy.endpoints.type_variables import SrvTypeRequest as SrvTypeRequest
from rwt_rclpy.endpoints.type_variables import SrvTypeResponse as SrvTypeResponse
from rwt_rclpy.exceptions import NameValidationException, NotInitializedException, RCLError
from rwt_rclpy.exceptions import NodeNameNonExistentError as NodeNameNonExistentError
from rwt_rclpy.execution.callback_groups import (
    CallbackGroup,
    MutuallyExclusiveCallbackGroup,
    ReentrantCallbackGroup,
)
from rwt_rclpy.execution.context import Context, get_default_context
from rwt_rclpy.execution.entity import Entity
from rwt_rclpy.execution.guard_condition import GuardCondition
from rwt_rclpy.execution.waitable import Waitable, WaitableEntity
from rwt_rclpy.logs import output
from rwt_rclpy.logs.logger import RcutilsLogger, get_logger
from rwt_rclpy.messages.loaded import message_class
from rwt_rclpy.names.arguments import RosArguments, parse_arguments
from rwt_rclpy.names.validation import (
    expand_topic_name,
    validate_full_topic_name,
    validate_namespace,
    validate_node_name,
    validate_topic_name,
)
from rwt_rclpy.nodes.graph_queries import GraphQueries, NamesAndTypes
from rwt_rclpy.nodes.type_description_service import TypeDescriptionService
from rwt_rclpy.parameters.node_parameters import NodeParameters
from rwt_rclpy.parameters.parameter import Parameter, ParameterKind
from rwt_rclpy.parameters.services import LoggingService, ParameterService
from rwt_rclpy.release import FROM_KILTED

if TYPE_CHECKING:
    from rwt_rclpy.execution.executors import Executor
    from rwt_rclpy.middleware.topic_endpoint_info import TopicEndpointInfo


#: Prefix of hidden node names.
HIDDEN_NODE_PREFIX = "_"


class NodeHandle(Destroyable):
    """Handle in place of rclpy's pointer to a node."""

    def __init__(self, name: str, namespace: str, on_destroy: Callable[[], None]) -> None:
        super().__init__(on_destroy)
        self._name = name
        self._namespace = namespace

    def get_node_name(self) -> str:
        """Name of the node."""
        self.check()
        return self._name

    def get_namespace(self) -> str:
        """Namespace of the node."""
        self.check()
        return self._namespace

    def get_fully_qualified_name(self) -> str:
        """Absolute name of the node."""
        self.check()
        return f"{self._namespace.rstrip('/')}/{self._name}"

    def logger_name(self) -> str:
        """Return the name of the node's logger."""
        return f"{self._namespace}/{self._name}".strip("/").replace("//", "/").replace("/", ".")


class Node(NodeParameters):
    """Node of the graph, which creates publishers, subscriptions, services, clients and timers.

    Args:
        node_name: name; ``__node:=`` of the command line takes precedence.
        context: context of the node; by default that of `rclpy.init()`.
        cli_args: arguments for this node only, as after ``--ros-args``.
        namespace: namespace; ``__ns:=`` of the command line takes precedence.
        use_global_arguments: True to apply the command line of the program.
        enable_rosout: True to publish its log on `/rosout`.
        start_parameter_services: True if other nodes may read and set its parameters.
        parameter_overrides: values of parameters to be declared.
        allow_undeclared_parameters: True if undeclared parameters may be set.
        automatically_declare_parameters_from_overrides: True to declare parameters with an override.
        enable_logger_service: True if other nodes may set the levels of its loggers.

    Raises:
        NotInitializedException: the context is not initialised.
        InvalidNodeNameException: ROS does not allow the name.
        InvalidNamespaceException: ROS does not allow the namespace.
    """

    def __init__(
        self,
        node_name: str,
        *,
        context: Context | None = None,
        cli_args: Sequence[str] | None = None,
        namespace: str | None = None,
        use_global_arguments: bool = True,
        enable_rosout: bool = True,
        rosout_qos_profile: QoSProfile | int = qos_profile_rosout_default,
        start_parameter_services: bool = True,
        parameter_overrides: Sequence[Parameter] | None = None,
        allow_undeclared_parameters: bool = False,
        automatically_declare_parameters_from_overrides: bool = False,
        enable_logger_service: bool = False,
    ) -> None:
        self._context = get_default_context() if context is None else context
        if not self._context.ok():
            raise NotInitializedException("cannot create node")
        self._rwt_link = self._context._rwt_link
        self._rwt_arguments = self._all_arguments(cli_args, use_global_arguments)
        name, namespace = self._rwt_names(node_name, namespace or "")
        self._handle = NodeHandle(name, namespace, self._rwt_leave)
        full = self._rwt_full_name = f"{namespace.rstrip('/')}/{name}"
        self._rwt_participant = self._rwt_link.run(lambda: self._rwt_link.graph.participant(full))
        self._rwt_queries = GraphQueries(self._rwt_link)
        self._begin_entities()
        self._context._rwt_nodes.add(self)
        self._default_callback_group: CallbackGroup = MutuallyExclusiveCallbackGroup()
        self._rate_group = ReentrantCallbackGroup()
        self._rwt_executor: weakref.ref[Executor] | None = None
        self._logger = get_logger(self._handle.logger_name())
        self._rwt_rosout: Publisher | None = None
        if enable_rosout and self._rwt_arguments.rosout:
            self._open_rosout(rosout_qos_profile)
        self._parameter_event_publisher = self.create_publisher(
            message_class("rcl_interfaces/ParameterEvent"), "/parameter_events", qos_profile_parameter_events
        )
        super().__init__(
            self._overrides(parameter_overrides), allow_undeclared_parameters, self._announce_parameters
        )
        self._clock = ROSClock()
        if automatically_declare_parameters_from_overrides:
            self._declare_overrides()
        self._time_source = TimeSource(node=self)
        self._time_source.attach_clock(self._clock)
        if start_parameter_services:
            self._parameter_service = ParameterService(self)
        if enable_logger_service:
            self._logger_service = LoggingService(self)
        self._type_description_service = TypeDescriptionService(self)

    def _begin_entities(self) -> None:
        self._publishers: list[Publisher] = []
        self._subscriptions: list[Subscription] = []
        self._clients: list[Client] = []
        self._services: list[Service] = []
        self._timers: list[Timer] = []
        self._guards: list[GuardCondition] = []
        self._waitables: dict[Any, Entity] = {}
        self._rwt_events: list[EventHandler] = []
        self._rwt_entities: tuple[Entity, ...] = ()

    def _declare_overrides(self) -> None:
        """Declare every parameter that has an override."""
        descriptor = message_class("rcl_interfaces/ParameterDescriptor")
        self.declare_parameters(
            "",
            [(each.name, each.value, descriptor()) for each in self._parameter_overrides.values()],
            ignore_override=True,
        )

    def __del__(self) -> None:
        handle = getattr(self, "_handle", None)
        if handle is not None:
            handle.destroy_when_not_in_use()

    def _all_arguments(self, cli_args: Sequence[str] | None, use_global: bool) -> RosArguments:
        scoped = "--ros-args" in (cli_args or ())
        own = parse_arguments(cli_args or (), ros_first=not scoped)
        if scoped:
            own.refuse_unknown()
        handle = self._context.handle
        if use_global and handle is not None:
            everyone = handle.arguments
            # Its own rules come first, and its own values last: both take precedence.
            own.remaps.extend(everyone.remaps)
            own.below = everyone
            own.rosout = own.rosout and everyone.rosout
        return own

    def _rwt_names(self, name: str, namespace: str) -> tuple[str, str]:
        if name is None:
            raise RCLError("the name of a node is null")
        namespace = namespace if namespace.startswith("/") else f"/{namespace}"
        arguments = self._rwt_arguments
        remapped = arguments.node_name(name), arguments.namespace(name, namespace)
        for each_name, each_namespace in ((name, namespace), remapped):
            validate_node_name(each_name)
            validate_namespace(each_namespace)
        return remapped

    def _overrides(self, given: Sequence[Parameter] | None) -> dict[str, Parameter]:
        values = self._rwt_arguments.parameters_of(self._rwt_full_name)
        # An empty list has no type.
        of_arguments = [Parameter(name, value=None if it == [] else it) for name, it in values.items()]
        return {each.name: each for each in (*of_arguments, *(given or ()))}

    # Properties

    def get_name(self) -> str:
        """Return its name."""
        return self._handle.get_node_name()

    def get_namespace(self) -> str:
        """Namespace of the node."""
        return self._handle.get_namespace()

    def get_fully_qualified_name(self) -> str:
        """Return namespace and name."""
        return self._handle.get_fully_qualified_name()

    def get_clock(self) -> ROSClock:
        """Return the clock that follows `use_sim_time`."""
        return self._clock

    def get_logger(self) -> RcutilsLogger:
        """Return its logger."""
        return self._logger

    @property
    def handle(self) -> NodeHandle:
        """Handle that destroys the node."""
        return self._handle

    @handle.setter
    def handle(self, value: object) -> None:
        raise AttributeError("handle cannot be modified after node creation")

    @property
    def context(self) -> Context:
        """Context of the node."""
        return self._context

    @property
    def default_callback_group(self) -> CallbackGroup:
        """Default callback group: one callback at a time."""
        return self._default_callback_group

    @property
    def executor(self) -> Executor | None:
        """Executor that runs the node's callbacks; writable."""
        return None if self._rwt_executor is None else self._rwt_executor()

    @executor.setter
    def executor(self, new_executor: Executor | None) -> None:
        current = self.executor
        if current is new_executor:
            return
        if current is not None:
            current.remove_node(self)
        if new_executor is None:
            self._rwt_executor = None
        else:
            self._rwt_executor = weakref.ref(new_executor)
            new_executor.add_node(self)

    def _wake_executor(self) -> None:
        executor = self.executor
        if executor is not None:
            executor.wake()

    @property
    def publishers(self) -> Iterator[Publisher]:
        """Publishers of the node."""
        yield from self._publishers

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """Subscriptions of the node."""
        yield from self._subscriptions

    @property
    def clients(self) -> Iterator[Client]:
        """Clients of the node."""
        yield from self._clients

    @property
    def services(self) -> Iterator[Service]:
        """Services of the node."""
        yield from self._services

    @property
    def timers(self) -> Iterator[Timer]:
        """Timers of the node."""
        yield from self._timers

    @property
    def guards(self) -> Iterator[GuardCondition]:
        """Guard conditions of the node."""
        yield from self._guards

    @property
    def waitables(self) -> Iterator[Any]:
        """Waitables of the node."""
        yield from tuple(self._waitables)

    # Creation of entities

    def _rwt_gather(self) -> None:
        """Update the list of entities for executors, timers first as in rcl."""
        self._rwt_entities = (
            *self._timers,
            *self._subscriptions,
            *self._guards,
            *self._clients,
            *self._services,
            *self._waitables.values(),
            *self._rwt_events,
        )
        self._wake_executor()

    def _rwt_adopt(self, entity: Entity, group: CallbackGroup | None) -> None:
        entity.callback_group = group or self._default_callback_group
        entity.callback_group.add_entity(entity)
        node = weakref.ref(self)

        def wake() -> None:
            alive = node()
            if alive is not None:
                alive._wake_executor()

        entity._rwt_wake = wake

    @staticmethod
    def _rwt_profile(qos_or_depth: QoSProfile | int) -> QoSProfile:
        if isinstance(qos_or_depth, QoSProfile):
            return qos_or_depth
        if not isinstance(qos_or_depth, int):
            raise TypeError(f"Expected QoSProfile or int, but received {type(qos_or_depth)!r}")
        if qos_or_depth < 0:
            raise ValueError("history depth must be greater than or equal to zero")
        return QoSProfile(depth=qos_or_depth)

    def _rwt_require_context(self, what: str) -> None:
        """Raise as rcl does after the end of the context; from Kilted on, that destroys the node."""
        self._handle.check()
        self._rwt_require_valid_context(what)

    def _rwt_require_valid_context(self, what: str) -> None:
        if not self._context.ok():
            raise RCLError(f"{what}: rcl node's context is invalid")

    def _rwt_context_ended(self) -> None:
        """Refuse further use: called once, when the context was shut down."""
        for publisher in self._publishers:
            publisher._rwt_context_ended()
        if FROM_KILTED:
            for entity in (
                *self._publishers,
                *self._subscriptions,
                *self._clients,
                *self._services,
                *self._timers,
            ):
                entity.handle.destroy_when_not_in_use()
            self._handle.destroy_when_not_in_use()

    def _rwt_resolved(self, name: str, kind: str) -> str:
        if not isinstance(name, str):
            raise TypeError(
                "rclpy_resolve_name(): incompatible function arguments. The following argument types are"
                f" supported:\n    a name is a str, not {type(name).__name__}"
            )
        service = kind == "service"
        validate_topic_name(name, is_service=service)
        expanded = expand_topic_name(name, self.get_name(), self.get_namespace())
        validate_full_topic_name(expanded, is_service=service)
        new = self._rwt_arguments.remap(expanded, kind, self.get_name(), self.get_namespace())
        return expanded if new is None else new

    def resolve_topic_name(self, topic: str, *, only_expand: bool = False) -> str:
        """Return the absolute name of a topic, remapped unless `only_expand`."""
        return self._rwt_resolve(topic, "topic", only_expand)

    def resolve_service_name(self, service: str, *, only_expand: bool = False) -> str:
        """Return the absolute name of a service, remapped unless `only_expand`."""
        return self._rwt_resolve(service, "service", only_expand)

    def _rwt_resolve(self, name: str, kind: str, only_expand: bool) -> str:
        with self._handle:
            if only_expand:
                return expand_topic_name(name, self.get_name(), self.get_namespace())
            try:
                return self._rwt_resolved(name, kind)
            except NameValidationException as error:
                raise RCLError(str(error)) from error

    def create_publisher(
        self,
        msg_type: Any,
        topic: str,
        qos_profile: QoSProfile | int,
        *,
        callback_group: CallbackGroup | None = None,
        event_callbacks: PublisherEventCallbacks | None = None,
        qos_overriding_options: QoSOverridingOptions | None = None,
        publisher_class: type[Publisher] = Publisher,
    ) -> Any:
        """Create a publisher.

        Raises:
            RCLError: the topic has another type.
            InvalidTopicNameException: ROS does not allow the name.
        """
        interface = message_type(msg_type)
        group = callback_group or self._default_callback_group
        callbacks = event_callbacks or PublisherEventCallbacks()
        with self._rwt_opening(Publisher, topic, qos_profile, qos_overriding_options) as watched:
            handlers = callbacks.create_event_handlers(group, watched)
            qos = graph_qos(watched.profile)
            made = self._rwt_link.run(lambda: self._rwt_participant.advertise(watched.name, interface, qos))
        publisher = publisher_class(self._rwt_link, made, msg_type, topic, watched.profile, handlers)
        publisher.logger_name = self._logger.name
        self._publishers.append(publisher)
        self._add_events(handlers, group)
        return publisher

    @contextmanager
    def _rwt_opening(
        self,
        kind: type[Publisher | Subscription],
        topic: str,
        qos: QoSProfile | int,
        overriding: QoSOverridingOptions | None,
    ) -> Iterator[Watched]:
        """Yield an endpoint that is about to be made, for the handlers of its events."""
        profile = self._rwt_profile(qos)
        self._rwt_require_context(f"Failed to create {kind.__name__.lower()}")
        with self._handle:
            name = self._rwt_resolved(topic, "topic")
            if overriding is not None:
                profile = copy.copy(profile)
                _declare_qos_parameters(kind, self, name, profile, overriding)
            keeper = self._rwt_link.timekeeper
            sees_publishers = kind is Subscription
            try:
                yield Watched(profile, name, topic, sees_publishers, self._rwt_queries, keeper, self._logger)
            except TypeConflict as error:
                raise RCLError(str(error)) from error

    def _add_events(self, handlers: list[EventHandler], group: CallbackGroup) -> None:
        for handler in handlers:
            self._rwt_adopt(handler, group)
        self._rwt_events.extend(handler for handler in handlers if type(handler) is not EventHandler)
        self._rwt_gather()

    def create_subscription(
        self,
        msg_type: Any,
        topic: str,
        callback: Callable[..., object],
        qos_profile: QoSProfile | int,
        *,
        callback_group: CallbackGroup | None = None,
        event_callbacks: SubscriptionEventCallbacks | None = None,
        qos_overriding_options: QoSOverridingOptions | None = None,
        raw: bool = False,
        content_filter_options: ContentFilterOptions | None = None,
    ) -> Subscription:
        """Create a subscription.

        Args:
            callback: takes the message, and its metadata if it has a second parameter.
            raw: True to pass messages in CDR.
            content_filter_options: filter of messages, from ROS 2 Kilted on.

        Raises:
            InvalidFilter: the content filter is invalid, or names an unknown field.
            RCLError: the topic has another type.
            InvalidTopicNameException: ROS does not allow the name.
            RuntimeError: the callback takes neither one argument nor two.
        """
        _check_subscription(callback, content_filter_options)
        interface = message_type(msg_type)
        group = callback_group or self._default_callback_group
        callbacks = event_callbacks or SubscriptionEventCallbacks()
        with self._rwt_opening(Subscription, topic, qos_profile, qos_overriding_options) as watched:
            handlers = callbacks.create_event_handlers(group, watched)
            subscription = Subscription(
                self._rwt_link,
                msg_type,
                topic,
                callback,
                group,
                watched.profile,
                raw,
                handlers,
                watched.matched,
                content_filter_options,
            )
            self._rwt_adopt(subscription, group)
            join = self._rwt_participant.subscribe
            name, qos = watched.name, graph_qos(watched.profile)
            subscription._rwt_opened(
                self._rwt_link.run(lambda: join(name, subscription._rwt_on_sample, interface, qos))
            )
        subscription.logger_name = self._logger.name
        self._subscriptions.append(subscription)
        self._add_events(handlers, group)
        return subscription

    def create_client(
        self,
        srv_type: Any,
        srv_name: str,
        *,
        qos_profile: QoSProfile = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> Client:
        """Create a client."""
        check_is_valid_srv_type(srv_type)
        self._rwt_require_context("failed to create client")
        with self._handle:
            name = self._rwt_resolved(srv_name, "service")
        client = Client(self, srv_type, srv_name, name, qos_profile, callback_group)
        self._rwt_adopt(client, callback_group)
        self._clients.append(client)
        self._rwt_gather()
        return client

    def create_service(
        self,
        srv_type: Any,
        srv_name: str,
        callback: Callable[..., Any],
        *,
        qos_profile: QoSProfile = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> Service:
        """Create a service."""
        interface = service_type(srv_type)
        self._rwt_require_context("failed to create service")
        with self._handle:
            name = self._rwt_resolved(srv_name, "service")
            service = Service(self, srv_type, srv_name, name, callback, callback_group, qos_profile)
            self._rwt_adopt(service, callback_group)
            service._rwt_opened(
                self._rwt_link.run(
                    lambda: self._rwt_participant.advertise_service(name, interface, service._rwt_on_call)
                )
            )
        self._services.append(service)
        self._rwt_gather()
        return service

    def create_timer(
        self,
        timer_period_sec: float,
        callback: Callable[..., object] | None,
        callback_group: CallbackGroup | None = None,
        clock: Clock | None = None,
        autostart: bool = True,
    ) -> Timer:
        """Create a timer.

        Args:
            timer_period_sec: period in seconds.
            clock: clock of the period; by default the node's.
            autostart: True to start at once.
        """
        self._rwt_require_valid_context("failed to create timer")
        with self._handle:
            timer = Timer(
                callback,
                callback_group,
                int(float(timer_period_sec) * S_TO_NS),
                clock or self._clock,
                context=self._context,
                autostart=autostart,
            )
        self._rwt_adopt(timer, callback_group)
        self._timers.append(timer)
        self._rwt_gather()
        return timer

    def create_guard_condition(
        self, callback: Callable[[], object], callback_group: CallbackGroup | None = None
    ) -> GuardCondition:
        """Create a guard condition."""
        self._rwt_require_valid_context("failed to create guard_condition")
        with self._handle:
            guard = GuardCondition(callback, callback_group, self._context)
        self._rwt_adopt(guard, callback_group)
        self._guards.append(guard)
        self._rwt_gather()
        return guard

    def create_rate(self, frequency: float, clock: Clock | None = None) -> Rate:
        """Create a rate with a frequency in Hz. Raises ValueError if it is not positive."""
        if frequency <= 0:
            raise ValueError("frequency must be > 0")
        timer = self.create_timer(1.0 / frequency, None, self._rate_group, clock)
        return Rate(timer, context=self._context)

    def add_waitable(self, waitable: Any) -> None:
        """Add a waitable of the program."""
        if isinstance(waitable, Waitable):
            entity: Entity = WaitableEntity(waitable)
            self._rwt_adopt(entity, waitable.callback_group)
        else:
            entity = waitable
            self._rwt_adopt(entity, entity.callback_group)
        self._waitables[waitable] = entity
        self._rwt_gather()

    def remove_waitable(self, waitable: Any) -> None:
        """Undo :meth:`add_waitable`. Raises ValueError if it was not added."""
        if self._waitables.pop(waitable, None) is None:
            raise ValueError(f"{waitable!r} is not a waitable of the node")
        self._rwt_gather()

    # Destruction of entities

    def _rwt_destroy(self, entity: Any, known: list[Any]) -> bool:
        if entity not in known:
            return False
        known.remove(entity)
        gone = set(getattr(entity, "event_handlers", ()))
        self._rwt_events = [each for each in self._rwt_events if each not in gone]
        entity.destroy()
        self._rwt_gather()
        return True

    def destroy_publisher(self, publisher: Publisher) -> bool:
        """Destroy a publisher. Returns False if it is not of this node."""
        return self._rwt_destroy(publisher, self._publishers)

    def destroy_subscription(self, subscription: Subscription) -> bool:
        """Destroy a subscription. Returns False if it is not of this node."""
        return self._rwt_destroy(subscription, self._subscriptions)

    def destroy_client(self, client: Client) -> bool:
        """Destroy a client. Returns False if it is not of this node."""
        return self._rwt_destroy(client, self._clients)

    def destroy_service(self, service: Service) -> bool:
        """Destroy a service. Returns False if it is not of this node."""
        return self._rwt_destroy(service, self._services)

    def destroy_timer(self, timer: Timer) -> bool:
        """Destroy a timer. Returns False if it is not of this node."""
        return self._rwt_destroy(timer, self._timers)

    def destroy_guard_condition(self, guard: GuardCondition) -> bool:
        """Destroy a guard condition. Returns False if it is not of this node."""
        return self._rwt_destroy(guard, self._guards)

    def destroy_rate(self, rate: Rate) -> bool:
        """Destroy a rate. Returns False if it is not of this node."""
        if rate._timer not in self._timers:
            return False
        self.destroy_timer(rate._timer)
        rate.destroy()
        return True

    def destroy_node(self) -> None:
        """Destroy the node with all of its entities."""
        executor = self.executor
        if executor is not None:
            executor.remove_node(self)
            self._rwt_executor = None
        if self._rwt_rosout is not None:
            output.remove_rosout(self._logger.name, self._rwt_publish_log)
        for known in (
            self._publishers,
            self._subscriptions,
            self._clients,
            self._services,
            self._timers,
            self._guards,
        ):
            while known:
                self._rwt_destroy(known[0], known)
        if self._rwt_rosout is not None:
            self._rwt_rosout.destroy()
        self._handle.destroy_when_not_in_use()

    def _rwt_leave(self) -> None:
        self._rwt_link.post(self._rwt_participant.close)

    if FROM_KILTED:

        def __enter__(self) -> Self:
            return self

        def __exit__(self, *exc: object) -> None:
            self.destroy_node()

    # Own services

    def _open_rosout(self, qos: QoSProfile | int) -> None:
        self._rwt_rosout = self.create_publisher(message_class("rcl_interfaces/Log"), "/rosout", qos)
        self._publishers.remove(self._rwt_rosout)  # Belongs to the node, not to the program.
        node = weakref.ref(self)

        def publish(line: output.LogLine) -> None:
            alive = node()
            if alive is not None:
                alive._rwt_publish(line)

        self._rwt_publish_log = publish
        output.add_rosout(self._logger.name, publish)

    def _rwt_publish(self, line: output.LogLine) -> None:
        publisher = self._rwt_rosout
        if publisher is None or not publisher.handle or not self._context.ok():
            return
        sec, nanosec = divmod(line.stamp_ns, S_TO_NS)
        stamp = message_class("builtin_interfaces/Time")(sec=sec, nanosec=nanosec)
        publisher.publish(
            publisher.msg_type(
                stamp=stamp,
                level=int(line.severity),
                name=line.name,
                msg=line.message,
                file=line.file,
                function=line.function,
                line=line.line,
            )
        )

    def _announce_parameters(self, changes: list[tuple[Parameter | None, Parameter]]) -> None:
        event: Any = message_class("rcl_interfaces/ParameterEvent")(node=self._rwt_full_name)
        for before, after in changes:
            unset = before is None or before.type_ is ParameterKind.NOT_SET
            if after.type_ is ParameterKind.NOT_SET:
                if not unset:
                    event.deleted_parameters.append(after.to_parameter_msg())
            elif unset:
                event.new_parameters.append(after.to_parameter_msg())
            else:
                event.changed_parameters.append(after.to_parameter_msg())
        clock = getattr(self, "_clock", None)
        if clock is not None:
            event.stamp = clock.now().to_msg()
        self._parameter_event_publisher.publish(event)

    # Graph queries

    def get_topic_names_and_types(self, no_demangle: bool = False) -> NamesAndTypes:
        """Every topic with its types."""
        with self._handle:
            return self._rwt_queries.topics(no_demangle=no_demangle)

    def get_service_names_and_types(self) -> NamesAndTypes:
        """Return all services with their types."""
        with self._handle:
            return self._rwt_queries.services()

    def get_publisher_names_and_types_by_node(
        self, node_name: str, node_namespace: str, no_demangle: bool = False
    ) -> NamesAndTypes:
        """Return the topics that a node publishes. Raises NodeNameNonExistentError."""
        with self._handle:
            return self._rwt_queries.published_by(node_name, node_namespace, no_demangle=no_demangle)

    def get_subscriber_names_and_types_by_node(
        self, node_name: str, node_namespace: str, no_demangle: bool = False
    ) -> NamesAndTypes:
        """Return the topics that a node subscribes to. Raises NodeNameNonExistentError."""
        with self._handle:
            return self._rwt_queries.subscribed_by(node_name, node_namespace, no_demangle=no_demangle)

    def get_service_names_and_types_by_node(self, node_name: str, node_namespace: str) -> NamesAndTypes:
        """Return the services that a node offers. Raises NodeNameNonExistentError."""
        with self._handle:
            return self._rwt_queries.services_of(node_name, node_namespace)

    def get_client_names_and_types_by_node(self, node_name: str, node_namespace: str) -> NamesAndTypes:
        """Return the services that a node calls; empty for nodes of other processes.

        Raises:
            NodeNameNonExistentError: no such node.
        """
        with self._handle:
            self._rwt_queries.services_of(node_name, node_namespace)
            return self._rwt_queries.called_by(f"{node_namespace.rstrip('/')}/{node_name}")

    def get_node_names(self) -> list[str]:
        """Return the names of all nodes."""
        return [name for name, _ in self.get_node_names_and_namespaces()]

    def get_fully_qualified_node_names(self) -> list[str]:
        """The absolute names of all nodes."""
        self._rwt_require_context("Failed to get node names")
        with self._handle:
            return self._rwt_queries.nodes()

    def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
        """Return the names and namespaces of all nodes."""
        split = (full.rpartition("/") for full in self.get_fully_qualified_node_names())
        return [(name, namespace or "/") for namespace, _, name in split]

    def get_node_names_and_namespaces_with_enclaves(self) -> list[tuple[str, str, str]]:
        """Return the names, namespaces and enclaves of all nodes; the only enclave is `/`."""
        return [(name, namespace, "/") for name, namespace in self.get_node_names_and_namespaces()]

    def count_publishers(self, topic_name: str) -> int:
        """Return the number of publishers of a topic; the name is not remapped."""
        return len(
            self._rwt_queries.ends(
                self._rwt_absolute(topic_name, "Error in rcl_count_publishers"), publishers=True
            )
        )

    def count_subscribers(self, topic_name: str) -> int:
        """Return the number of subscriptions of a topic; the name is not remapped."""
        return len(
            self._rwt_queries.ends(
                self._rwt_absolute(topic_name, "Error in rcl_count_subscribers"), publishers=False
            )
        )

    def _rwt_absolute(self, name: str, what: str, *, service: bool = False) -> str:
        self._rwt_require_context(what)
        with self._handle:
            full = expand_topic_name(name, self.get_name(), self.get_namespace())
            validate_full_topic_name(full, is_service=service)
            return full

    def count_services(self, service_name: str) -> int:
        """Return the number of servers of a service."""
        return self._rwt_queries.count_services(
            self._rwt_absolute(service_name, "Error in rcl_count_services", service=True)
        )

    def count_clients(self, service_name: str) -> int:
        """Return the number of clients of a service, without those of other processes."""
        return self._rwt_queries.count_clients(
            self._rwt_absolute(service_name, "Error in rcl_count_clients", service=True)
        )

    def get_publishers_info_by_topic(
        self, topic_name: str, no_mangle: bool = False
    ) -> list[TopicEndpointInfo]:
        """Return the publishers of a topic."""
        return self._rwt_endpoints(topic_name, no_mangle, publishers=True)

    def get_subscriptions_info_by_topic(
        self, topic_name: str, no_mangle: bool = False
    ) -> list[TopicEndpointInfo]:
        """Return the subscriptions of a topic."""
        return self._rwt_endpoints(topic_name, no_mangle, publishers=False)

    def _rwt_endpoints(self, topic: str, no_mangle: bool, *, publishers: bool) -> list[TopicEndpointInfo]:
        if no_mangle:  # DDS's name of a topic has a prefix.
            full = topic.removeprefix("rt") if topic.startswith("rt/") else ""
        else:
            full = self._rwt_absolute(topic, "Failed to get information by topic")
            full = self._rwt_arguments.remap(full, "topic", self.get_name(), self.get_namespace()) or full
        return self._rwt_queries.endpoints(full, publishers=publishers)

    def wait_for_node(self, fully_qualified_node_name: str, timeout: float) -> bool:
        """Wait until a node exists. Returns False after the timeout."""
        return wait_until(
            self._context, lambda: fully_qualified_node_name in self._rwt_queries.nodes(), timeout
        )


def _check_subscription(callback: object, content_filter: ContentFilterOptions | None) -> None:
    """Raise TypeError for a content filter before ROS 2 Kilted, RuntimeError for an invalid callback."""
    if content_filter is not None and not FROM_KILTED:
        raise TypeError("unexpected keyword argument 'content_filter_options', which exists from Kilted on")
    if not callable(callback):
        raise RuntimeError(
            "Subscription.__init__(): callback should be either be callable with one argument(to get only the"
            " message) or two (to get message and message info)"
        )
