# docs/how-to/ros1.md: join a ROS 1 robot (here the demo robot with a master) without ROS, look at it and drive it.
master=$(python -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])')
export ROS_IP=127.0.0.1
rwt serve tcp://127.0.0.1:0 --demo --graph "ros1-master://127.0.0.1:$master" >robot.log 2>&1 & echo $! > robot.pid
trap 'kill "$(cat rwt.pid)" "$(cat robot.pid)" || true; wait' EXIT
logged "listening on" robot.log
server rwt serve ws://127.0.0.1:9090 --graph "ros1://127.0.0.1:$master"
rwt doctor "ros1://127.0.0.1:$master"
rwt topic echo /odom --once --timeout 30
rwt topic pub --once /cmd_vel geometry_msgs/Twist '{linear: {x: 0.1}}'
rwt service call /add_two_ints '{a: 1, b: 2}'
