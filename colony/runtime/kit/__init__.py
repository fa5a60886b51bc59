"""The kit for programs beside a robot: connections to servers, scripts, and servers of one's own."""
