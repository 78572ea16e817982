#include "ground/link/udp_socket.h"

#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <stdexcept>

namespace ground {
namespace {

constexpr std::size_t kLargestDatagram = 65536;

sockaddr_in toSystem(const UdpAddress& address) {
  sockaddr_in result{};
  result.sin_family = AF_INET;
  result.sin_addr.s_addr = address.host;
  result.sin_port = htons(address.port);
  return result;
}

UdpAddress fromSystem(const sockaddr_in& address) {
  return {address.sin_addr.s_addr, ntohs(address.sin_port)};
}

}  // namespace

UdpSocket::UdpSocket(const UdpAddress& local) : file_(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
  const sockaddr_in address = toSystem(local);
  if (file_ < 0 || bind(file_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
    const std::string reason = std::strerror(errno);
    if (file_ >= 0) close(file_);
    throw std::runtime_error("cannot bind UDP port " + std::to_string(local.port) + ": " + reason);
  }
}

UdpSocket::~UdpSocket() { close(file_); }

bool UdpSocket::send(const std::string& datagram, const UdpAddress& to) {
  const sockaddr_in address = toSystem(to);
  return sendto(file_, datagram.data(), datagram.size(), MSG_DONTWAIT | MSG_NOSIGNAL,
                reinterpret_cast<const sockaddr*>(&address),
                sizeof address) == static_cast<ssize_t>(datagram.size());
}

bool UdpSocket::receive(double timeout, std::string& datagram, UdpAddress& from) {
  pollfd wait{file_, POLLIN, 0};
  timespec duration{};
  duration.tv_sec = static_cast<time_t>(std::max(0.0, timeout));
  duration.tv_nsec = static_cast<long>(1e9 * (std::max(0.0, timeout) - duration.tv_sec));
  if (ppoll(&wait, 1, &duration, nullptr) <= 0) return false;
  sockaddr_in address{};
  socklen_t length = sizeof address;
  datagram.resize(kLargestDatagram);
  const ssize_t size = recvfrom(file_, &datagram[0], datagram.size(), MSG_DONTWAIT,
                                reinterpret_cast<sockaddr*>(&address), &length);
  datagram.resize(size > 0 ? static_cast<std::size_t>(size) : 0);
  from = fromSystem(address);
  return size >= 0;
}

std::uint16_t UdpSocket::port() const {
  sockaddr_in address{};
  socklen_t length = sizeof address;
  getsockname(file_, reinterpret_cast<sockaddr*>(&address), &length);
  return ntohs(address.sin_port);
}

}  // namespace ground
