"""Robot of a MuJoCo model: its physics on the graph's loop, and its topics, services and actions."""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Final

from rwt_graph import Graph, Node
from rwt_lerobot.joints.controller import TrajectoryController
from rwt_lerobot.reports import warn
from rwt_lerobot.simulation.cameras import CameraThread, Lens, camera_info, optical_frame
from rwt_lerobot.simulation.model import ARM, HOME, Model, pose
from rwt_participant.messages import Message, MessageLike
from rwt_participant.qos import LATCHED
from rwt_tf2 import StampedTransform, Transform, write_transform

CONTROL_SECONDS: Final = 0.02
"""Interval of control and of joint states, simulated seconds."""

#: Processor time that physics may take of one interval, seconds; then the simulation is slower than asked.
_BUSY_SECONDS: Final = 0.014
#: Share of TF messages among the steps.
_TF_EVERY: Final = 2
#: Half turn about x: MuJoCo's cameras look along -z with y up, optical frames along z with y down.
_OPTICAL: Final = Transform(rotation=(1.0, 0.0, 0.0, 0.0))


class MujocoRobot:
    """Robot of a MuJoCo model, with the names of the demo robot's arm.

    Simulated time begins at the time of day, and advances with the physics: stamps, `/clock` and transforms
    have it. While the simulation is paused, it stands still.

    Args:
        graph: graph of a server.
        path: model; by default the six-joint arm.
        lens: size and rate of images.
        speed: simulated seconds per second; 0 is as fast as possible.
        namespace: prefix of all names; `/tf` and `/clock` have none.

    Attributes:
        model: the compiled model.
        data: MuJoCo's `MjData`.
        controller: controller of the joints that have position actuators.
        paused: True while the simulation stands still.
    """

    def __init__(
        self,
        graph: Graph,
        path: Path = ARM,
        *,
        lens: Lens | None = None,
        speed: float = 1.0,
        namespace: str = "/",
    ) -> None:
        self.model = Model(path)
        self.data = self.model.mujoco.MjData(self.model.compiled)
        self.paused = False
        self._lens = lens or Lens()
        self._speed = speed
        self._node = node = Node(graph, "mujoco", namespace)
        self._driven = [joint for joint in self.model.joints if joint.actuator is not None]
        self.controller = TrajectoryController(
            node,
            [joint.limit for joint in self._driven],
            node.resolve("arm_controller"),
            partial(warn, node, "mujoco"),
        )
        self._states = node.advertise("joint_states", "sensor_msgs/JointState")
        self._tf = node.advertise("/tf", "tf2_msgs/TFMessage")
        self._clock = node.advertise("/clock", "rosgraph_msgs/Clock")
        self._sensors = {
            name: node.advertise(f"sensors/{name}", "std_msgs/Float64MultiArray")
            for name in self.model.sensors
        }
        self._images = {
            name: node.advertise(f"{name}/image_raw/compressed", "sensor_msgs/CompressedImage")
            for name in self.model.cameras
        }
        self._infos = {
            name: node.advertise(f"{name}/camera_info", "sensor_msgs/CameraInfo")
            for name in self.model.cameras
        }
        self._serve()
        self._cameras: CameraThread | None = None
        self._shot_due = 0.0
        self._steps = 0
        self._owed = 0.0
        self._began_ns = node.clock.time_ns()
        self._ticked = node.clock.monotonic()
        self.reset()
        self._timer = node.create_timer(CONTROL_SECONDS, self._tick)

    def _serve(self) -> None:
        """Publish the description, and offer topics and services that command the simulation."""
        node = self._node
        for name, index in self.model.other_actuators.items():
            node.subscribe(f"actuators/{name}", partial(self._actuate, index), "std_msgs/Float64")
        description = node.advertise("robot_description", "std_msgs/String", qos=LATCHED)
        description.publish({"data": self.model.urdf()})
        for name, kind, handler in (
            ("pause", "std_srvs/SetBool", self._pause),
            ("step", "std_srvs/Trigger", self._step_once),
            ("reset", "std_srvs/Trigger", self._reset),
        ):
            node.advertise_service(f"simulation/{name}", kind, handler)

    def close(self) -> None:
        """Leave the graph, and end the thread of the cameras."""
        if self._cameras is not None:  # First: the thread uses publishers of the node.
            self._cameras.close()
        self.controller.close()
        self._node.close()

    def reset(self) -> None:
        """Return to the keyframe `home`, or to the model's own positions; time goes on."""
        mujoco, model, seconds = self.model.mujoco, self.model.compiled, self.data.time
        self.controller.fail("the simulation was reset")
        key = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, HOME)
        if key >= 0:
            mujoco.mj_resetDataKeyframe(model, self.data, key)
        else:
            mujoco.mj_resetData(model, self.data)
        for joint in self._driven:
            self.data.ctrl[joint.actuator] = self.data.qpos[joint.position]
        self.data.time = seconds
        mujoco.mj_forward(model, self.data)
        self.controller.measure(self._positions())

    @property
    def time_ns(self) -> int:
        """Simulated time, nanoseconds since the epoch."""
        return self._began_ns + round(float(self.data.time) * 1e9)

    def step(self) -> None:
        """Advance by one interval of control, and publish."""
        setpoint = self.controller.step(CONTROL_SECONDS)
        # Before the first command the actuators keep theirs: the measured positions sag.
        if setpoint is not None and self.controller.is_commanded:
            for joint, angle in zip(self._driven, setpoint, strict=True):
                self.data.ctrl[joint.actuator] = angle
        count = max(1, round(CONTROL_SECONDS / self.model.compiled.opt.timestep))
        self.model.mujoco.mj_step(self.model.compiled, self.data, count)
        self.controller.measure(self._positions())
        self._steps += 1
        self._publish()

    def _tick(self) -> None:
        now = self._node.clock.monotonic()
        elapsed, self._ticked = now - self._ticked, now
        if self.paused:
            return
        began = time.perf_counter()
        # Time that the machine could not simulate is dropped, not made up for.
        self._owed = min(self._owed + elapsed * self._speed, 10 * CONTROL_SECONDS * max(self._speed, 1.0))
        while self._speed == 0 or self._owed >= CONTROL_SECONDS - 1e-9:
            self.step()
            self._owed = max(0.0, self._owed - CONTROL_SECONDS)
            if time.perf_counter() - began > _BUSY_SECONDS:
                return

    def _positions(self) -> tuple[float, ...]:
        return tuple(float(self.data.qpos[joint.position]) for joint in self._driven)

    def _publish(self) -> None:
        seconds, rest = divmod(self.time_ns, 10**9)
        stamp = {"sec": seconds, "nanosec": rest}
        if self._clock.subscriber_count:
            self._clock.publish({"clock": stamp})
        if self._states.subscriber_count:
            joints = self.model.joints
            self._states.publish(
                {
                    "header": {"stamp": stamp},
                    "name": [joint.limit.name for joint in joints],
                    "position": [float(self.data.qpos[joint.position]) for joint in joints],
                    "velocity": [float(self.data.qvel[joint.velocity]) for joint in joints],
                    "effort": [float(self.data.qfrc_actuator[joint.velocity]) for joint in joints],
                }
            )
        for name, publisher in self._sensors.items():
            if publisher.subscriber_count:
                publisher.publish({"data": self.data.sensordata[self.model.sensors[name]].tolist()})
        if self._steps % _TF_EVERY == 0 and self._tf.subscriber_count:
            self._tf.publish({"transforms": list(self._transforms())})
        self._shoot(stamp)

    def _shoot(self, stamp: dict[str, int]) -> None:
        if self.data.time < self._shot_due:
            return
        # On a grid, since the rate is not a divisor of that of the steps; after a pause without catching up.
        self._shot_due = max(self._shot_due + 1 / self._lens.rate, self.data.time - CONTROL_SECONDS)
        watched = [name for name, publisher in self._images.items() if publisher.subscriber_count]
        for name, publisher in self._infos.items():
            if publisher.subscriber_count:
                publisher.publish(camera_info(name, self._lens, self.model.cameras[name], stamp))
        if watched:
            if self._cameras is None:
                self._cameras = CameraThread(self.model, self._lens, self._images)
            self._cameras.shoot(self.data.qpos.copy(), watched, self.time_ns)

    def _transforms(self) -> Iterator[MessageLike]:
        model, data, stamp_ns = self.model.compiled, self.data, self.time_ns
        poses = [pose(data.xpos[body], data.xquat[body]) for body in range(model.nbody)]
        for body in range(1, model.nbody):
            parent = int(model.body_parentid[body])
            names = self.model.body_name(parent), self.model.body_name(body)
            yield write_transform(StampedTransform(*names, stamp_ns, poses[parent].inverse() @ poses[body]))
        for name in self.model.cameras:
            camera = model.camera(name)
            parent_name = self.model.body_name(int(model.cam_bodyid[camera.id]))
            mounted = pose(camera.pos, camera.quat) @ _OPTICAL
            yield write_transform(StampedTransform(parent_name, optical_frame(name), stamp_ns, mounted))

    def _actuate(self, index: int, message: Message) -> None:
        lower, upper = self.model.compiled.actuator_ctrlrange[index]
        value = float(message.data)
        if self.model.compiled.actuator_ctrllimited[index] and not lower <= value <= upper:
            name = self.model.compiled.actuator(index).name
            warn(self._node, "mujoco", f"rejected {value:g} for {name}: its range is {lower:g} to {upper:g}")
            return
        self.data.ctrl[index] = value

    def _pause(self, request: Message) -> MessageLike:
        self.paused = bool(request.data)
        return {"success": True, "message": "paused" if self.paused else "running"}

    def _step_once(self, request: object) -> MessageLike:
        if not self.paused:
            return {"success": False, "message": "the simulation is running: pause it first"}
        self.step()
        return {"success": True, "message": f"at {self.data.time:.3f} s"}

    def _reset(self, request: object) -> MessageLike:
        self.reset()
        return {"success": True}
