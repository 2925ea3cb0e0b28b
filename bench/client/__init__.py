"""Speed of the Python client, compared with roslibpy."""
