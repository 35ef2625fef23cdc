// SPDX-License-Identifier: Apache-2.0
#include "drivers/linux/camera_libcamera.hpp"

#include <fcntl.h>
#include <libcamera/libcamera.h>
#include <sys/mman.h>

#include <algorithm>
#include <array>
#include <condition_variable>
#include <cstring>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

namespace holdfast::drivers {

struct LibcameraCamera::State {
  struct Buffer {
    std::unique_ptr<libcamera::Request> request;
    libcamera::FrameBuffer* frame = nullptr;
    void* memory = MAP_FAILED;
    std::size_t length = 0;
  };

  explicit State(const V4l2Camera::Config& asked) : config(asked) {}

  bool fail(std::string_view what, std::string_view cause, std::string_view next) {
    problem = {};
    problem << "libcamera: " << what << ". Likely cause: " << cause << ". Next: " << next;
    close();
    return false;
  }

  // In libcamera's thread.
  void completed(libcamera::Request* request) {
    const std::lock_guard lock(mutex);
    if (done_count < done.size()) done[(done_first + done_count++) % done.size()] = request;
    arrived.notify_one();
  }
  void disconnected() {
    const std::lock_guard lock(mutex);
    gone = true;
    arrived.notify_one();
  }

  [[nodiscard]] std::shared_ptr<libcamera::Camera> find() const {
    for (const std::shared_ptr<libcamera::Camera>& one : manager.cameras()) {
      // The video node's name, cut at 31 characters: "GelSight Mini R0B 2BNN-4ZE7: Ge".
      const auto model = one->properties().get(libcamera::properties::Model);
      if (model && std::string_view(*model).starts_with(sensor.device.product.view())) return one;
    }
    return nullptr;
  }

  void close() {
    if (camera) {
      (void)camera->stop();
      camera->requestCompleted.disconnect(this);
      camera->disconnected.disconnect(this);
    }
    for (Buffer& buffer : buffers) {
      if (buffer.memory != MAP_FAILED) (void)::munmap(buffer.memory, buffer.length);
    }
    buffers.clear();
    allocator.reset();
    if (camera) (void)camera->release();
    camera.reset();
    lent = nullptr;
    const std::lock_guard lock(mutex);
    done_count = 0;
    gone = false;
  }

  V4l2Camera::Config config;
  V4l2Camera::Counts counts;
  FixedText<511> problem;
  FixedText<511> unset;
  UsbCensus census;
  SensorSearch sensor;
  libcamera::CameraManager manager;
  bool manager_runs = false;
  std::shared_ptr<libcamera::Camera> camera;
  std::unique_ptr<libcamera::FrameBufferAllocator> allocator;
  libcamera::Stream* stream = nullptr;
  std::vector<Buffer> buffers;
  libcamera::Request* lent = nullptr;

  std::mutex mutex;
  std::condition_variable arrived;
  std::array<libcamera::Request*, V4l2Camera::kMostBuffers> done{};  // a ring
  std::size_t done_first = 0;
  std::size_t done_count = 0;
  bool gone = false;
};

LibcameraCamera::LibcameraCamera(const V4l2Camera::Config& config) : state_(std::make_unique<State>(config)) {}

LibcameraCamera::~LibcameraCamera() {
  stop();
  state_->close();
  if (state_->manager_runs) state_->manager.stop();
}

std::string_view LibcameraCamera::do_problem() const {
  return state_->problem.view();
}
std::string_view LibcameraCamera::do_unset() const {
  return state_->unset.view();
}
bool LibcameraCamera::do_steady() const {
  return are_steady(state_->counts.controls_off);
}
const V4l2Camera::Counts& LibcameraCamera::counts() const {
  return state_->counts;
}
std::string_view LibcameraCamera::do_identity() const {
  return state_->sensor.serial.view();
}

bool LibcameraCamera::do_start() {
  State& s = *state_;
  s.close();
  s.problem = {};
  take_census(s.config.sysfs, s.census);
  s.sensor = find_sensor(s.census, s.config.serial);
  if (s.sensor.result != Search::kFound) {
    s.problem << s.sensor.message.view();
    return false;
  }
  if (!s.manager_runs && s.manager.start() != 0) {
    return s.fail("does not start", "no right to the devices, or udev does not run", "see its own messages above");
  }
  s.manager_runs = true;
  s.camera = s.find();
  if (!s.camera) {
    return s.fail("does not know the sensor", "it was plugged in a moment ago, or udev does not run",
                  "wait, or use the V4L2 backend");
  }
  if (s.camera->acquire() != 0) {
    s.camera.reset();
    return s.fail("cannot have the sensor", "another program has it", "end that program");
  }
  const auto asked = s.camera->generateConfiguration({libcamera::StreamRole::VideoRecording});
  if (!asked || asked->size() != 1) return s.fail("offers no stream", "a fault of the sensor", "plug it in again");
  const libcamera::Size size(static_cast<unsigned>(s.config.width), static_cast<unsigned>(s.config.height));
  libcamera::StreamConfiguration& stream = asked->at(0);
  stream.pixelFormat = libcamera::formats::MJPEG;
  stream.size = size;
  stream.bufferCount = static_cast<unsigned>(std::clamp<std::size_t>(s.config.buffers, 2, V4l2Camera::kMostBuffers));
  // Adjusted colour spaces are no matter: what counts is asked for below.
  if (asked->validate() == libcamera::CameraConfiguration::Invalid || stream.size != size ||
      stream.pixelFormat != libcamera::formats::MJPEG || s.camera->configure(asked.get()) != 0) {
    return s.fail("offers no MJPG of that size", "another camera, or another firmware of it", "use a GelSight Mini");
  }
  s.stream = stream.stream();
  s.allocator = std::make_unique<libcamera::FrameBufferAllocator>(s.camera);
  if (s.allocator->allocate(s.stream) < 2) {
    return s.fail("gives no buffers", "the kernel is short of memory", "free 64 MB, or set fewer buffers");
  }
  for (const std::unique_ptr<libcamera::FrameBuffer>& frame : s.allocator->buffers(s.stream)) {
    if (s.buffers.size() == V4l2Camera::kMostBuffers) break;
    const auto& plane = frame->planes()[0];
    State::Buffer buffer;
    buffer.frame = frame.get();
    buffer.length = plane.offset + plane.length;
    buffer.memory = ::mmap(nullptr, buffer.length, PROT_READ, MAP_SHARED, plane.fd.get(), 0);
    buffer.request = s.camera->createRequest(s.buffers.size());
    const bool good =
        buffer.memory != MAP_FAILED && buffer.request && buffer.request->addBuffer(s.stream, frame.get()) == 0;
    s.buffers.push_back(std::move(buffer));
    if (!good) return s.fail("a buffer cannot be used", "the process may not have so much memory", "raise its limit");
  }
  s.camera->requestCompleted.connect(&s, &State::completed);
  s.camera->disconnected.connect(&s, &State::disconnected);
  if (s.camera->start() != 0)
    return s.fail("the stream does not start", "too little USB bandwidth", "use another port");
  for (const State::Buffer& buffer : s.buffers) {
    if (s.camera->queueRequest(buffer.request.get()) != 0) {
      return s.fail("a buffer is refused", "it was unplugged meanwhile", "plug the sensor in again");
    }
  }
  // The stream's own file is libcamera's: controls take another one. Without it every control is refused.
  Kernel& kernel = Kernel::real();
  const int fd = kernel.open(s.sensor.node.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC);
  s.counts.controls_off = set_camera_controls(kernel, fd);
  s.unset = words_of(s.counts.controls_off);
  if (fd >= 0) (void)kernel.close(fd);
  ++s.counts.starts;
  return true;
}

hal::Capture LibcameraCamera::do_next(hal::Frame& frame, std::chrono::microseconds timeout) {
  using hal::Capture;
  State& s = *state_;
  if (!s.camera) return Capture::kGone;
  if (s.lent != nullptr) do_release(frame);
  libcamera::Request* request = nullptr;
  {
    std::unique_lock lock(s.mutex);
    const bool any =
        s.arrived.wait_for(lock, timeout * s.config.time_scale, [&] { return s.gone || s.done_count > 0; });
    if (!any) return Capture::kTimeout;
    if (!s.gone) {
      request = s.done[s.done_first];
      s.done_first = (s.done_first + 1) % s.done.size();
      --s.done_count;
    }
  }
  if (request == nullptr) {
    s.close();
    return Capture::kGone;
  }
  const State::Buffer& buffer = s.buffers[request->cookie()];
  const libcamera::FrameMetadata& metadata = buffer.frame->metadata();
  const std::size_t bytes = metadata.planes().empty() ? 0 : metadata.planes()[0].bytesused;
  const bool whole = request->status() == libcamera::Request::RequestComplete &&
                     metadata.status == libcamera::FrameMetadata::FrameSuccess;
  s.lent = request;
  if (!whole || bytes == 0 || bytes > buffer.length) {
    ++(whole ? s.counts.empty : s.counts.damaged);
    do_release(frame);
    return Capture::kBad;
  }
  const auto& plane = buffer.frame->planes()[0];
  frame = {};
  frame.bytes = {static_cast<const std::uint8_t*>(buffer.memory) + plane.offset, bytes};
  frame.format = hal::PixelFormat::kMjpeg;
  frame.width = s.config.width;
  frame.height = s.config.height;
  frame.timestamp =
      std::chrono::microseconds{static_cast<std::int64_t>(metadata.timestamp / 1000)} / s.config.time_scale;
  frame.sequence = metadata.sequence;
  frame.stamped = metadata.timestamp != 0;
  if (!frame.stamped) ++s.counts.unstamped;
  ++s.counts.frames;
  return Capture::kFrame;
}

void LibcameraCamera::do_release(const hal::Frame&) {
  State& s = *state_;
  if (s.lent == nullptr || !s.camera) return;
  s.lent->reuse(libcamera::Request::ReuseBuffers);
  (void)s.camera->queueRequest(s.lent);  // refused: it is gone, and disconnected() says so
  s.lent = nullptr;
}

void LibcameraCamera::do_stop() {
  state_->close();
}

}  // namespace holdfast::drivers
