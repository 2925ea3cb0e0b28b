"""Errors of exchanges with a vehicle; their texts are the reasons that callers get."""

from __future__ import annotations

from rwt_participant.errors import ServiceFailed


class VehicleError(ServiceFailed):
    """Base of the errors of exchanges with a vehicle."""


class Unavailable(VehicleError):
    """The vehicle cannot be commanded now: its link is lost, or an id is used twice."""


class NoAnswer(VehicleError):
    """The vehicle did not answer. Whether it executed the request is not known."""


class Rebooted(VehicleError):
    """The vehicle restarted before it answered. Whether it executed the request is not known."""


class Rejected(VehicleError):
    """The vehicle answered that it does not accept the request."""
