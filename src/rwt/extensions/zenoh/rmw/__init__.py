"""Wire format of rmw_zenoh, as of ROS 2 Jazzy: keys, tokens, attachments. Without I/O.

The format is that of the public design document of `ros2/rmw_zenoh`; docstrings name its sections.
"""
