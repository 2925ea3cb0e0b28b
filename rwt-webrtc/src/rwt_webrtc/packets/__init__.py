"""Packets of a peer, without I/O: validation and limits, reassembly, and the order of sending."""
