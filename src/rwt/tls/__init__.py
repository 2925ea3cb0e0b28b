"""Encryption of connections: certificates from files, or created by the machine."""
