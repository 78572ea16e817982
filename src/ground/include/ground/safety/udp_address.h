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

}  // namespace ground
