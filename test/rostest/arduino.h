// A small stand-in of what the sketch docs/howto/esp32_craft uses of Arduino for the ESP32, on this computer.
//
// PROGRAM GROUND_PORT OWN_PORT: the network is loopback. 127.0.0.1 is the ground station, which the sketch
// knows as 192.168.1.10; other addresses of loopback are themselves. It prints a line for every write to a
// pin: seconds since 1970, pin, duty. A line "block SECONDS" on its standard input makes the next datagram
// wait that long for the radio; it prints "block" and the time when it begins to. It ends with its standard
// input.
//
// As in the ESP32's WiFiUDP, no datagram is received while a part of the last one has not been read.
#pragma once

#include <arpa/inet.h>
#include <fcntl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <mutex>
#include <random>
#include <string>
#include <thread>

namespace stand_in {
uint16_t ground_port, own_port;
std::atomic<int64_t> block_us{0};
std::mutex output;
const auto began = std::chrono::steady_clock::now();

inline double wall() {
  return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}
inline void sleepFor(int64_t us) { std::this_thread::sleep_for(std::chrono::microseconds(us)); }
}  // namespace stand_in

// Clock and timer
typedef int esp_err_t;
#define ESP_ERROR_CHECK(call) \
  if (call) abort()
struct esp_timer_create_args_t {
  void (*callback)(void*);
  void* arg;
};
typedef esp_timer_create_args_t* esp_timer_handle_t;

inline int64_t esp_timer_get_time() {
  return std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::steady_clock::now() -
                                                               stand_in::began)
      .count();
}
inline esp_err_t esp_timer_create(const esp_timer_create_args_t* args, esp_timer_handle_t* handle) {
  *handle = new esp_timer_create_args_t(*args);
  return 0;
}
inline esp_err_t esp_timer_start_periodic(esp_timer_handle_t handle, uint64_t period) {
  std::thread([handle, period] {
    while (true) {
      stand_in::sleepFor(period);
      handle->callback(handle->arg);
    }
  }).detach();
  return 0;
}
inline uint32_t esp_random() { return std::random_device()(); }
inline uint32_t millis() { return static_cast<uint32_t>(esp_timer_get_time() / 1000); }
inline void delay(uint32_t ms) { stand_in::sleepFor(1000 * ms); }

// Critical sections
struct portMUX_TYPE {
  std::mutex mutex;
};
#define portMUX_INITIALIZER_UNLOCKED \
  {}
#define portENTER_CRITICAL(mux) (mux)->mutex.lock()
#define portEXIT_CRITICAL(mux) (mux)->mutex.unlock()

// Pins
inline void analogWrite(uint8_t pin, int duty) {
  const std::lock_guard<std::mutex> lock(stand_in::output);
  printf("%.6f %d %d\n", stand_in::wall(), pin, duty);
}

// Radio
enum { WL_CONNECTED = 3, WIFI_STA = 1 };
struct {
  void mode(int) {}
  void setSleep(bool) {}
  void begin(const char*, const char*) {}
  int status() { return WL_CONNECTED; }
} WiFi;

class IPAddress {
 public:
  IPAddress(uint8_t a, uint8_t b, uint8_t c, uint8_t d) : number_(a << 24 | b << 16 | c << 8 | d) {}
  explicit IPAddress(uint32_t number) : number_(number) {}
  bool operator==(const IPAddress& other) const { return number_ == other.number_; }

 private:
  uint32_t number_;
};

class WiFiUDP {
 public:
  uint8_t begin(uint16_t) {
    socket_ = socket(AF_INET, SOCK_DGRAM, 0);
    const sockaddr_in own = loopback(stand_in::own_port);
    if (bind(socket_, reinterpret_cast<const sockaddr*>(&own), sizeof own)) abort();
    return 1;
  }
  int parsePacket() {
    if (!rest_.empty()) return 0;
    char data[1460];
    sockaddr_in from = {};
    socklen_t length = sizeof from;
    const ssize_t size =
        recvfrom(socket_, data, sizeof data, MSG_DONTWAIT, reinterpret_cast<sockaddr*>(&from), &length);
    if (size < 0) {
      stand_in::sleepFor(50);  // so that this computer is not busy
      return 0;
    }
    remote_ = ntohl(from.sin_addr.s_addr);
    rest_.assign(data, size);
    return static_cast<int>(size);
  }
  int available() { return static_cast<int>(rest_.size()); }
  int read() {
    uint8_t byte = 0;
    return read(&byte, 1) == 1 ? byte : -1;
  }
  int read(uint8_t* data, size_t most) {
    const size_t size = std::min(most, rest_.size());
    memcpy(data, rest_.data(), size);
    rest_.erase(0, size);
    return static_cast<int>(size);
  }
  IPAddress remoteIP() {
    return remote_ == INADDR_LOOPBACK ? IPAddress(192, 168, 1, 10) : IPAddress(remote_);
  }
  int beginPacket(const IPAddress& to, uint16_t) {
    if (!(to == IPAddress(192, 168, 1, 10))) abort();
    datagram_.clear();
    return 1;
  }
  size_t write(const uint8_t* data, size_t size) {
    datagram_.append(reinterpret_cast<const char*>(data), size);
    return size;
  }
  int endPacket() {
    if (const int64_t block = stand_in::block_us.exchange(0)) {
      {
        const std::lock_guard<std::mutex> lock(stand_in::output);
        printf("block %.6f\n", stand_in::wall());
      }
      stand_in::sleepFor(block);
    }
    const sockaddr_in ground = loopback(stand_in::ground_port);
    sendto(socket_, datagram_.data(), datagram_.size(), 0, reinterpret_cast<const sockaddr*>(&ground),
           sizeof ground);
    return 1;
  }

 private:
  static sockaddr_in loopback(uint16_t port) {
    sockaddr_in address = {};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address.sin_port = htons(port);
    return address;
  }

  int socket_ = -1;
  uint32_t remote_ = 0;
  std::string rest_, datagram_;
};

void setup();
void loop();

int main(int, char** arguments) {
  setvbuf(stdout, nullptr, _IOLBF, 0);
  stand_in::ground_port = static_cast<uint16_t>(atoi(arguments[1]));
  stand_in::own_port = static_cast<uint16_t>(atoi(arguments[2]));
  std::thread([] {
    double seconds;
    while (scanf(" block %lf", &seconds) == 1) stand_in::block_us = static_cast<int64_t>(1e6 * seconds);
    fflush(stdout);
    _exit(0);
  }).detach();
  setup();
  while (true) loop();
}
