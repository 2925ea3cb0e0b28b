"""Topics in Jupyter notebooks: images, maps and plots.

>>> camera = show(robot, "/camera/image_raw/compressed")
>>> show(robot, "/odom", "twist.twist.linear.x")

Jupyter displays a view that ends a cell. With the extra `notebook` (anywidget) it is live; otherwise it shows
the state when the cell ran.
"""

from __future__ import annotations

import base64
import functools
import html
import importlib.util
import io
import operator
import threading
import time
from collections import deque
from typing import TYPE_CHECKING, Any, Final

from rwt_client.blocking import BlockingRobot
from rwt_participant.errors import TimedOut
from rwt_participant.images import image_to_pillow
from rwt_participant.messages import Message

if TYPE_CHECKING:
    from PIL import Image

_MAX_POINTS: Final = 500
_LIVE_SECONDS: Final = 0.1
"""Minimum interval between two updates of a live view."""

_WIDTH: Final = 640
_HEIGHT: Final = 240

_MODULE: Final = """
function render({ model, el }) {
  const image = document.createElement("img");
  image.style.maxWidth = "100%";
  const draw = () => { image.src = model.get("source"); };
  model.on("change:source", draw);
  draw();
  el.appendChild(image);
}
export default { render };
"""


def show(robot: BlockingRobot, topic: str, field: str = "", *, timeout: float = 10.0) -> TopicView:
    """Return a view of a topic, which Jupyter displays; it follows the topic until :meth:`TopicView.close`.

    Args:
        topic: topic with images (`sensor_msgs/Image`, `sensor_msgs/CompressedImage`) or a map
            (`nav_msgs/OccupancyGrid`), or any topic if `field` is given.
        field: path of a numeric field to plot over time, such as ``pose.pose.position.x``.
        timeout: seconds to wait for the first message.

    Raises:
        TimedOut: there was no message in time.
        ValueError: the topic has no image or map, or the field is not a number.
    """
    return TopicView(robot, topic, field, timeout)


class TopicView:
    """Latest image or map of a topic, or a plot of a field; returned by :func:`show`.

    Messages arrive in the robot's thread; Jupyter renders in its own.
    """

    def __init__(self, robot: BlockingRobot, topic: str, field: str, timeout: float) -> None:
        self.topic = topic
        self.field = field
        self._value = operator.attrgetter(field) if field else None
        self._points: deque[tuple[float, float]] = deque(maxlen=_MAX_POINTS)
        self._latest: Message | None = None
        self._arrived = threading.Event()
        self.widget: Any = None
        self._updated = 0.0
        self._subscription = robot.subscribe(topic, self._take, arrays="numpy")
        try:
            if not self._arrived.wait(timeout):
                raise TimedOut(f"no message on {topic} within {timeout:g} s")
            self.render()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """End the subscription; what is displayed remains."""
        self._subscription.close()

    def render(self) -> tuple[str, bytes]:
        """Return the MIME type and content: a PNG image, or a plot as SVG.

        Raises:
            ImageFormat: the encoding of the image has no counterpart.
            ValueError: the topic has no image or map, or the field is not a number.
        """
        if self._value is not None:
            return "image/svg+xml", _plot(tuple(self._points), f"{self.topic} {self.field}").encode()
        message: Any = self._latest
        if hasattr(message, "info") and hasattr(message, "data"):
            image = _map_image(message)
        elif hasattr(message, "format") or hasattr(message, "encoding"):
            image = image_to_pillow(message)
        else:
            raise ValueError(f"{self.topic} has no image or map; name a field to plot")
        return "image/png", _png(image)

    def _take(self, message: Message) -> None:
        if self._value is not None and (self._points or not self._arrived.is_set()):
            try:
                self._points.append((time.monotonic(), float(self._value(message))))
            except (AttributeError, TypeError, ValueError):
                self._points.clear()  # `render` reports it.
        self._latest = message
        self._arrived.set()
        now = time.monotonic()
        if self.widget is not None and now - self._updated >= _LIVE_SECONDS:
            self._updated = now
            self.widget.source = self._source()

    def _source(self) -> str:
        kind, content = self.render()
        return f"data:{kind};base64,{base64.b64encode(content).decode()}"

    def _repr_mimebundle_(self, **_: object) -> dict[str, Any]:
        kind, content = self.render()
        is_text = kind.endswith("xml")
        bundle: dict[str, Any] = {
            "text/plain": repr(self),
            kind: content.decode() if is_text else base64.b64encode(content).decode(),
        }
        if importlib.util.find_spec("anywidget") is not None:
            if self.widget is None:
                self.widget = _widget_class()(source=self._source())
            live = self.widget._repr_mimebundle_()
            # With the metadata of the widget where there are some; the static image is for saved notebooks.
            bundle |= {**(live[0] if isinstance(live, tuple) else live or {}), "text/plain": repr(self)}
        return bundle

    def __repr__(self) -> str:
        return f"<TopicView {self.topic}{f' {self.field}' if self.field else ''}>"


@functools.cache
def _widget_class() -> Any:
    import anywidget
    import traitlets

    return type(
        "_LiveImage",
        (anywidget.AnyWidget,),
        {"_esm": _MODULE, "source": traitlets.Unicode().tag(sync=True)},
    )


def _map_image(message: Any) -> Image.Image:
    import numpy as np
    from PIL import Image

    cells = np.asarray(message.data, np.int8).reshape(message.info.height, message.info.width)
    grey = np.where(cells < 0, 205, 255 - cells.clip(0, 100) * 2.55).astype(np.uint8)
    return Image.fromarray(grey[::-1])  # The first row of a map is at the bottom.


def _png(image: Image.Image) -> bytes:
    if image.mode not in ("1", "L", "LA", "RGB", "RGBA", "I;16"):
        image = image.convert("L" if image.mode == "F" else "RGB")
    file = io.BytesIO()
    image.save(file, "PNG")
    return file.getvalue()


def _plot(points: tuple[tuple[float, float], ...], title: str) -> str:
    if not points:
        raise ValueError(f"{title} is not a number")
    start, end = points[0][0], points[-1][0]
    low, high = min(value for _, value in points), max(value for _, value in points)
    across, up = (_WIDTH - 20) / ((end - start) or 1.0), (_HEIGHT - 60) / ((high - low) or 1.0)
    line = " ".join(
        f"{10 + (at - start) * across:.1f},{_HEIGHT - 30 - (value - low) * up:.1f}" for at, value in points
    )
    size = f'width="{_WIDTH}" height="{_HEIGHT}" font-family="sans-serif" font-size="12"'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" {size}><rect width="100%" height="100%" fill="white"/>'
        f'<text x="10" y="18">{html.escape(title)}</text>'
        f'<polyline fill="none" stroke="#1769aa" stroke-width="1.5" points="{line}"/>'
        f'<text x="10" y="{_HEIGHT - 10}">{low:g} to {high:g}, {end - start:.1f} s</text></svg>'
    )
