"""Which classes stand for messages, services and actions: as rosidl makes them, from definitions."""
