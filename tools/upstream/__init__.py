"""Runs the test suites and programs that others publish for rosbridge against `rwt serve`."""
