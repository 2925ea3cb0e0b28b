"""Errors of a connection, in addition to those of every robot program (:mod:`rwt_participant.errors`)."""

from __future__ import annotations

from rwt_participant.errors import CallFailed, RobotError


class ClientError(RobotError):
    """Base of the errors that only a connection raises."""


class ConnectionLost(ClientError, CallFailed, ConnectionError):
    """The connection was lost or failed before the operation was done."""


class BadAddress(ClientError, ValueError):
    """The URL is invalid; the text names the reason."""


class CannotConnect(ConnectionLost):
    """The connection was refused, or the server rejected it."""


class NotConnected(ConnectionLost):
    """The client is not connected now."""


class ConnectionClosed(ConnectionLost):
    """This program has closed the connection."""


class ServerRefused(ClientError):
    """The server rejects a subscription or advertisement; with its text."""


class MessageRejected(ServerRefused):
    """The server rejected a published message; with its text."""
