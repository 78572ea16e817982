"""What the rospy nodes are made of."""
