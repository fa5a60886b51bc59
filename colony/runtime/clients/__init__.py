"""Clients of a program: the nodes that step its modules and send requests to servers."""
