"""What editors ask for: the one style of files."""
