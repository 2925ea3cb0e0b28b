"""ROS message definitions, the classes compiled from them, and their serialisations. No I/O."""

from rwt_interfaces.distro import DISTROS, HUMBLE, JAZZY, KILTED, LYRICAL, NOETIC, ROLLING, Distro
from rwt_interfaces.errors import DefinitionError, InterfaceError, InvalidMessage, InvalidName, UnknownType
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry

__all__ = [
    "Registry",
    "Payload",
    "Distro",
    "DISTROS",
    "HUMBLE",
    "JAZZY",
    "KILTED",
    "LYRICAL",
    "ROLLING",
    "NOETIC",
    "InterfaceError",
    "InvalidName",
    "DefinitionError",
    "UnknownType",
    "InvalidMessage",
]
