"""Names in the bags that launch/record.launch records, and how those are written."""

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
CHUNK = 8 * 1024  # written at once, as launch/record.launch does: what a cut takes with it [bytes]
