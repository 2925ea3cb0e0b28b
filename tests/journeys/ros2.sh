# docs/how-to/ros2.md, docs/how-to/replace-rosbridge.md: a robot with ROS 2 (its wheels, `make build/ros2`), seen by clients.
needs "$ROOT/build/ros2/bin/python"
export AMENT_PREFIX_PATH="$ROOT/build/ros2" LD_LIBRARY_PATH="$ROOT/build/ros2/lib" RMW_IMPLEMENTATION=rmw_fastrtps_cpp
export ROS_DOMAIN_ID=$((50 + RANDOM % 10)) ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST
PACKAGES="$ROOT/src:$("$PYTHON" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')"
block docs/how-to/rclpy.md 'class Talker' > talker.py
"$ROOT/build/ros2/bin/python" talker.py > talker.log 2>&1 & echo $! > talker.pid
server env PYTHONPATH="$PACKAGES" "$ROOT/build/ros2/bin/python" -m rwt.cli ros2 serve --ros-args -p port:=9090
rwt doctor
until rwt topic list | grep -x /chatter; do kill -0 "$(cat talker.pid)"; sleep 0.2; done
rwt topic echo /chatter --once --timeout 30
rwt param get /talker greeting
rwt topic pub --once -w 0 /cmd_vel geometry_msgs/msg/Twist '{linear: {x: 0.1}}'
rwt node list
fails rwt topic echo /chater --once --timeout 3
