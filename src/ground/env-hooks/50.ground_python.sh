# ROS 1 tools start with "env python3" and need the system's Python.
case "$PATH" in
  /usr/bin:*) ;;
  *) export PATH="/usr/bin:$PATH" ;;
esac
