"""Errors of a connection, in addition to those of every robot program (:mod:`rwt_participant.errors`).

* :exc:`ClientError`

  * :exc:`BadAddress`: a URL that names no robot; also a :exc:`ValueError`.
  * :exc:`ConnectionLost`: the connection was lost, or could not be had, and this was not done; also a
    :exc:`CallFailed`, because so end the calls and goals that are under way, and a :exc:`ConnectionError`.

    * :exc:`CannotConnect`: the first connection could not be had.
    * :exc:`NotConnected`: there is no connection now; another attempt may be under way.
    * :exc:`ConnectionClosed`: this program has closed the connection.

  * :exc:`ServerRefused`: the server does not serve a topic so; the text is the server's.
"""

from __future__ import annotations

from rwt_participant.errors import CallFailed, RobotError


class ClientError(RobotError):
    """Base of the errors that only a connection raises."""


class ConnectionLost(ClientError, CallFailed, ConnectionError):
    """The connection was lost or could not be had, and what was asked for was not done."""


class BadAddress(ClientError, ValueError):
    """A URL that cannot be connected to; says what is wrong with it."""


class CannotConnect(ConnectionLost):
    """The connection was refused, or the server rejected it."""


class NotConnected(ConnectionLost):
    """The client is not connected now."""


class ConnectionClosed(ConnectionLost):
    """This program has closed the connection."""


class ServerRefused(ClientError):
    """The server does not serve the topic so. The text is the server's."""
