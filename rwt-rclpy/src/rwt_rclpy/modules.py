"""Names of ROS modules and the modules of this package: `rclpy.node` is `rwt_rclpy.nodes.node`."""

from __future__ import annotations

from typing import Final

from rwt_rclpy.release import FROM_KILTED

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
    "logging": "logs.logger",
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
    "subscription_content_filter_options": "endpoints.content_filter",
    "task": "execution.task",
    "time": "clocks.time",
    "time_source": "clocks.time_source",
    "timer": "clocks.timer",
    "topic_endpoint_info": "middleware.topic_endpoint_info",
    "topic_or_service_is_hidden": "names.validation",
    "type_description_service": "nodes.type_description_service",
    "type_hash": "middleware.topic_endpoint_info",
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

if not FROM_KILTED:
    del _RCLPY["subscription_content_filter_options"]

_LAUNCH: Final = {
    "": "",
    "action": ".entities",
    "actions": ".actions",
    "condition": ".conditions",
    "conditions": ".conditions",
    "event": ".entities",
    "event_handler": ".event_handlers",
    "event_handlers": ".event_handlers",
    "events": ".events",
    "events.matchers": ".events",
    "events.process": ".events",
    "launch_context": ".entities",
    "launch_description": ".entities",
    "launch_description_entity": ".entities",
    "launch_description_source": ".sources",
    "launch_description_sources": ".sources",
    "launch_service": ".service",
    "logging": ".logging",
    "some_entities_type": ".entities",
    "some_substitutions_type": ".entities",
    "substitution": ".entities",
    "substitutions": ".substitutions",
    "utilities": ".entities",
}

#: Packages of one module each, with their modules in ROS.
_COMPANIONS: Final[dict[str, tuple[str, ...]]] = {
    "ament_index_python": ("packages", "resources"),
    "cv_bridge": (),
    "message_filters": (),
    "ros2node": ("api",),
    "rosidl_adapter": ("parser",),
    "rosidl_runtime_py": ("convert", "get_interfaces", "import_message", "set_message", "utilities"),
    "rpyutils": (),
    "sensor_msgs_py": ("point_cloud2",),
    "tf2_geometry_msgs": ("tf2_geometry_msgs",),
    "tf2_ros": (
        "buffer", "buffer_client", "buffer_interface",
        "static_transform_broadcaster", "transform_broadcaster", "transform_listener",
    ),
}  # fmt: skip

#: Modules of this package by ROS name.
MODULES: Final = {
    **{f"rclpy.{name}" if name else "rclpy": f"{_HERE}.{place}" for name, place in _RCLPY.items()},
    "rosidl_parser": f"{_HERE}.messages.slot_types",
    "rosidl_parser.definition": f"{_HERE}.messages.slot_types",
    **{
        each: f"{_HERE}.companions.ros2_queries"
        for kind in ("topic", "service", "param")
        for each in (f"ros2{kind}", f"ros2{kind}.api")
    },
    "tf2_py": f"{_HERE}.companions.tf2_ros",
    **{
        f"{package}.{name}" if name else package: f"{_HERE}.companions.{package}"
        for package, names in _COMPANIONS.items()
        for name in ("", *names)
    },
    **{f"launch.{name}" if name else "launch": f"{_HERE}.launch{place}" for name, place in _LAUNCH.items()},
    "launch_ros": f"{_HERE}.launch.ros",
    "launch_ros.actions": f"{_HERE}.launch.ros_actions",
    "launch_ros.descriptions": f"{_HERE}.launch.ros_parameters",
    "launch_ros.parameter_descriptions": f"{_HERE}.launch.ros_parameters",
    "launch_ros.substitutions": f"{_HERE}.launch.ros_substitutions",
}

#: Missing modules of rclpy, with alternatives.
ABSENT_IN_RCLPY: Final = {
    "rclpy.experimental": "executors in C++; every executor of rclpy.executors is woken by events here",
}

#: Other missing modules, with alternatives.
ABSENT: Final = {
    "rclcpp": "C++ nodes; run them on a machine with ROS and join it over Zenoh or rosbridge",
    "rclcpp_components": "C++ components; run them on a machine with ROS",
    "rmw_implementation": "DDS; the graph of this project carries the messages",
    "rosidl_generator_py": "generated code; messages are made from definitions when they are imported",
    "launch.frontend": "launch files in XML and YAML; write them in Python",
    "launch_xml": "launch files in XML; write them in Python",
    "launch_yaml": "launch files in YAML; write them in Python",
    "launch_testing": "launch tests; use the pytest fixture `rclpy_graph`",
    "ros2cli": "the ros2 command; use `rwt topic`, `rwt service`, `rwt param` and the others",
    "rosbag2_py": "rosbag2; use `rwt bag`",
    "pluginlib": "C++ plugins",
}
