"""Scripts of a mission: the Navigator's clerk, goal verification and elevator prompts."""
