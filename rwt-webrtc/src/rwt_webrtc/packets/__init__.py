"""Packets of a peer, without I/O: validation and limits before they are parsed, and reassembly."""
