// SPDX-License-Identifier: Apache-2.0
// Those declarations of libcamera 0.4 that camera_libcamera.cpp uses, written anew from the library's documented
// interface, because Debian 12 has 0.0.3. What differs for the driver: generateConfiguration() takes a span or a list.
//
// What a build against it is worth: it shows that the driver is C++ that agrees with these declarations. That they
// agree with the library was seen once: with the headers of Debian 13 (libcamera-dev 0.4.0-7) the driver compiles as it
// is, and the 27 functions of the library that are not inline there have the same mangled names in both objects.
#pragma once

#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace libcamera {

template <typename T>
using Span = std::span<T>;

template <typename... Args>
class Signal {
 public:
  template <typename T, typename R>
  void connect(T* object, R (T::*function)(Args...));
  template <typename T>
  void disconnect(T* object);
};

template <typename T>
class Control {};

class ControlList {
 public:
  template <typename T>
  std::optional<T> get(const Control<T>& control) const;
};

namespace properties {
extern const Control<std::string> Model;
}

class Size {
 public:
  constexpr Size(unsigned w, unsigned h) : width(w), height(h) {}
  unsigned width;
  unsigned height;
};
bool operator==(const Size& a, const Size& b);

class PixelFormat {
 public:
  constexpr explicit PixelFormat(std::uint32_t fourcc, std::uint64_t modifier = 0)
      : fourcc_(fourcc), modifier_(modifier) {}
  bool operator==(const PixelFormat& other) const;

 private:
  std::uint32_t fourcc_;
  std::uint64_t modifier_;
};

namespace formats {
inline constexpr PixelFormat MJPEG{0x47504a4d};
}

class Camera;
class Fence;
class Stream;

class SharedFD {
 public:
  [[nodiscard]] int get() const;
};

struct FrameMetadata {
  enum Status { FrameSuccess, FrameError, FrameCancelled };
  struct Plane {
    unsigned bytesused;
  };
  Status status;
  unsigned sequence;
  std::uint64_t timestamp;
  [[nodiscard]] Span<const Plane> planes() const;
};

class FrameBuffer {
 public:
  struct Plane {
    SharedFD fd;
    unsigned offset;
    unsigned length;
  };
  FrameBuffer(const FrameBuffer&) = delete;
  FrameBuffer& operator=(const FrameBuffer&) = delete;
  virtual ~FrameBuffer();
  [[nodiscard]] const std::vector<Plane>& planes() const;
  [[nodiscard]] const FrameMetadata& metadata() const;
};

class Request {
 public:
  enum Status { RequestPending, RequestComplete, RequestCancelled };
  enum ReuseFlag { Default = 0, ReuseBuffers = 1 };
  explicit Request(Camera* camera, std::uint64_t cookie = 0);
  Request(const Request&) = delete;
  Request& operator=(const Request&) = delete;
  ~Request();
  void reuse(ReuseFlag flags = Default);
  int addBuffer(const Stream* stream, FrameBuffer* buffer, std::unique_ptr<Fence> fence = {});
  [[nodiscard]] std::uint64_t cookie() const;
  [[nodiscard]] Status status() const;
};

class Fence {};

enum class StreamRole { Raw, StillCapture, VideoRecording, Viewfinder };

struct StreamConfiguration {
  PixelFormat pixelFormat;
  Size size;
  unsigned bufferCount;
  [[nodiscard]] Stream* stream() const;
};

class CameraConfiguration {
 public:
  enum Status { Valid, Adjusted, Invalid };
  virtual ~CameraConfiguration();
  virtual Status validate() = 0;
  StreamConfiguration& at(unsigned index);
  [[nodiscard]] std::size_t size() const;
};

class Camera {
 public:
  Signal<Request*> requestCompleted;
  Signal<> disconnected;
  int acquire();
  int release();
  [[nodiscard]] const ControlList& properties() const;
  std::unique_ptr<CameraConfiguration> generateConfiguration(Span<const StreamRole> roles = {});
  std::unique_ptr<CameraConfiguration> generateConfiguration(std::initializer_list<StreamRole> roles);
  int configure(CameraConfiguration* configuration);
  std::unique_ptr<Request> createRequest(std::uint64_t cookie = 0);
  int queueRequest(Request* request);
  int start(const ControlList* controls = nullptr);
  int stop();
};

class CameraManager {
 public:
  CameraManager();
  ~CameraManager();
  int start();
  void stop();
  [[nodiscard]] std::vector<std::shared_ptr<Camera>> cameras() const;
};

class FrameBufferAllocator {
 public:
  explicit FrameBufferAllocator(std::shared_ptr<Camera> camera);
  FrameBufferAllocator(const FrameBufferAllocator&) = delete;
  FrameBufferAllocator& operator=(const FrameBufferAllocator&) = delete;
  ~FrameBufferAllocator();
  int allocate(Stream* stream);
  [[nodiscard]] const std::vector<std::unique_ptr<FrameBuffer>>& buffers(Stream* stream) const;
};

}  // namespace libcamera
