"""Transports and encodings of the suite, independent of the server's."""
