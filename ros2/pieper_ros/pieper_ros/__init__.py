"""Entry points of pieper's nodes for ROS 2."""
