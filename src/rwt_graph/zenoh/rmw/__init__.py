"""rmw_zenoh's wire, as ROS 2 speaks it since Jazzy: keys, tokens, attachments. Nothing here does I/O.

The format is that of the public design document of `ros2/rmw_zenoh`; the sections named in the docstrings are
its sections.
"""
