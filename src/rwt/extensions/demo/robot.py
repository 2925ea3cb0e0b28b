"""The demo robot: all of its parts on one node."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Final

from rwt.extensions.demo import messages
from rwt.extensions.demo.arm.controller import ArmController
from rwt.extensions.demo.arm.kinematics import Arm
from rwt.extensions.demo.drive import STANDSTILL, Chassis, DifferentialDrive, MotorLimits, Teleop, Velocity
from rwt.extensions.demo.messages import MAP, frame
from rwt.extensions.demo.model.meshes import mesh_pages
from rwt.extensions.demo.model.urdf import camera_mount, urdf, visuals
from rwt.extensions.demo.navigation.goal_marker import GoalMarker
from rwt.extensions.demo.navigation.planner import Planner
from rwt.extensions.demo.navigation.task import Navigation
from rwt.extensions.demo.state import Battery, BatteryPublisher, StatePublisher
from rwt.extensions.demo.world.cameras import CameraPublisher
from rwt.extensions.demo.world.lens import DEFAULT_LENS, Lens
from rwt.extensions.demo.world.lidar import Lidar, ScanPublisher
from rwt.extensions.demo.world.map import World, draw_map, house
from rwt.extensions.depth_cloud import CloudDecimator, DepthCloudEncoder
from rwt_graph import Graph, Node
from rwt_graph.parameters.number_parameters import Number
from rwt_participant.diagnostics import DiagnosticLevel, DiagnosticStatus, DiagnosticUpdater
from rwt_participant.errors import GoalCanceled, ServiceFailed
from rwt_participant.goals import ReceivedGoal
from rwt_participant.messages import Message, ParameterValue
from rwt_tf2 import quaternion_from_yaw

#: Period of control steps in seconds.
CONTROL_PERIOD = 0.05
#: Period of battery state, diagnostics and chatter in seconds.
REPORT_PERIOD = 1.0
#: Maximum time that one step covers after a delay of the program, in seconds.
_LONGEST_STEP = 0.2


#: Ratio of `f` of `ROS3D.DepthCloud` to the focal length divided by the crop, both in pixels.
_CROP_OF_FOCAL = 500.0
#: The `f` of the stock page, for an OpenNI camera.
_OPENNI_F = 525.0


TUNABLES: Final[Mapping[Number, float]] = {
    Number("max_speed", None, 5.0, "m/s", "Fastest the robot drives forwards or backwards."): 0.8,
    Number("max_turn_rate", None, 10.0, "rad/s", "Fastest the robot turns."): 2.0,
    Number("max_acceleration", None, 20.0, "m/s^2", "How fast the speed changes."): 2.0,
    Number("max_turn_acceleration", None, 80.0, "rad/s^2", "How fast the turn rate changes."): 8.0,
    Number("command_timeout", None, 60.0, "s", "Time after the last /cmd_vel at which it stops."): 0.5,
    Number("scan_rate", None, 40.0, "Hz", "Laser scans in a second."): 10.0,
    Number("scan_noise", 0.0, 1.0, "m", "Standard deviation of a measured range."): 0.01,
    Number("camera_rate", None, 60.0, "Hz", "Pictures of each camera in a second."): 30.0,
    Number("fibonacci_rate", None, 1000.0, "Hz", "Numbers that /fibonacci finds in a second."): 2.0,
}
"""Parameters of the robot with their defaults."""


class DemoRobot:
    """Simulated differential-drive robot in a walled world.

    It drives by `/cmd_vel`, `/navigate_to_pose` and, on ROS 1, `/move_base`, moves its arm by
    `/arm_controller/follow_joint_trajectory` and `/arm_controller/joint_trajectory`, publishes `/odom`,
    `/robot_pose`, `/tf`, `/tf_static`, `/joint_states`, `/scan`, `/camera/…`, `/map`, `/plan`,
    `/battery_state`, `/diagnostics`, `/robot_description`, `/chatter`, and serves `/add_two_ints`, `/reset`,
    `/enable_motors` and `/fibonacci`. An interactive marker under `/goal_marker` sends it where it is
    dropped. Its parameters are in :data:`TUNABLES`; `openni_depth_cloud` makes its
    depth stream what the stock pages of ros3djs expect of an OpenNI camera. Two nodes beside it make
    `/depthcloud_encoded` and `/camera/depth/points/decimated` of what its camera sees.

    Args:
        graph: graph of the robot; its clock is the robot's clock.
        world: map; by default a house of 10 m by 8 m.
        seed: seed of the laser's noise, for reproducible runs.
        namespace: namespace of its names, for several robots in one graph; they share `/tf` and
            `/tf_static`, where the frames of one in `/anna` are `anna/odom` and so on.

    Attributes:
        http: meshes of its description, for :func:`rwt.serve`.
    """

    def __init__(
        self,
        graph: Graph,
        world: World | None = None,
        seed: int = 1,
        *,
        namespace: str = "/",
        lens: Lens = DEFAULT_LENS,
    ) -> None:
        self._world = world or house()
        self._node = Node(graph, "demo_robot", namespace)
        chassis = Chassis()
        self._drive = DifferentialDrive(self._world, chassis, MotorLimits())
        self._lidar = Lidar(self._world, seed=seed)
        self._battery = Battery()
        self._teleop = Teleop(self._node)
        self._navigation = Navigation(
            self._node, self._drive, Planner(self._world, chassis.radius), self._world.start
        )
        self._goal_marker = GoalMarker(self._node, self._world.start)
        self._arm = Arm()
        self._arm_controller = ArmController(self._node, self._arm)
        self._state = StatePublisher(self._node, self._drive, self._arm, chassis, self._world.start)
        self._scans = ScanPublisher(self._node, self._drive, self._lidar)
        self._lens = lens
        self._cameras = CameraPublisher(self._node, self._drive, self._world, camera_mount(chassis), lens)
        self._fibonacci = Fibonacci(self._node)
        self._battery_states = BatteryPublisher(self._node, self._battery)
        self._serve()
        self._declare_parameters()
        self._publish_map()
        self._describe(urdf(chassis))
        self.http = mesh_pages(visuals(chassis))
        self._chatter = self._node.advertise("chatter", "std_msgs/String")
        self._said = 0
        self._stepped = self._node.clock.monotonic()
        self._start()

    def close(self) -> None:
        """Leave the graph."""
        for node in (self._depth_cloud, self._thin_cloud, self._node):
            node.close()

    def _start(self) -> None:
        """Start all timers at the same time, so that timers due together wake the program once."""
        self._node.create_timer(CONTROL_PERIOD, self._step)
        self._scans.start()
        self._node.create_timer(REPORT_PERIOD, self._report)
        publish_diagnostics(self._node, self._drive, self._battery, self._navigation, REPORT_PERIOD)
        graph, namespace = self._node.graph, self._node.namespace
        # The square in the middle of the image; two tiles of 3 m cover a room.
        self._depth_cloud = DepthCloudEncoder(
            graph,
            namespace=namespace,
            crop_size=self._whole_crop,
            target_resolution=256,
            max_depth_per_tile=3.0,
        )
        self._node.parameters.declare(
            "openni_depth_cloud",
            False,
            description="Make the depth stream that pages for OpenNI cameras expect, and their frame.",
            on_change=self._use_openni,
        )
        self._thin_cloud = CloudDecimator(
            graph, "camera/depth/points", namespace=namespace, stride=2, voxel=0.05
        )

    @property
    def _whole_crop(self) -> int:
        return min(self._lens.width, self._lens.height)

    def _use_openni(self, value: ParameterValue) -> None:
        if value:
            crop = round(self._lens.focal * _CROP_OF_FOCAL / _OPENNI_F)
            self._depth_cloud.configure(min(crop, self._whole_crop), 512, 1.0)
        else:
            self._depth_cloud.configure(self._whole_crop, 256, 3.0)
        self._state.publish_fixed(openni=bool(value))

    def _report(self) -> None:
        self._battery_states.publish()
        self._said += 1
        self._chatter.publish({"data": f"hello world {self._said}"})

    def _step(self) -> None:
        now = self._node.clock.monotonic()
        seconds = min(now - self._stepped, _LONGEST_STEP)
        self._stepped = now
        self._drive.step(self._wanted(), seconds)
        self._battery.drain(self._drive.velocity, seconds)
        if self._battery.level == 0.0:
            # A demo must still drive after hours.
            self._battery.swap()
            self._node.log.warning("the battery was empty and has been swapped for a full one")
        self._arm_controller.step()
        self._state.publish()
        self._cameras.follow_subscribers()

    def _wanted(self) -> Velocity:
        by_hand = self._teleop.velocity or STANDSTILL
        planned = self._navigation.steer(overridden=not by_hand.is_zero)
        return planned if by_hand.is_zero else by_hand

    def _serve(self) -> None:
        self._node.advertise_service(
            "add_two_ints", _ADD_TWO_INTS[self._node.distro.conventions], _add_two_ints
        )
        self._node.advertise_service("reset", "std_srvs/Empty", self._reset)
        self._node.advertise_service("enable_motors", "std_srvs/SetBool", self._enable_motors)

    def _reset(self, request: object) -> messages.Message:
        self._navigation.abort("the robot was reset")
        self._arm_controller.end("the robot was reset")
        self._arm.reset()
        self._teleop.forget()
        self._drive.reset()
        self._battery.swap()
        self._node.log.info("reset: back at the start, battery full")
        return {}

    def _enable_motors(self, request: Message) -> messages.Message:
        self._drive.enabled = request.data
        if not request.data:
            self._drive.stop()
        return {"success": True, "message": f"motors {'enabled' if request.data else 'disabled'}"}

    def _declare_parameters(self) -> None:
        limits = self._drive.limits
        apply: tuple[Callable[[float], None], ...] = (
            partial(setattr, limits, "speed"),
            partial(setattr, limits, "turn_rate"),
            partial(setattr, limits, "acceleration"),
            partial(setattr, limits, "turn_acceleration"),
            partial(setattr, self._teleop, "timeout"),
            self._scans.set_rate,
            partial(setattr, self._lidar, "noise"),
            self._cameras.set_rate,
            partial(setattr, self._fibonacci, "rate"),
        )
        for (number, default), on_change in zip(TUNABLES.items(), apply, strict=True):
            number.declare(self._node, default, on_change)

    def _publish_map(self) -> None:
        grid = draw_map(self._world)
        stamp = self._node.clock.time_ns()
        self._node.advertise("map", "nav_msgs/OccupancyGrid", latch=True).publish(
            {
                "header": messages.header(stamp, frame(self._node, MAP)),
                "info": {
                    "map_load_time": messages.time(stamp),
                    "resolution": grid.resolution,
                    "width": grid.columns,
                    "height": grid.rows,
                    "origin": {
                        "position": messages.vector(grid.left, grid.bottom),
                        "orientation": quaternion_from_yaw(0.0),
                    },
                },
                "data": grid.cells,
            }
        )

    def _describe(self, description: str) -> None:
        node, graph = self._node, self._node.graph
        node.advertise("robot_description", "std_msgs/String", latch=True).publish({"data": description})
        if node.distro.parameters_belong_to_nodes:
            node.parameters.declare(
                "robot_description", description, description="The robot as URDF.", read_only=True
            )
        else:
            graph.run_on_graph(lambda: graph.parameters.set(node.resolve("robot_description"), description))


_LOW_BATTERY, _EMPTY_BATTERY = 0.2, 0.05


def publish_diagnostics(
    node: Node, drive: DifferentialDrive, battery: Battery, navigation: Navigation, period: float
) -> None:
    """Publish the state of motors, battery and navigation every `period` seconds."""

    def motors() -> DiagnosticStatus:
        level, text = DiagnosticLevel.OK, "driving" if not drive.velocity.is_zero else "standing"
        if drive.bumped:
            level, text = DiagnosticLevel.WARN, "something is in the way"
        if not drive.enabled:
            level, text = DiagnosticLevel.WARN, "disabled; call /enable_motors"
        speed, turn = f"{drive.velocity.linear:.2f} m/s", f"{drive.velocity.angular:.2f} rad/s"
        return DiagnosticStatus(level, text, {"speed": speed, "turn rate": turn})

    def power() -> DiagnosticStatus:
        level, text = DiagnosticLevel.OK, "charged"
        if battery.level < _LOW_BATTERY:
            level, text = DiagnosticLevel.WARN, "low"
        if battery.level < _EMPTY_BATTERY:
            level, text = DiagnosticLevel.ERROR, "nearly empty; it is swapped when it is"
        values = {"charge": f"{battery.level:.1%}", "voltage": f"{battery.voltage:.2f} V"}
        return DiagnosticStatus(level, text, values)

    def trips() -> DiagnosticStatus:
        return DiagnosticStatus(DiagnosticLevel.OK, "driving to a goal" if navigation.active else "no goal")

    updater = DiagnosticUpdater(
        node, "demo_robot", hardware_id="demo_robot", period=period, topic="diagnostics"
    )
    for name, task in (("motors", motors), ("battery", power), ("navigation", trips)):
        updater.add(name, task)


def _add_two_ints(request: Message) -> messages.Message:
    total = request.a + request.b
    if not -(2**63) <= total < 2**63:
        raise ServiceFailed(f"{request.a} + {request.b} does not fit an int64")
    return {"sum": total}


#: Number of Fibonacci numbers, from 0 on, that fit the message's int32.
_MAX_NUMBERS = 47

_ADD_TWO_INTS = {"jazzy": "example_interfaces/AddTwoInts", "noetic": "rospy_tutorials/AddTwoInts"}
#: Action type, and number of results beyond the order in the tutorial, on which programs rely.
_FIBONACCI = {"jazzy": ("example_interfaces/Fibonacci", 1), "noetic": ("actionlib_tutorials/Fibonacci", 2)}


class Fibonacci:
    """Action `/fibonacci` of ROS's tutorials, slow enough to cancel.

    Attributes:
        rate: numbers per second.
    """

    rate = 2.0

    def __init__(self, node: Node) -> None:
        self._node = node
        name, self._surplus = _FIBONACCI[node.distro.conventions]
        node.advertise_action("fibonacci", name, self._execute, accept=self._accept)

    def _accept(self, request: Message) -> bool | str:
        highest = _MAX_NUMBERS - self._surplus
        if 0 <= request.order <= highest:
            return True
        return f"order must be 0 to {highest}, where int32 ends, got {request.order}"

    async def _execute(self, goal: ReceivedGoal) -> messages.Message:
        count = goal.request.order + self._surplus
        sequence = [0, 1][:count]
        while len(sequence) < count:
            await self._node.clock.sleep(1 / self.rate)
            if goal.cancel_requested:
                raise GoalCanceled({"sequence": sequence})
            sequence = [*sequence, sequence[-1] + sequence[-2]]
            goal.publish_feedback({"sequence": sequence})
        return {"sequence": sequence}
