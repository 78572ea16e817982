// The craft's side of the link, for an ESP32 with the Arduino core (2.x or 3.x): it receives Motors, sends
// DroneState, and switches its motors off when no Motors arrive. Set the five constants below for your craft.
#include <WiFi.h>
#include <WiFiUdp.h>
#include <esp_timer.h>

const char* const kNetwork = "network";
const char* const kPassword = "password";
const IPAddress kGround(192, 168, 1, 10);  // the ground station
const uint16_t kPort = 3333;
const uint8_t kPins[4] = {4, 5, 6, 7};  // gates of lift left, lift right, right thruster, left thruster

const int64_t kWatchdog = 250000, kTelemetryPeriod = 20000, kTick = 2000;  // [us]

const uint16_t kOff[4] = {1000, 1000, 1000, 1000};

struct Command {
  uint16_t motors[4];  // 1000 (off) to 2000 (full), in the order of kPins
  int64_t since;       // it arrived after this time [us]
};

portMUX_TYPE lock = portMUX_INITIALIZER_UNLOCKED;  // guards newest
Command newest = {{1000, 1000, 1000, 1000}, 0};
WiFiUDP udp;
uint32_t received = 0;

// Only this function moves the motors. A timer calls it, so it does not depend on loop(), which may wait for
// the radio.
void drive(void*) {
  static uint16_t present[4] = {1000, 1000, 1000, 1000};
  portENTER_CRITICAL(&lock);
  const Command command = newest;
  portEXIT_CRITICAL(&lock);
  const bool stale = esp_timer_get_time() - command.since > kWatchdog;
  for (int i = 0; i < 4; ++i) {
    const uint16_t wanted = stale ? 1000 : command.motors[i];
    if (wanted != present[i]) analogWrite(kPins[i], (wanted - 1000) * 255 / 1000);
    present[i] = wanted;
  }
}

// Reads a Motors message. False, with motors untouched, on anything else.
bool readMotors(const uint8_t* data, int size, uint16_t motors[4]) {
  if (size != 12) return false;
  uint16_t read[4];
  for (int i = 0; i < 4; ++i, data += 3) {
    if (data[0] != 8 * (i + 1) || !(data[1] & 0x80) || (data[2] & 0x80)) return false;
    read[i] = (data[1] & 0x7f) | data[2] << 7;
    if (read[i] < 1000 || read[i] > 2000) return false;
  }
  memcpy(motors, read, sizeof read);
  return true;
}

// Takes all commands that wait. They may have waited since nothing was found waiting, while the radio was busy.
// After a start the first command has to be zero: a craft that restarts in a drive does not drive on.
void receive() {
  static int64_t nothing_waited = 0;
  static bool ready = false;
  while (true) {
    const int64_t now = esp_timer_get_time();
    if (udp.parsePacket() <= 0) {
      nothing_waited = now;
      return;
    }
    uint8_t data[16];
    Command command;
    const int size = udp.read(data, sizeof data);
    while (udp.available() > 0) udp.read();  // the rest of a long one, without which no other is received
    if (!(udp.remoteIP() == kGround) || !readMotors(data, size, command.motors)) continue;
    ++received;
    ready = ready || memcmp(command.motors, kOff, sizeof kOff) == 0;
    if (!ready) continue;
    command.since = nothing_waited;
    portENTER_CRITICAL(&lock);
    newest = command;
    portEXIT_CRITICAL(&lock);
  }
}

// Writes a field whose type is uint32; gives the end of what is written.
uint8_t* writeField(uint8_t* to, uint32_t number, uint32_t value) {
  *to++ = number << 3;  // numbers up to 15
  for (; value > 0x7f; value >>= 7) *to++ = (value & 0x7f) | 0x80;
  *to++ = value;
  return to;
}

// Sends DroneState, which is also the hello; add roll, pitch, gyro and battery as your sensors give them.
void sendState() {
  uint8_t data[128];
  static const uint32_t boot = esp_random();
  uint8_t* end = writeField(data, 13, received);  // motors_received
  end = writeField(end, 15, boot);                // boot_id: a new one after a restart
  udp.beginPacket(kGround, kPort);
  udp.write(data, end - data);
  udp.endPacket();
}

void setup() {
  for (const uint8_t pin : kPins) analogWrite(pin, 0);
  esp_timer_create_args_t timer = {};
  timer.callback = drive;
  esp_timer_handle_t handle;
  ESP_ERROR_CHECK(esp_timer_create(&timer, &handle));  // restarts the craft if it fails
  ESP_ERROR_CHECK(esp_timer_start_periodic(handle, kTick));
  WiFi.mode(WIFI_STA);
  WiFi.setSleep(false);  // a radio that sleeps delays commands by 0.1 s
  WiFi.begin(kNetwork, kPassword);
  while (WiFi.status() != WL_CONNECTED) delay(10);
  udp.begin(kPort);
}

void loop() {
  static int64_t sent = 0;
  receive();
  if (esp_timer_get_time() - sent < kTelemetryPeriod) return;
  sent = esp_timer_get_time();
  sendState();
}
