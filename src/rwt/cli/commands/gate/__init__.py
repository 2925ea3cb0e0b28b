"""What people do at a robot's gate: `rwt stop`, `rwt approve`, `rwt audit`."""
