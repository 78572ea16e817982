"""Topics of the bags that launch/record.launch records, and the size of their chunks."""

POSE = "/vrpn_client_node/hovercraft/pose"
SETTINGS = "/mocap_state/settings"
RUN_SETTINGS = "/run/settings"
CONTROLS = "/controls"
WANTED = "/controls/wanted"
DECISION = "/decision"
STATUS = "/controller/status"
DRIVE = "/drive"
BURSTS = "/bursts"
TRUTH = "/simulator/truth"
REFERENCE = "/reference"
REFERENCE_PATH = "/path/reference"
CONTROLLER = "/controller"  # name of its node
CHUNK = 8 * 1024  # as in launch/record.launch; a cut loses at most one chunk [bytes]
