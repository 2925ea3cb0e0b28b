"""Delivery of samples from the graph to clients: shared publishers, fan-out, throttling, drop notices."""
