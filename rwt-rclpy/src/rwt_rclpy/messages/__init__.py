"""Classes of messages, services and actions, as rosidl generates them, from definitions."""
