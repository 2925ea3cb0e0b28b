# README.md, docs/how-to/embed.md: a robot in a program of a few lines, used from a shell, and ended by a signal.
block README.md advertise_service > robot.py
server python robot.py
rwt service call /beep '{}'
rwt topic echo /battery_voltage --once
rwt topic pub --once /cmd_vel geometry_msgs/Twist '{linear: {x: 0.25}}'
logged 0.25
fails rwt service call /beep '{loud: true}'
rwt node info /robot
kill "$(cat rwt.pid)"
ended
block docs/how-to/embed.md Watchdog > motors.py
server python motors.py
rwt topic echo /motors --once
rwt topic pub --once /cmd_vel geometry_msgs/Twist '{linear: {x: 0.5}}'
rwt topic echo /motors --filter 'm.data == 0.0' --once
kill "$(cat rwt.pid)"
ended
