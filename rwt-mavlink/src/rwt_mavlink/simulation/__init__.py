"""Vehicle without hardware: it follows MAVLink's services, for tests and for trying clients."""
