"""Connections of ROS 1: TCPROS and XML-RPC over HTTP, their bytes, and sockets on the event loop."""
