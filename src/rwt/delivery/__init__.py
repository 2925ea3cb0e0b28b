"""From one sample in the graph to many clients: shared publishers, fan-out, throttling, drop notices."""
