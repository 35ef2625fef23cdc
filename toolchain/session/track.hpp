// SPDX-License-Identifier: Apache-2.0
// What the scrubber of a session's page shows, frame by frame: rows, markers, pictures.
//
// Bounded whatever the length of the run: each of the three has a budget, and once it is spent every second frame of
// it goes, then every second of the rest. Frames in which state or decision change stay. The page says what is thinned.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "toolchain/session/overlay.hpp"
#include "vision/luma.hpp"

namespace holdfast::tool {

struct ReportInfo;

// What a frame shows beside its record; may be left out.
struct TrackPicture {
  LumaView luma;        // borrowed; no data: none
  double width_px = 0;  // of the input, which the arrows are measured in
  double height_px = 0;
};

// Pieces of frames, within a budget of bytes.
class Thinned {
 public:
  struct Piece {
    std::uint32_t index = 0;
    bool event = false;
    std::vector<std::uint8_t> bytes;
  };
  explicit Thinned(std::size_t budget) : budget_(budget) {}

  // Asked first where a piece is dear to make.
  [[nodiscard]] bool wants(std::uint32_t index, bool event) const { return event || index % stride_ == 0; }
  void keep(Piece piece);
  [[nodiscard]] const std::vector<Piece>& pieces() const { return pieces_; }
  // Of the frames between events every so many-th is left.
  [[nodiscard]] std::uint32_t stride() const { return stride_; }

 private:
  std::size_t budget_;
  std::size_t bytes_ = 0;
  std::uint32_t stride_ = 1;
  std::vector<Piece> pieces_;
};

class Track {
 public:
  // In order of time.
  void add(const log::FrameRecord& frame, std::span<const Arrow> arrows, const TrackPicture& picture);

  // For the page's script; safe inside a script element.
  [[nodiscard]] std::string json(const ReportInfo& info) const;

 private:
  void keep_row(const log::FrameRecord& frame, bool event);
  void keep_markers(std::span<const Arrow> arrows, bool event);
  void keep_picture(const LumaView& picture, bool event);

  // In base64 a third more: together 3.5 MB.
  Thinned rows_{744'000}, markers_{1'000'000}, pictures_{850'000};
  std::vector<float> decided_us_;
  std::vector<std::pair<std::string, std::string>> evidences_;  // name and unit, as rows count them from 1; 0: none
  std::uint32_t frames_ = 0;
  int last_state_ = -1;
  bool last_slip_ = false;
  double last_edge_s_ = -1e9;  // of ALIVE
  double width_px_ = 0, height_px_ = 0;
};

}  // namespace holdfast::tool
