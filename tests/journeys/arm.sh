# docs/how-to/lerobot.md: a simulated arm in the browser in five minutes.
needs rwt_lerobot mujoco
server rwt lerobot mujoco ws://127.0.0.1:9090
curl -fsS http://127.0.0.1:9090/ | grep '<title>'
rwt topic echo --once /joint_states
rwt action send_goal /arm_controller/follow_joint_trajectory control_msgs/action/FollowJointTrajectory \
  '{trajectory: {joint_names: [shoulder_pan], points: [{positions: [0.8], time_from_start: {sec: 1}}]}}'
fails rwt action send_goal /arm_controller/follow_joint_trajectory control_msgs/action/FollowJointTrajectory \
  '{trajectory: {joint_names: [shoulder_pan], points: [{positions: [99.0], time_from_start: {sec: 1}}]}}'
rwt service call /simulation/reset '{}'
