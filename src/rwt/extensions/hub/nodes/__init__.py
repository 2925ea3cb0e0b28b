"""Several nodes of a hub: a directory of robots over Zenoh, and links that serve a robot at another node.

A robot dials in at any node, its *home node*. Clients connect to any node. A node whose client wants a robot
of another one asks the home node to serve it here: the home node dials in as the robot would, and passes
streams on. Samples cross both uplinks once.
"""
