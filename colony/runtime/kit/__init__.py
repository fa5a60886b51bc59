"""The kit for programs that work with a robot: connections to servers, scripts, and custom servers."""
