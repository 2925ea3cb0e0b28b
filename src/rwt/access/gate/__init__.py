"""Gate between clients and the robot: leases, limits, human approval and the emergency stop."""
