"""Description of a robot (URDF), and the transforms of its links from joint states."""

from __future__ import annotations

import logging
import math
from typing import Final

from rwt_participant.handles import Handle
from rwt_participant.messages import Message
from rwt_participant.transforms import AdvertiseVerb, SubscribeVerb, Transforms
from rwt_tf2 import stamp_ns
from rwt_tf2.times import NANOSECONDS
from rwt_tf2.urdf import KinematicTree

logger = logging.getLogger(__name__)

TOPIC: Final = "robot_description"
_JOINTS: Final = "joint_states"


class DescriptionHandle(Handle):
    """Published description of a robot; see :meth:`~rwt_participant.api.RobotApi.describe`."""

    def __init__(
        self,
        subscribe: SubscribeVerb,
        advertise: AdvertiseVerb,
        tf: Transforms,
        urdf: str,
        frame_prefix: str,
        publish_frequency: float,
    ) -> None:
        if not 0.0 < publish_frequency < math.inf:
            raise ValueError(f"publish_frequency is {publish_frequency}, expected a number above 0")
        self._tree = KinematicTree(urdf, frame_prefix)
        self._tf = tf
        self._interval_ns = round(NANOSECONDS / publish_frequency)
        self._sent_ns: dict[str, int] = {}
        self._warned = False
        self._publisher = advertise(TOPIC, "std_msgs/String", latch=True)
        self._publisher.publish({"data": urdf})
        self.name = self._publisher.name
        tf.send_transforms(self._tree.fixed(0), static=True)
        self._subscription = subscribe(_JOINTS, self._receive, "sensor_msgs/JointState")

    async def ready(self) -> None:
        await self._publisher.ready()
        await self._subscription.ready()

    def close(self) -> None:
        self._subscription.close()
        self._publisher.close()

    def _receive(self, state: Message) -> None:
        if len(state.name) != len(state.position):
            if len(state.position) and not self._warned:
                self._warned = True
                logger.warning(
                    "%s: %d names, but %d positions; such messages move no frame",
                    self._subscription.name,
                    len(state.name),
                    len(state.position),
                )
            return
        stamp = stamp_ns(state.header.stamp)
        due = {
            name: float(position)
            for name, position in zip(state.name, state.position, strict=True)
            if self._tree.moves(name) and self._is_due(name, stamp)
        }
        if moved := self._tree.moving(due, stamp):
            self._sent_ns.update(dict.fromkeys(due, stamp))
            self._tf.send_transforms(moved)

    def _is_due(self, joint: str, stamp: int) -> bool:
        """Return False for a state too soon after the last one; True after a jump back in time."""
        last = self._sent_ns.get(joint)
        return last is None or not 0 <= stamp - last < self._interval_ns
