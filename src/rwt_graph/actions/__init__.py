"""Actions across processes: goals as the services and topics of ROS 2."""
