"""Conformance suite for rosbridge v2: cases as data, and programs that play them.

The suite grades any rosbridge server (`rosbridge-conformance ws://host:9090`) and any client library
(`rosbridge-conformance client -- CMD`). It is independent of this project's server.
"""

__all__ = ["SUITE_VERSION"]

SUITE_VERSION = "1.0.0"
"""Version of the cases: the first number changes when a case that passed may fail (docs/how-to)."""
