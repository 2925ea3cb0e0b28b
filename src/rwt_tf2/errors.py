"""Errors of `rwt_tf2`."""

from __future__ import annotations

from rwt_tf2.times import seconds


class TransformError(Exception):
    """Base class of all errors of this package."""


class LookupFailed(TransformError, LookupError):
    """The lookup failed; it may succeed later."""


class UnknownFrame(LookupFailed):
    """The buffer has no transform of this frame.

    Attributes:
        frame: name of the frame.
    """

    def __init__(self, frame: str, known: tuple[str, ...]) -> None:
        listed = ", ".join(known[:_LISTED]) + (", …" if len(known) > _LISTED else "")
        super().__init__(f'frame "{frame}" is not known; known are {listed or "none"}')
        self.frame = frame


class ConnectivityError(LookupFailed):
    """The two frames are in different trees."""

    def __init__(self, target: str, source: str, target_root: str, source_root: str) -> None:
        super().__init__(
            f"no chain of transforms joins {target} and {source}: "
            f"the tree of {target} ends at {target_root}, that of {source} at {source_root}"
        )


class ExtrapolationError(LookupFailed):
    """The requested time is before the earliest or after the latest data.

    Attributes:
        parent, child: transform on the path whose data does not cover the time.
        requested_ns: requested time.
        nearest_ns: nearest available time.
    """

    def __init__(
        self, target: str, source: str, parent: str, child: str, requested_ns: int, nearest_ns: int
    ) -> None:
        apart = seconds(abs(requested_ns - nearest_ns))
        if requested_ns > nearest_ns:
            why = f"into the future: its latest is {apart} s older, at {seconds(nearest_ns)} s"
        else:
            why = f"into the past: its earliest is {apart} s younger, at {seconds(nearest_ns)} s"
        super().__init__(
            f"{target} <- {source} at {seconds(requested_ns)} s needs {parent} <- {child} extrapolated {why}"
        )
        self.parent = parent
        self.child = child
        self.requested_ns = requested_ns
        self.nearest_ns = nearest_ns

    @property
    def future(self) -> bool:
        """True if the time is after the data, which may still arrive."""
        return self.requested_ns > self.nearest_ns


class InvalidTransform(TransformError, ValueError):
    """The transform is invalid."""


class InvalidDescription(TransformError, ValueError):
    """The robot description (URDF) is invalid."""


class LoopRefused(InvalidTransform):
    """The transform would make a frame its own ancestor."""


class StaleTransform(InvalidTransform):
    """The transform is older than what the buffer retains of its frame."""


_LISTED = 8
