"""Ceiling lights: their detection in scan lines, and the count along a corridor."""
