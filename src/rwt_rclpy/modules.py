"""The names under which programs import what is here: `rclpy.node` is `rwt_rclpy.nodes.node`."""

from __future__ import annotations

from typing import Final

_HERE: Final = "rwt_rclpy"

_RCLPY: Final = {
    "": "client_library",
    "_rclpy_pybind11": "c_extension",
    "action": "actions",
    "action.client": "actions.client",
    "action.graph": "actions.graph",
    "action.server": "actions.server",
    "callback_groups": "execution.callback_groups",
    "client": "endpoints.client",
    "clock": "clocks.clock",
    "clock_type": "clocks.time",
    "constants": "clocks.duration",
    "context": "execution.context",
    "destroyable": "destroyable",
    "duration": "clocks.duration",
    "event_handler": "endpoints.events",
    "exceptions": "exceptions",
    "executors": "execution.executors",
    "expand_topic_name": "names.validation",
    "guard_condition": "execution.guard_condition",
    "impl": "logs",
    "impl.implementation_singleton": "c_extension",
    "impl.logging_severity": "logs.output",
    "impl.rcutils_logger": "logs.logger",
    "lifecycle": "nodes.lifecycle",
    "lifecycle.node": "nodes.lifecycle",
    "lifecycle.managed_entity": "nodes.lifecycle",
    "lifecycle.publisher": "nodes.lifecycle",
    "logging": "logs.logging_module",
    "logging_service": "parameters.services",
    "node": "nodes.node",
    "parameter": "parameters.parameter",
    "parameter_client": "parameters.client",
    "parameter_event_handler": "parameters.event_handler",
    "parameter_service": "parameters.services",
    "publisher": "endpoints.publisher",
    "qos": "endpoints.qos",
    "qos_event": "endpoints.events",
    "qos_overriding_options": "endpoints.overriding",
    "serialization": "endpoints.serialization",
    "service": "endpoints.service",
    "service_introspection": "endpoints.introspection",
    "signals": "execution.signals",
    "subscription": "endpoints.subscription",
    "task": "execution.task",
    "time": "clocks.time",
    "time_source": "clocks.time_source",
    "timer": "clocks.timer",
    "topic_endpoint_info": "nodes.topic_endpoint_info",
    "topic_or_service_is_hidden": "names.validation",
    "type_description_service": "nodes.type_description_service",
    "type_hash": "nodes.topic_endpoint_info",
    "type_support": "endpoints.type_support",
    "utilities": "utilities_module",
    "validate_full_topic_name": "names.validation",
    "validate_namespace": "names.validation",
    "validate_node_name": "names.validation",
    "validate_parameter_name": "names.validation",
    "validate_topic_name": "names.validation",
    "wait_for_message": "nodes.waiting",
    "waitable": "execution.waitable",
}

#: Every module that can be imported, and where it is.
MODULES: Final = {
    **{f"rclpy.{name}" if name else "rclpy": f"{_HERE}.{place}" for name, place in _RCLPY.items()},
    "rosidl_parser": f"{_HERE}.messages.slot_types",
    "rosidl_parser.definition": f"{_HERE}.messages.slot_types",
}

#: What programs import that cannot be here, and what to do instead.
ABSENT: Final = {
    "rclcpp": "C++ nodes; run them on a machine with ROS and join it over Zenoh or rosbridge",
    "rclcpp_components": "C++ components; run them on a machine with ROS",
    "rmw_implementation": "DDS; the graph of this project carries the messages",
    "rpyutils": "rpyutils loads ROS's C libraries, of which there are none here",
    "rosidl_generator_py": "generated code; messages are made from definitions when they are imported",
    "launch": "launch files; start the nodes with `rwt run`, several in one process",
    "launch_ros": "launch files; start the nodes with `rwt run`, several in one process",
    "launch_testing": "launch tests; use the pytest fixture `rclpy_graph`",
    "ros2cli": "the ros2 command; use `rwt topic`, `rwt service`, `rwt param` and the others",
    "rosbag2_py": "rosbag2; use `rwt bag`",
    "pluginlib": "C++ plugins",
}
