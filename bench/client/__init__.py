"""How fast the Python client is beside roslibpy."""
