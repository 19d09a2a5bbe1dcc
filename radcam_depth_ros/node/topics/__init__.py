"""Topics of the node: subscriptions, publishers, and what the ROS graph tells of them."""
