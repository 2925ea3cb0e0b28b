"""A Husky base with an xArm 6 and a depth camera, simulated by PyBullet from the models of its wheel.

`description` says what the robot is made of, `simulation` moves it, `camera` draws what it sees, and the rest
tells the graph of it. `examples/pybullet_robot.py` puts it on a server.
"""
