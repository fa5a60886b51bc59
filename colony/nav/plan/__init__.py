"""Route planning: from a map to segments for the Navigator."""
