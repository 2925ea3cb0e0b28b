# docs/how-to/gate.md: check the rules, serve with them, stop the robot, and read the audit.
cat > gate.toml <<'TOML'
listen = ["ws://127.0.0.1:9090"]
demo = true

[gate.rules.drive]
topics = ["/cmd_vel"]
emergency = true
stop = {}
fields."linear.x" = { max = 0.2, beyond = "clamp" }

[gate.audit]
file = "audit.jsonl"
TOML
rwt gate explain gate.toml
rwt gate check gate.toml publish /cmd_vel '{linear: {x: 1.0}}'
server rwt serve --config gate.toml
rwt topic pub --once /cmd_vel geometry_msgs/msg/Twist '{linear: {x: 1.0}}'
rwt stop
fails rwt topic pub --once /cmd_vel geometry_msgs/msg/Twist '{linear: {x: 0.1}}'
logged 'the emergency stop is on'
rwt stop --release
rwt audit verify audit.jsonl
