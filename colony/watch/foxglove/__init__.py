"""Runs for Foxglove: the messages of each frame, in an MCAP file or over a WebSocket."""
