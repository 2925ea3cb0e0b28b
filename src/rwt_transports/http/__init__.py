"""HTTP on the same port as WebSocket: requests, responses, routes and connections."""
