"""Drivers: they move bytes between the network and connections, and know no protocol."""
