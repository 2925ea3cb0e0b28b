"""Action servers and clients: `rclpy.action`."""

from rwt_rclpy.actions.client import ActionClient as ActionClient
from rwt_rclpy.actions.graph import (
    get_action_client_names_and_types_by_node as get_action_client_names_and_types_by_node,
)
from rwt_rclpy.actions.graph import get_action_names_and_types as get_action_names_and_types
from rwt_rclpy.actions.graph import (
    get_action_server_names_and_types_by_node as get_action_server_names_and_types_by_node,
)
from rwt_rclpy.actions.server import ActionServer as ActionServer
from rwt_rclpy.actions.server import CancelResponse as CancelResponse
from rwt_rclpy.actions.server import GoalResponse as GoalResponse
