"""Metrics in the text format of Prometheus, and notifications of the service manager."""
