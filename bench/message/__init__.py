"""What one message costs within a process: checked, completed, recorded, and how long it holds others up."""
