#pragma once

#include <pthread.h>

#include <cerrno>
#include <stdexcept>

namespace ground {

/// A recursive mutex that lends its holder the priority of the most urgent thread that waits for it.
/// With std::mutex, other work could keep an ordinary thread from the processor while it holds what
/// a real-time thread needs.
class InheritingMutex {
 public:
  InheritingMutex() {
    pthread_mutexattr_t kind;
    pthread_mutexattr_init(&kind);
    pthread_mutexattr_settype(&kind, PTHREAD_MUTEX_RECURSIVE);
    pthread_mutexattr_setprotocol(&kind, PTHREAD_PRIO_INHERIT);
    const int error = pthread_mutex_init(&mutex_, &kind);
    pthread_mutexattr_destroy(&kind);
    if (error != 0) throw std::runtime_error("the system has no mutex that inherits priorities");
  }
  ~InheritingMutex() { pthread_mutex_destroy(&mutex_); }
  InheritingMutex(const InheritingMutex&) = delete;
  InheritingMutex& operator=(const InheritingMutex&) = delete;

  void lock() {
    if (pthread_mutex_lock(&mutex_) != 0) throw std::runtime_error("a mutex cannot be locked");
  }
  void unlock() { pthread_mutex_unlock(&mutex_); }

 private:
  pthread_mutex_t mutex_;
};

}  // namespace ground
