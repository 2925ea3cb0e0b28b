"""Delivery over lossy lines and from behind routers, with the age of what arrives."""
