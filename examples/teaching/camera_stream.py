"""A camera as a browser sees it: MJPEG over HTTP."""

from __future__ import annotations

import http.client
import threading
import time
from typing import Final
from urllib.parse import urlsplit

_PATIENCE: Final = 30.0
"""Seconds for a picture to come."""


class CameraStream:
    """Reads the pictures of a topic in a thread, as fast as they come, until it is closed.

    It waits for the first one: cameras are drawn from the first viewer on.

    Args:
        url: of the server, as `ws://HOST:PORT`.
        topic: of `sensor_msgs/Image`.

    Raises:
        RuntimeError: no picture comes; says why.

    Attributes:
        ages: of the pictures since the last :meth:`clear`: seconds from their stamp to their arrival.
    """

    def __init__(self, url: str, topic: str) -> None:
        self.ages: list[float] = []
        place = urlsplit(url)
        self._line = http.client.HTTPConnection(place.hostname or "", place.port, timeout=_PATIENCE)
        self._line.request("GET", f"/stream?topic={topic}")
        self._response = self._line.getresponse()
        if self._response.status != 200:
            reason = self._response.read().decode(errors="replace").strip()
            raise RuntimeError(f"no pictures of {topic}: {self._response.status} {reason}")
        self._closed = False
        self._began = threading.Event()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()
        if not self._began.wait(_PATIENCE):
            raise RuntimeError(f"no picture of {topic} came within {_PATIENCE:g} s")

    def clear(self) -> None:
        """Forget what came so far."""
        self.ages = []

    def close(self) -> None:
        """Stop after the picture that is on its way."""
        self._closed = True
        self._thread.join()
        self._line.close()

    def _read(self) -> None:
        """Parts of RFC 2046 section 5.1, whose head says how long they are."""
        headers: dict[str, str] = {}
        while not self._closed and (line := self._response.readline()):
            name, _, value = line.decode("latin-1").strip().partition(":")
            headers[name.lower()] = value.strip()
            if not name and "content-length" in headers:  # the empty line after a part's head
                self._response.read(int(headers["content-length"]))
                self.ages.append(time.time() - float(headers["x-timestamp"]))
                headers = {}
                self._began.set()
