"""Services of MAVLink with a vehicle: commands, parameters and missions."""
