"""Robots that run ROS 2: a bridge to their topics, the codec of messages, and drivers of servers."""
