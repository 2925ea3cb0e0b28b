"""The rosbridge gateway: translates ops to verbs of the robot graph, and its events to frames."""
