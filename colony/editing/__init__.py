"""What editors ask about behavior files."""
