"""`colony robot import`: a robot's interface and body from the running graph of ROS 2."""
