"""Classes that the C++ part of `rclpy` accepts in place of generated ones.

`rclpy` reads a type support from a capsule of the class's metaclass, and never looks at the fields of a raw
sample.
"""

from __future__ import annotations

import ctypes
from typing import Any, Final

_new_capsule = ctypes.pythonapi.PyCapsule_New
_new_capsule.restype = ctypes.py_object
_new_capsule.argtypes = (ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)

#: Name of every capsule. A capsule refers to its name, which therefore lives as long as the process.
_CAPSULE_NAME: Final = ctypes.c_char_p(b"rosidl_message_type_support_t")


def class_of(name: str, support: int) -> Any:
    """Return the class of a message or service, given its full name and the address of its type support."""
    capsule = _new_capsule(support, _CAPSULE_NAME, None)
    metaclass = type("TypeSupport", (type,), {"_TYPE_SUPPORT": capsule})
    return metaclass(name.rpartition("/")[2], (), {"__slots__": ()})
