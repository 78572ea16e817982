#pragma once

#include <cstdint>
#include <string>

namespace ground {

/// IPv4 address and port of one end of a link.
struct UdpAddress {
  std::uint32_t host = 0;  ///< network byte order; 0: unknown
  std::uint16_t port = 0;  ///< host byte order; 0: any

  /// Parses "host" or "host:port"; throws std::invalid_argument if there is no such host.
  static UdpAddress parse(const std::string& text, std::uint16_t default_port = 0);
  std::string text() const;
  bool known() const { return host != 0; }
  bool operator==(const UdpAddress& other) const { return host == other.host && port == other.port; }
  bool operator!=(const UdpAddress& other) const { return !(*this == other); }
};

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
