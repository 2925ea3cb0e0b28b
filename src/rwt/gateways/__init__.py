"""Gateways: one wire protocol each, on one base."""
