"""What a program reaches on a robot: topics, services, actions, parameters, transforms and types."""
