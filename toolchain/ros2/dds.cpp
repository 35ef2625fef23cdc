// SPDX-License-Identifier: Apache-2.0
#include "toolchain/ros2/dds.hpp"

#include <array>
#include <iterator>
#include <memory>

#include "drivers/common/trouble.hpp"
#include "holdfast.h"

namespace holdfast::ros2 {
namespace {

constexpr std::int32_t kKept = 10;
constexpr dds_duration_t kPatience = DDS_MSECS(10);

using Qos = std::unique_ptr<dds_qos_t, decltype(&dds_delete_qos)>;

Qos qos() {
  Qos made(dds_create_qos(), &dds_delete_qos);
  const dds_data_representation_id_t xcdr1 = DDS_DATA_REPRESENTATION_XCDR1;
  dds_qset_reliability(made.get(), DDS_RELIABILITY_RELIABLE, kPatience);
  dds_qset_durability(made.get(), DDS_DURABILITY_VOLATILE);
  dds_qset_history(made.get(), DDS_HISTORY_KEEP_LAST, kKept);
  dds_qset_data_representation(made.get(), 1, &xcdr1);
  return made;
}

// A sample is only read while it is written: it points into what it was made of, which has to end with a zero.
char* text(const std::string& words) {
  return const_cast<char*>(words.c_str());
}

std_msgs_msg_dds__Header_ header(const log::Time& stamp, const std::string& frame_id) {
  return {{stamp.sec, stamp.nanosec}, text(frame_id)};
}

template <typename Sequence, typename Element>
Sequence sequence(const Element* elements, std::size_t count) {
  Sequence made{};
  made._maximum = made._length = static_cast<std::uint32_t>(count);
  made._buffer = const_cast<Element*>(elements);
  return made;
}

dds_sequence_octet octets(const std::vector<std::uint8_t>& all) {
  return sequence<dds_sequence_octet>(all.data(), all.size());
}

dds_sequence_double doubles(const std::vector<double>& all) {
  return sequence<dds_sequence_double>(all.data(), all.size());
}

}  // namespace

Dds::~Dds() {
  if (participant_ > 0) dds_delete(participant_);
}

dds_entity_t Dds::writer(const dds_topic_descriptor_t& type, const char* topic) const {
  const Qos wanted = qos();
  const dds_entity_t made = dds_create_topic(participant_, &type, topic, nullptr, nullptr);
  return made < 0 ? made : dds_create_writer(participant_, made, wanted.get(), nullptr);
}

std::string Dds::open(std::uint32_t domain, bool commands) {
  const auto refused = [](dds_entity_t code) {
    return trouble(std::string("no DDS: ") + dds_strretcode(-code),
                   "no network interface is up, or CYCLONEDDS_URI is wrong",
                   "look at what Cyclone DDS wrote above; CYCLONEDDS_URI chooses the interface");
  };
  participant_ = dds_create_participant(domain, nullptr, nullptr);
  if (participant_ < 0) return refused(participant_);
  slip_ = writer(holdfast_msgs_msg_dds__SlipState__desc, "rt/holdfast/slip");
  markers_ = writer(holdfast_msgs_msg_dds__MarkerField__desc, "rt/holdfast/markers");
  camera_ = writer(sensor_msgs_msg_dds__CompressedImage__desc, "rt/holdfast/camera/compressed");
  diagnostics_ = writer(diagnostic_msgs_msg_dds__DiagnosticArray__desc, "rt/diagnostics");
  if (commands) {
    answers_ = writer(holdfast_msgs_msg_dds__Answer__desc, "rt/holdfast/answer");
    const Qos wanted = qos();
    const dds_entity_t topic =
        dds_create_topic(participant_, &holdfast_msgs_msg_dds__Command__desc, "rt/holdfast/command", nullptr, nullptr);
    commands_ = topic < 0 ? topic : dds_create_reader(participant_, topic, wanted.get(), nullptr);
  }
  for (const dds_entity_t one : {slip_, markers_, camera_, diagnostics_, answers_, commands_}) {
    if (one < 0) return refused(one);
  }
  return {};
}

void Dds::put(dds_entity_t writer, const void* sample) {
  if (dds_write(writer, sample) != DDS_RETCODE_OK) ++refused_;
}

void Dds::write(const log::FrameRecord& record) {
  const std::string frame_id(record.header.frame_id), state(record.state_name), reason(record.reason_name),
      evidence(record.evidence_name), unit(record.evidence_unit);
  holdfast_msgs_msg_dds__SlipState_ sample{};
  sample.header = header(record.header.stamp, frame_id);
  sample.frame = record.frame;
  sample.state = static_cast<std::uint8_t>(record.state);
  sample.state_name = text(state);
  sample.reason = static_cast<std::uint8_t>(record.reason);
  sample.reason_name = text(reason);
  sample.slip = record.slip;
  sample.grip_ok = record.grip_ok;
  sample.alive = record.alive;
  sample.accepted = record.accepted;
  sample.features_valid = record.features_valid;
  sample.rates_valid = record.rates_valid;
  sample.markers = record.markers;
  sample.vx_mm_s = record.vx_mm_s;
  sample.vy_mm_s = record.vy_mm_s;
  sample.entropy_nat = record.entropy_nat;
  sample.entropy_rate_nat_s = record.entropy_rate_nat_s;
  sample.decided_us = record.decided_us;
  sample.contact = static_cast<std::uint8_t>(record.contact);
  sample.contact_known = record.contact_known;
  sample.evidence = static_cast<std::uint8_t>(record.evidence);
  sample.evidence_name = text(evidence);
  sample.evidence_value = record.evidence_value;
  sample.evidence_threshold = record.evidence_threshold;
  sample.evidence_unit = text(unit);
  sample.evidence_frames = record.evidence_frames;
  sample.imprint_um = record.imprint_um;
  sample.coarse_um = record.coarse_um;
  static_assert(std::size(decltype(sample.histogram){}) == kHistogramBins);
  std::copy(record.histogram.begin(), record.histogram.end(), std::begin(sample.histogram));
  sample.load_basis = static_cast<std::uint8_t>(record.load_basis);
  sample.load_within = record.load_within;
  sample.load_strained = record.load_strained;
  sample.shear_x_n = record.shear_x_n;
  sample.shear_y_n = record.shear_y_n;
  sample.normal_n = record.normal_n;
  sample.friction_use = record.friction_use;
  put(slip_, &sample);
}

void Dds::write(const log::MarkerField& field) {
  const std::string frame_id(field.header.frame_id);
  holdfast_msgs_msg_dds__MarkerField_ sample{};
  sample.header = header(field.header.stamp, frame_id);
  sample.frame = field.frame;
  sample.row = octets(field.row);
  sample.col = octets(field.col);
  sample.valid = octets(field.valid);
  sample.x_px = doubles(field.x_px);
  sample.y_px = doubles(field.y_px);
  sample.dx_px = doubles(field.dx_px);
  sample.dy_px = doubles(field.dy_px);
  put(markers_, &sample);
}

void Dds::write(const log::CompressedImage& picture) {
  const std::string frame_id(picture.header.frame_id), format(picture.format);
  sensor_msgs_msg_dds__CompressedImage_ sample{};
  sample.header = header(picture.header.stamp, frame_id);
  sample.format = text(format);
  sample.data = sequence<dds_sequence_octet>(picture.data.data(), picture.data.size());
  put(camera_, &sample);
}

void Dds::write(const log::Time& stamp, const Diagnosis& diagnosis) {
  std::vector<diagnostic_msgs_msg_dds__KeyValue_> values;
  for (const auto& [key, value] : diagnosis.values) values.push_back({text(key), text(value)});
  const std::string nowhere;
  diagnostic_msgs_msg_dds__DiagnosticStatus_ status{};
  status.level = static_cast<std::uint8_t>(diagnosis.level);
  status.name = text(diagnosis.name);
  status.message = text(diagnosis.message);
  status.hardware_id = text(diagnosis.hardware);
  status.values = sequence<decltype(status.values)>(values.data(), values.size());
  diagnostic_msgs_msg_dds__DiagnosticArray_ sample{};
  sample.header = header(stamp, nowhere);
  sample.status = sequence<decltype(sample.status)>(&status, 1);
  put(diagnostics_, &sample);
}

void Dds::write_answer(Command command, std::uint8_t result, const char* result_name) {
  const std::string name(result_name);
  const holdfast_msgs_msg_dds__Answer_ sample{command.command, command.argument, result, text(name)};
  put(answers_, &sample);
}

std::optional<Command> Dds::take_command() const {
  if (commands_ <= 0) return std::nullopt;
  holdfast_msgs_msg_dds__Command_ sample{};
  void* samples[1] = {&sample};
  dds_sample_info_t about{};
  if (dds_take(commands_, samples, &about, 1, 1) != 1 || !about.valid_data) return std::nullopt;
  return Command{sample.command, sample.argument};
}

}  // namespace holdfast::ros2
