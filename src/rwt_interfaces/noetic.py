"""Standard messages of ROS 1 noetic as classes, known to type checkers.

>>> from rwt_interfaces.noetic import geometry_msgs
>>> geometry_msgs.Vector3(x=0.5)
Vector3(x=0.5, y=0.0, z=0.0)
"""

from rwt_interfaces.distro import NOETIC
from rwt_interfaces.message_classes import packages_of

__getattr__ = packages_of(NOETIC)
