"""Ready-made nodes, written on the public graph API as a user would write them."""

from rwt_nodes.rosapi import Rosapi

__all__ = ["Rosapi"]
