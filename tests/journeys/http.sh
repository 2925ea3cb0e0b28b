# docs/how-to/http.md: requests, and what is said of mistakes.
server rwt serve ws://127.0.0.1:9090 --demo
curl -fsS http://127.0.0.1:9090/api
curl -fsS http://127.0.0.1:9090/api/topics/battery_state
curl -fsS -d '{"a": 1, "b": 2}' -H 'Content-Type: application/json' http://127.0.0.1:9090/api/services/add_two_ints
curl -sS -d '{"a": 1,' -H 'Content-Type: application/json' http://127.0.0.1:9090/api/services/add_two_ints | grep 'not valid JSON'
curl -sS http://127.0.0.1:9090/api/topcs | grep '/api/topics'
curl -sS -X PUT http://127.0.0.1:9090/api/topics | grep method-not-allowed
curl -fsS -d '{"order": 3}' -H 'Content-Type: application/json' http://127.0.0.1:9090/api/actions/fibonacci/goals
curl -fsS http://127.0.0.1:9090/api/actions/fibonacci/goals
