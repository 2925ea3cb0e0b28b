"""The rosbridge gateway: how ops become verbs of the robot graph, and events of the graph become frames."""

from rwt_bridge.bridge import Bridge

__all__ = ["Bridge"]
