#include "ground/safety/udp_address.h"

#include <arpa/inet.h>
#include <netdb.h>
#include <sys/socket.h>

#include <algorithm>
#include <stdexcept>

namespace ground {

UdpAddress UdpAddress::parse(const std::string& text, std::uint16_t default_port) {
  UdpAddress address;
  address.port = default_port;
  const std::size_t colon = text.find(':');
  if (colon != std::string::npos) {
    const std::string digits = text.substr(colon + 1);
    const bool number =
        !digits.empty() && digits.size() <= 5 &&
        std::all_of(digits.begin(), digits.end(), [](char c) { return c >= '0' && c <= '9'; });
    const int port = number ? std::stoi(digits) : 0;
    if (port < 1 || port > 65535)
      throw std::invalid_argument("'" + text + "' is not HOST or HOST:PORT with a port of 1..65535");
    address.port = static_cast<std::uint16_t>(port);
  }
  addrinfo hints{}, *found = nullptr;
  hints.ai_family = AF_INET;
  hints.ai_socktype = SOCK_DGRAM;
  const int error = getaddrinfo(text.substr(0, colon).c_str(), nullptr, &hints, &found);
  if (error != 0)
    throw std::invalid_argument("no host '" + text.substr(0, colon) + "': " + gai_strerror(error));
  address.host = reinterpret_cast<const sockaddr_in*>(found->ai_addr)->sin_addr.s_addr;
  freeaddrinfo(found);
  return address;
}

std::string UdpAddress::text() const {
  if (!known()) return "";
  char buffer[INET_ADDRSTRLEN] = "";
  in_addr raw{};
  raw.s_addr = host;
  inet_ntop(AF_INET, &raw, buffer, sizeof buffer);
  return std::string(buffer) + ':' + std::to_string(port);
}

}  // namespace ground
