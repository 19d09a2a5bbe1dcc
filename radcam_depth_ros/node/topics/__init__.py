"""Topics of the node: subscriptions, publishers, and queries of the ROS graph."""
