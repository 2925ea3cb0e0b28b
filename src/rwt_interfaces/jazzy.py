"""Standard messages of ROS 2 jazzy as classes, known to type checkers.

>>> from rwt_interfaces.jazzy import geometry_msgs
>>> geometry_msgs.Vector3(x=0.5)
Vector3(x=0.5, y=0.0, z=0.0)
"""

from rwt_interfaces.distro import JAZZY
from rwt_interfaces.message_classes import packages_of

__getattr__ = packages_of(JAZZY)
