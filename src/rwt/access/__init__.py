"""Access control: admission, credentials, roles, quotas, origins, gate and audit log."""
