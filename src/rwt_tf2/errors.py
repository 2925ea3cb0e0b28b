"""Everything that `rwt_tf2` raises.

* :exc:`TransformError`

  * :exc:`LookupFailed`: the buffer cannot answer a question.

    * :exc:`UnknownFrame`: a frame that no transform has named.
    * :exc:`ConnectivityError`: two frames that no chain of transforms joins.
    * :exc:`ExtrapolationError`: a time that the buffer's data does not reach.

  * :exc:`InvalidTransform`: a transform that cannot be taken; also a :exc:`ValueError`.

    * :exc:`LoopRefused`: it would make a frame its own ancestor.
    * :exc:`StaleTransform`: it is older than what the buffer keeps.
"""

from __future__ import annotations

from rwt_tf2.times import seconds


class TransformError(Exception):
    """Base of every error of this package. The text says what, where and what instead."""


class LookupFailed(TransformError, LookupError):
    """The buffer has no answer, or none yet."""


class UnknownFrame(LookupFailed):
    """No transform that came so far has named this frame.

    Attributes:
        frame: its name.
    """

    def __init__(self, frame: str, known: tuple[str, ...]) -> None:
        listed = ", ".join(known[:_LISTED]) + (", …" if len(known) > _LISTED else "")
        super().__init__(f'frame "{frame}" is not known; known are {listed or "none"}')
        self.frame = frame


class ConnectivityError(LookupFailed):
    """Two frames of different trees.

    Attributes:
        target, source: the frames.
    """

    def __init__(self, target: str, source: str, target_root: str, source_root: str) -> None:
        super().__init__(
            f"no chain of transforms joins {target} and {source}: "
            f"the tree of {target} ends at {target_root}, that of {source} at {source_root}"
        )
        self.target = target
        self.source = source


class ExtrapolationError(LookupFailed):
    """The time that was asked for is before the earliest or after the latest of the data.

    Attributes:
        target, source: what was looked up.
        parent, child: the transform on the way whose data does not reach.
        requested_ns: the time that was asked for.
        nearest_ns: the nearest one that there is.
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
        self.target = target
        self.source = source
        self.parent = parent
        self.child = child
        self.requested_ns = requested_ns
        self.nearest_ns = nearest_ns

    @property
    def future(self) -> bool:
        """Whether the data may yet come; into the past it never will."""
        return self.requested_ns > self.nearest_ns


class InvalidTransform(TransformError, ValueError):
    """A transform that the buffer does not take."""


class LoopRefused(InvalidTransform):
    """The transform would make a frame its own ancestor."""


class StaleTransform(InvalidTransform):
    """The transform is older than what the buffer keeps of its frame."""


_LISTED = 8
