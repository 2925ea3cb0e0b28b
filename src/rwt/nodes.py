"""Deprecated: nodes are in `rwt.rosapi` and `rwt.extensions`; this name works until version 0.3."""

from rwt_protocol.extensions import exports

__path__: list[str] = []  # Its modules are found by :mod:`rwt.moved`.

__all__, __getattr__, __dir__ = exports(
    __name__, {"rwt.rosapi": "Rosapi", "rwt.extensions.tf_stream": "Tf2WebRepublisher"}
)
