# docs/how-to/command-line.md: look at a robot and command it.
server rwt serve ws://127.0.0.1:9090 --demo
rwt doctor
rwt topic list -t
rwt topic echo /odom --field pose.pose.position --once
fails rwt topic echo /odom --filter 'm.pose.pose.position.z > 1000' --once --timeout 1
rwt service call /add_two_ints example_interfaces/srv/AddTwoInts '{a: 1, b: 2}'
fails rwt service call /add_two_ints std_srvs/srv/Trigger '{}'
rwt action send_goal /fibonacci '{order: 3}'
rwt topic pub --once /cmd_vel geometry_msgs/msg/Twist '{linear: {x: 0.1}}'
