"""Parts of the rospy nodes."""
