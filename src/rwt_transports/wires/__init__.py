"""Wires: protocols without I/O. Bytes in, messages out; a frame in, bytes out."""
