class Twist:
    NAME = "geometry_msgs/msg/Twist"


class TwistStamped:
    NAME = "geometry_msgs/msg/TwistStamped"
