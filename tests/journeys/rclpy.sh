# docs/how-to/rclpy.md: a node written for ROS 2, without ROS, seen by every client.
needs rwt_rclpy
block docs/how-to/rclpy.md 'class Talker' > talker.py
server rwt run --serve ws://127.0.0.1:9090 talker.py --ros-args -r chatter:=/talk -p greeting:=Hi
rwt topic echo /talk --once | tee said
grep 'Hi World' said
rwt param get /talker greeting
rwt node list
