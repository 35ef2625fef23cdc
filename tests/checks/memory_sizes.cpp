// SPDX-License-Identifier: Apache-2.0
// memory_sizes FILE: writes there what the firmware remembers, in bytes, for costs.sh. All of it is in these objects;
// there is no heap. Exit status 1 when FILE cannot be written.
#include <filesystem>
#include <fstream>
#include <system_error>

#include "app/app.hpp"
#include "app/daemon.hpp"
#include "app/fingers.hpp"
#include "drivers/common/jpeg_turbo.hpp"

int main(int argc, char** argv) {
  using namespace holdfast;
  using Turbo = drivers::TurboJpegDecoder;
  if (argc != 2) return 1;
  const std::filesystem::path path = argv[1];
  std::error_code ignored;  // the file tells
  std::filesystem::create_directories(path.parent_path(), ignored);
  std::ofstream file(path);
  file << "memory.app_bytes " << sizeof(App) << '\n'
       << "memory.daemon_with_app_bytes " << sizeof(Daemon) << '\n'
       << "memory.hand_bytes " << sizeof(fingers::State) << '\n'
       << "memory.jpeg_decoder_bytes " << sizeof(EighthDecoder) << '\n'
       << "memory.jpeg_worker_bytes " << sizeof(jpeg_fast::Worker) << '\n'
       << "memory.jpeg_library_bytes " << Turbo::kMemory.tables + Turbo::kMemory.picture << '\n'
       << "memory.checkpoint_bytes " << sizeof(checkpoint::Contents) << '\n';
  return file.flush() ? 0 : 1;
}
