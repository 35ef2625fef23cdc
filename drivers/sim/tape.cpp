// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/tape.hpp"

#include <fcntl.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

namespace holdfast::sim {

std::optional<Tape> Tape::anonymous(Full full) {
  void* const memory = ::mmap(nullptr, sizeof(Memory), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  if (memory == MAP_FAILED) return std::nullopt;
  return Tape(static_cast<Memory*>(memory), full);  // all bytes 0: nothing written, all lines LOW
}

std::optional<Tape> Tape::file(const std::filesystem::path& path, Full full, bool create, std::string& error) {
  const auto fail = [&](const char* what) {
    error = std::string(what) + " " + path.string() + ": " + std::strerror(errno);
    return std::nullopt;
  };
  const int fd = ::open(path.c_str(), O_RDWR | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK | (create ? O_CREAT : 0), 0600);
  if (fd < 0) return fail("cannot open");
  struct stat there {};
  if (::fstat(fd, &there) != 0 || !S_ISREG(there.st_mode) ||
      (there.st_size != sizeof(Memory) && !(create && there.st_size == 0))) {
    ::close(fd);
    error = path.string() + ": is another file than a tape, and stays as it is";
    return std::nullopt;
  }
  // Its blocks, too: a store into a page that finds no room on a full disk would be a SIGBUS.
  errno = ::posix_fallocate(fd, 0, sizeof(Memory));
  if (errno != 0) {
    ::close(fd);
    return fail("cannot size");
  }
  void* const memory = ::mmap(nullptr, sizeof(Memory), PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
  ::close(fd);
  if (memory == MAP_FAILED) return fail("cannot map");
  return Tape(static_cast<Memory*>(memory), full);
}

Tape::Tape(Tape&& other) noexcept
    : memory_(std::exchange(other.memory_, nullptr)), full_(other.full_), lost_(other.lost_) {}

Tape::~Tape() {
  if (memory_ != nullptr) ::munmap(memory_, sizeof(Memory));
}

void Tape::write(const TapeEvent& event) {
  const std::uint64_t at = memory_->written.load(std::memory_order_relaxed);
  while (full_ == Full::kWait && at - memory_->read.load(std::memory_order_acquire) >= kEvents) ::sched_yield();
  memory_->events[static_cast<std::size_t>(at % kEvents)] = event;
  if (event.kind == TapeKind::kLine) {
    memory_->levels[event.which].store(event.value, std::memory_order_release);
  }
  memory_->written.store(at + 1, std::memory_order_release);
}

std::optional<TapeEvent> Tape::read() {
  const std::uint64_t written = memory_->written.load(std::memory_order_acquire);
  std::uint64_t at = memory_->read.load(std::memory_order_relaxed);
  if (full_ == Full::kDrop && written - at > kEvents / 2) {  // the older half may be being overwritten
    lost_ += written - at - kEvents / 2;
    at = written - kEvents / 2;
  }
  if (at == written) return std::nullopt;
  const TapeEvent event = memory_->events[static_cast<std::size_t>(at % kEvents)];
  memory_->read.store(at + 1, std::memory_order_release);
  return event;
}

}  // namespace holdfast::sim
