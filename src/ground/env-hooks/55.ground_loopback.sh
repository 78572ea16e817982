# Where this computer's name is not an address of its own (in a container, away from its network), nodes give the
# loopback address if the master is here and no address is set. check_launch refuses it for a real craft.
if [ -n "${GROUND_LOOPBACK:-}" ] && [ "${ROS_IP:-}" = "$GROUND_LOOPBACK" ]; then
  unset ROS_IP  # of an earlier call: the network may be another one now
fi
case "${ROS_IP:-}${ROS_HOSTNAME:-}${ROS_MASTER_URI:-http://localhost:11311}" in
  http://localhost[:/]* | http://127.* | "http://$(uname -n)"[:/]*)
    if ! timeout 2 /usr/bin/python3 -c 'import socket as s; s.socket().bind((s.gethostname(), 0))' 2>/dev/null; then
      export ROS_IP=127.0.0.1 GROUND_LOOPBACK=127.0.0.1
    fi
    ;;
esac
