"""Audio topics as Opus: one encoder per topic, and a short queue of packets for each listener.

Audio is decoded and encoded in a worker thread. Without listeners the topic is not subscribed to. Audio
faster than real time is dropped, and so are the oldest messages and packets of a full queue.
"""

from __future__ import annotations

import logging
import time
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Final

import anyio
import anyio.to_thread

from rwt.extensions.video.server import VisibleTopics
from rwt.media.broadcast import EncoderThreads, Listener, SharedStream
from rwt.media.errors import RequestRefused
from rwt_graph import Graph, InvalidGraphName, Node, Sample
from rwt_graph.names import resolve
from rwt_interfaces.payload import Payload
from rwt_participant.errors import TimedOut
from rwt_participant.messages import Message, type_of
from rwt_transports.http.routes import Reader, WorkAccount
from rwt_webrtc.media.audio import DATA, INFO, INFO_SUFFIX, AudioFormat, AudioUnreadable, read_info
from rwt_webrtc.media.opus_encoder import OpusEncoder, OpusPacket

NAME: Final = "whep"
PATIENCE: Final = 5.0
"""Seconds to wait for an `AudioInfo`: the dashboard sends one per second."""
WAITING_BYTES: Final = 2 << 20
WAITING_MESSAGES: Final = 64
"""Maximum queue of a topic; a message of the dashboard holds a twentieth of a second."""
WAITING_PACKETS: Final = 25
"""Maximum queue of a listener, in packets of 20 ms."""

logger = logging.getLogger("rwt_webrtc.media")


class AudioBroadcast(SharedStream[Listener[OpusPacket]]):
    """Subscriptions and encoder shared by all listeners of a topic.

    Args:
        samples: format of the samples until another `AudioInfo` arrives.
    """

    def __init__(
        self,
        node: Node,
        topic: str,
        samples: AudioFormat,
        threads: EncoderThreads,
        on_end: Callable[[], object],
    ) -> None:
        super().__init__(on_end)
        self._topic = topic
        self._threads = threads
        self._encoder = OpusEncoder(samples)
        self._waiting: deque[tuple[float, Payload]] = deque()
        self._waiting_bytes = 0
        self._complaint = ""
        node.graph.spawn(self._run, f"sound of {topic}")
        # Without types, which would hold those of the topics against the robot: listeners choose the topic.
        self._subscriptions = (
            node.subscribe_samples(f"{topic}{INFO_SUFFIX}", partial(self._take, INFO)),
            node.subscribe_samples(topic, partial(self._take, DATA)),
        )

    def join(self, work: WorkAccount) -> Listener[OpusPacket]:
        """Add a listener."""
        listener: Listener[OpusPacket] = Listener(work, self.leave, WAITING_PACKETS)
        self.listeners.append(listener)
        return listener

    def _take(self, wanted: str, sample: Sample) -> None:
        """Queue a message of either topic, in order of arrival; drop the oldest ones of a full queue."""
        if sample.payload.type.name != wanted:
            self.end(AudioUnreadable(f"{sample.topic} is a {sample.payload.type.name} now, not a {wanted}"))
            return
        payload = sample.payload.detach()
        self._waiting.append((time.monotonic(), payload))
        self._waiting_bytes += payload.kept_size
        while self._waiting_bytes > WAITING_BYTES or len(self._waiting) > WAITING_MESSAGES:
            self._waiting_bytes -= self._waiting.popleft()[1].kept_size
        self.wake()

    async def _run(self) -> None:
        while not self.is_over:
            messages = tuple(self._waiting)
            if not messages:
                await self._woken.wait()
                self._woken = anyio.Event()
                continue
            self._waiting.clear()
            self._waiting_bytes = 0
            encode = partial(self._encoder.encode, messages)
            try:
                packets = await self._threads.run(encode, tuple(each.work for each in self.listeners))
            except AudioUnreadable as error:
                self._complain(error)
                self.end(error)
            except Exception:
                logger.exception("the sound of %s could not be encoded", self._topic)
                self.end(AudioUnreadable("internal error"))
            else:
                if self._encoder.complaint is not None:
                    self._complain(self._encoder.complaint)
                self.note_encoded()
                for listener in self.listeners:
                    for packet in packets:
                        listener.put(packet)

    def _complain(self, error: AudioUnreadable) -> None:
        # Once: a microphone must not fill the log.
        if self._complaint != str(error):
            self._complaint = str(error)
            logger.warning("%s: %s", self._topic, error)


def topics_of(name: str) -> tuple[str, str]:
    """Return the topics to subscribe to for the audio of a topic: samples, and their format."""
    return name, f"{name}{INFO_SUFFIX}"


class AudioTopics:
    """Audio topics of a graph."""

    def __init__(self, graph: Graph) -> None:
        self._node = Node(graph, NAME)
        self._broadcasts: dict[str, AudioBroadcast] = {}
        self._threads = EncoderThreads()

    def close(self) -> None:
        """End all audio, and leave the graph."""
        for broadcast in tuple(self._broadcasts.values()):
            broadcast.end()
        self._node.close()

    async def find(self, topic: str, reader: Reader) -> tuple[str, AudioFormat]:
        """Return the absolute name of a topic and the format of its samples.

        Raises:
            RequestRefused: the reader may not subscribe to it, it does not exist, or it cannot be decoded.
        """
        try:
            name = resolve(topic)
        except InvalidGraphName as error:
            raise RequestRefused(400, str(error)) from error
        topics = VisibleTopics(self._node.graph, reader)
        for each in topics_of(name):
            topics.require(each)
        kind = topics.type_of(name)
        if kind is None:
            known = ", ".join(topics.of_types(DATA)) or "none"
            raise RequestRefused(404, f"there is no topic {name}; sound topics are: {known}")
        if kind != DATA:
            raise RequestRefused(400, f"{name} is a {kind}; sound is {DATA}")
        info = await self._info(name, topics)
        try:
            return name, read_info(info)
        except AudioUnreadable as error:
            raise RequestRefused(422, f"{name}: {error}") from error

    async def _info(self, name: str, topics: VisibleTopics) -> Message:
        """Wait for the next `AudioInfo`; a retained one arrives at once."""
        topic = f"{name}{INFO_SUFFIX}"
        kind = topics.type_of(topic)
        if kind not in (None, INFO):
            raise RequestRefused(400, f"{topic} is a {kind}, where {INFO} tells of the sound")
        try:
            info = await self._node.once(topic, timeout=PATIENCE)
        except TimedOut:
            raise RequestRefused(
                504, f"no {INFO} came on {topic} within {PATIENCE:g} s: the format of {name} is not known"
            ) from None
        kind = type_of(info, self._node.registry)
        if kind != INFO:
            raise RequestRefused(400, f"{topic} is a {kind}, where {INFO} tells of the sound")
        return info

    def listen(self, name: str, samples: AudioFormat, work: WorkAccount) -> Listener[OpusPacket]:
        """Add a listener to a topic found by :meth:`find`; its `leave` removes it."""
        broadcast = self._broadcasts.get(name)
        if broadcast is None:
            ended = partial(self._broadcasts.pop, name)
            broadcast = AudioBroadcast(self._node, name, samples, self._threads, ended)
            self._broadcasts[name] = broadcast
        return broadcast.join(work)
