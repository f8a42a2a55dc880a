"""The nodes: each a class made with a bus, and written against nothing else of ROS."""
