"""What a client's act has to pass before it reaches the robot: leases, limits, a person's yes, the stop."""
