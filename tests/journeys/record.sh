# docs/how-to/record-and-play.md: record a server from within, and play the file as a robot.
server rwt serve ws://127.0.0.1:9090 --demo --record 'run_%Y-%m-%d_%H%M%S.mcap' --record-split 1h --record-keep 24
rwt bag record -o remote.mcap --max-seconds 2
kill "$(cat rwt.pid)"
ended
rwt bag info run_*_0000.mcap
rwt bag info remote.mcap
cp remote.mcap old.mcap
fails rwt serve ws://127.0.0.1:9090 --record old.mcap
server rwt serve ws://127.0.0.1:9090 --record old.mcap --record-overwrite
kill "$(cat rwt.pid)"
ended
fails cmp old.mcap remote.mcap
server rwt bag play remote.mcap ws://127.0.0.1:9090 --loop
rwt topic echo /odom --once --timeout 30
