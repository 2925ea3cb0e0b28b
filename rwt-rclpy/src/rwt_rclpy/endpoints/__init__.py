"""What nodes talk through: publishers, subscriptions, services, clients, and their quality of service."""
