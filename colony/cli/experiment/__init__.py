"""Displays of many runs."""
