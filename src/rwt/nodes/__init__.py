"""Ready-made nodes, written on the public graph API as a user would write them."""

from rwt.nodes.rosapi import Rosapi
from rwt.nodes.tf import Tf2WebRepublisher

__all__ = ["Rosapi", "Tf2WebRepublisher"]
