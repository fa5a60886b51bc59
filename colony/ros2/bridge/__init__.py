"""The bridge to ROS 2: a process of the robot's ROS environment, which runs under its Python."""
