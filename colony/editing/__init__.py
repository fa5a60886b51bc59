"""What editors ask about behavior files, and the one style of these."""
