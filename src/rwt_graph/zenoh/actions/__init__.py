"""Actions across processes: goals as the services and topics that ROS 2 makes of them."""
