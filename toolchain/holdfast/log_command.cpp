// SPDX-License-Identifier: Apache-2.0
// holdfast log: what is in an MCAP file, whether it is whole, and out of it again.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>

#include "drivers/sim/container.hpp"
#include "toolchain/holdfast/commands.hpp"
#include "toolchain/log/csv_log.hpp"
#include "toolchain/log/frame_reader.hpp"
#include "toolchain/support/atomic_file.hpp"
#include "toolchain/support/json_text.hpp"

namespace holdfast::tool {
namespace {

struct LogOptions {
  std::string file;
  std::string csv;
  std::string mjpg;
  bool json = false;
};

double seconds(std::uint64_t ns) {
  return static_cast<double>(ns) * 1e-9;
}

std::string unreadable(const std::string& path) {
  return fmt::format(
      "{}: cannot be read. Likely cause: no such file, an empty one, a folder, a pipe, or no right to read it. Next: "
      "give what --mcap wrote",
      path);
}

// A text of a file that may be anybody's: one line, and printable.
std::string shown(std::string_view text) {
  std::string out(text);
  for (char& c : out) {
    if (c < ' ' || c > '~') c = '?';
  }
  return out;
}

struct Row {
  std::string topic;
  std::string schema;
  log::McapFile::Told told;
};

// In the order of their numbers.
std::vector<Row> rows_of(const log::McapFile& file) {
  std::vector<Row> rows;
  for (const auto& [id, channel] : file.channels) {
    const auto schema = file.schemas.find(channel.schema);
    const auto told = file.told.find(id);
    rows.push_back({shown(channel.topic), schema == file.schemas.end() ? "" : shown(schema->second.name),
                    told == file.told.end() ? log::McapFile::Told{} : told->second});
  }
  return rows;
}

void print_json(const LogOptions& options, const log::McapFile& file, std::size_t bytes) {
  nlohmann::json out;
  out["file"] = options.file;
  out["profile"] = shown(file.profile);
  out["library"] = shown(file.library);
  out["bytes"] = bytes;
  out["chunks"] = file.chunks;
  out["messages"] = file.all.messages;
  out["first_ns"] = file.all.first_ns;
  out["last_ns"] = file.all.last_ns;
  out["channels"] = nlohmann::json::array();
  for (const Row& row : rows_of(file)) {
    out["channels"].push_back({{"topic", row.topic},
                               {"schema", row.schema},
                               {"messages", row.told.messages},
                               {"first_ns", row.told.first_ns},
                               {"last_ns", row.told.last_ns}});
  }
  out["wrong"] = nlohmann::json::array();
  for (const log::McapFault& fault : file.faults) out["wrong"].push_back({{"at", fault.at}, {"what", fault.what}});
  fmt::print("{}\n", text_of_json(out));
}

int info(const LogOptions& options) {
  const sim::MappedFile mapped(options.file);
  if (mapped.bytes().empty()) return fail(unreadable(options.file));
  const log::McapFile file = log::read_frames(mapped.bytes(), {});
  if (options.json) {
    print_json(options, file, mapped.bytes().size());
  } else if (file.faults.empty() || file.faults.front().at != 0) {
    fmt::print("file      {} bytes, {} chunks, profile {}, written by {}\n", mapped.bytes().size(), file.chunks,
               shown(file.profile), shown(file.library));
    fmt::print("messages  {}, from {:.6f} to {:.6f} s\n", file.all.messages, seconds(file.all.first_ns),
               seconds(file.all.last_ns));
    for (const Row& row : rows_of(file)) {
      fmt::print("channel   {} {}: {} messages, from {:.6f} to {:.6f} s\n", row.topic, row.schema, row.told.messages,
                 seconds(row.told.first_ns), seconds(row.told.last_ns));
    }
    for (const log::McapFault& fault : file.faults) fmt::print("wrong     byte {}: {}\n", fault.at, fault.what);
  }
  return file.faults.empty() ? 0 : fail(log::fault_line(options.file, file));
}

int write_out(const LogOptions& options) {
  if (options.csv.empty() && options.mjpg.empty()) {
    return fail(
        "log export: nothing to write. Likely cause: neither --csv nor --mjpg is given. Next: give one of them");
  }
  const sim::MappedFile mapped(options.file);
  if (mapped.bytes().empty()) return fail(unreadable(options.file));
  OutputFiles outputs({{"--csv", options.csv}, {"--mjpg", options.mjpg}}, {options.file}, "a log");
  if (!outputs.error().empty()) return fail(outputs.error());
  std::ostream* const csv = outputs.stream("--csv");
  std::ostream* const mjpg = outputs.stream("--mjpg");
  if (csv != nullptr) *csv << log::csv_header();
  long rows = 0, pictures = 0;
  double first_s = 0;
  log::FrameVisit visit;
  visit.slip = [&](const log::FrameRecord& state) {
    // The CSV counts from the first frame, also where the log has the wall clock.
    if (rows++ == 0) first_s = state.t_s();
    log::FrameRecord since_first = state;
    since_first.set_time(state.t_s() - first_s);
    if (csv != nullptr) *csv << log::csv_row(since_first);
  };
  visit.picture = [&](const log::CompressedImage& picture) {
    ++pictures;
    if (mjpg == nullptr) return;
    mjpg->write(reinterpret_cast<const char*>(picture.data.data()), static_cast<std::streamsize>(picture.data.size()));
  };
  const log::McapFile file = log::read_frames(mapped.bytes(), visit);
  if (!file.faults.empty()) return fail(log::fault_line(options.file, file));
  const auto missing = [&](std::string_view topic) {
    return fail(fmt::format(
        "{}: has no {}. Likely cause: {}. Next: look at it with holdfast log info", options.file, topic,
        topic == log::kSlipTopic ? "written by another program" : "its frames did not come as JPEG pictures"));
  };
  if (csv != nullptr && rows == 0) return missing(log::kSlipTopic);
  if (mjpg != nullptr && pictures == 0) return missing(log::kCameraTopic);
  if (const std::string error = outputs.commit(); !error.empty()) return fail(error);
  if (csv != nullptr) fmt::print("written   csv: {}, {} rows\n", options.csv, rows);
  if (mjpg != nullptr) fmt::print("written   mjpg: {}, {} pictures\n", options.mjpg, pictures);
  return 0;
}

}  // namespace

void add_log(CLI::App& app, std::vector<Command>& commands) {
  CLI::App* const group = app.add_subcommand("log", "look into logs that --mcap wrote");
  group->require_subcommand(1);
  group->footer("Example:\n  holdfast log info grasp.mcap");
  const auto options = std::make_shared<LogOptions>();
  CLI::App* const info_command =
      group->add_subcommand("info", "say what is in an MCAP file, and check every length and sum of it");
  info_command->add_option("FILE", options->file, "MCAP file")->required()->check(not_empty);
  info_command->add_flag("--json", options->json, "print it as JSON");
  info_command->footer("Example:\n  holdfast log info grasp.mcap");
  commands.push_back({info_command, [options] { return info(*options); }});
  CLI::App* const export_command = group->add_subcommand(
      "export", "write the table that --log writes, or the camera's pictures, out of an MCAP file");
  export_command->add_option("FILE", options->file, "MCAP file")->required()->check(not_empty);
  export_command->add_option("--csv", options->csv, "write one row per frame in numbers only: CSV")->check(not_empty);
  export_command->add_option("--mjpg", options->mjpg, "write the pictures, one behind the other: raw MJPEG")
      ->check(not_empty);
  export_command->footer("Example:\n  holdfast log export grasp.mcap --csv grasp.csv --mjpg grasp.mjpg");
  commands.push_back({export_command, [options] { return write_out(*options); }});
}

}  // namespace holdfast::tool
