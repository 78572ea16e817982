#pragma once

#include <cstdint>
#include <string>

#include "ground/safety/udp_address.h"

namespace ground {

/// A bound IPv4 datagram socket.
class UdpSocket {
 public:
  /// Throws std::runtime_error with the reason if the address cannot be bound.
  explicit UdpSocket(const UdpAddress& local);
  ~UdpSocket();
  UdpSocket(const UdpSocket&) = delete;
  UdpSocket& operator=(const UdpSocket&) = delete;

  /// Returns false and sets errno if the system does not accept the datagram.
  bool send(const std::string& datagram, const UdpAddress& to);
  /// Waits up to timeout [s]; returns false if no datagram arrives.
  bool receive(double timeout, std::string& datagram, UdpAddress& from);
  /// The bound port.
  std::uint16_t port() const;

 private:
  int file_;
};

}  // namespace ground
