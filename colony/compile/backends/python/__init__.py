"""The back end that generates a program as a Python class."""
