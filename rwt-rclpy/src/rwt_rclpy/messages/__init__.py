"""Classes of messages, services and actions like rosidl's, generated from definitions."""
