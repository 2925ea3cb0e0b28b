"""Connections of ROS 1 over the transports: TCPROS and XML-RPC, their bytes, addresses and types."""
