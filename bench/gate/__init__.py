"""Latency of the gate's stops while clients attack the server."""
