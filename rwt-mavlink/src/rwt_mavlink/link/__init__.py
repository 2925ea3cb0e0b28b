"""Links to vehicles: addresses, sockets and serial ports, and frames of MAVLink."""
