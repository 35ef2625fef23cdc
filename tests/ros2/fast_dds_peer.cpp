// SPDX-License-Identifier: Apache-2.0
// fast_dds_peer DOMAIN: what another vendor's DDS makes of holdfast-ros2. Fast DDS and Fast CDR of eProsima, which ROS
// 2 uses by default, with types written here by hand and no line of ours; on loopback alone. A line of JSON for each
// sample on standard output; a line "COMMAND ARGUMENT" on standard input is published; ends with its input.
#include <fastcdr/Cdr.h>
#include <fastcdr/FastBuffer.h>

#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>
#include <array>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <functional>
#include <iostream>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

namespace {

namespace dds = eprosima::fastdds::dds;
namespace rtps = eprosima::fastrtps::rtps;
using eprosima::fastcdr::Cdr;
using eprosima::fastcdr::FastBuffer;
using Json = nlohmann::ordered_json;
using Bytes = std::vector<char>;

// A sample is its bytes, encapsulation and all; who prints it takes them apart.
class Raw : public dds::TopicDataType {
 public:
  explicit Raw(const char* name) {
    setName(name);
    m_typeSize = 8'000'000;
    m_isGetKeyDefined = false;
    auto_fill_type_object(false);
    auto_fill_type_information(false);
  }
  bool serialize(void* data, rtps::SerializedPayload_t* payload) override {
    const auto& bytes = *static_cast<Bytes*>(data);
    std::memcpy(payload->data, bytes.data(), bytes.size());
    payload->length = static_cast<std::uint32_t>(bytes.size());
    payload->encapsulation = CDR_LE;
    return true;
  }
  bool deserialize(rtps::SerializedPayload_t* payload, void* data) override {
    const char* const begin = reinterpret_cast<const char*>(payload->data);
    static_cast<Bytes*>(data)->assign(begin, begin + payload->length);
    return true;
  }
  std::function<std::uint32_t()> getSerializedSizeProvider(void* data) override {
    return [data] { return static_cast<std::uint32_t>(static_cast<Bytes*>(data)->size()); };
  }
  void* createData() override { return new Bytes; }
  void deleteData(void* data) override { delete static_cast<Bytes*>(data); }
  bool getKey(void*, rtps::InstanceHandle_t*, bool) override { return false; }
};

// The fields of a message, read in the order in which they are named.
class Fields {
 public:
  Fields(Cdr& cdr, Json& out) : cdr_(cdr), out_(out) {}
  template <typename T>
  Fields& get(const char* name) {
    T value{};
    cdr_ >> value;
    out_[name] = value;
    return *this;
  }
  Fields& header() { return get<std::int32_t>("sec").get<std::uint32_t>("nanosec").get<std::string>("frame_id"); }

 private:
  Cdr& cdr_;
  Json& out_;
};

using U8 = std::uint8_t;
using U32 = std::uint32_t;
using Octets = std::vector<std::uint8_t>;
using Doubles = std::vector<double>;
using Text = std::string;

void slip(Cdr& cdr, Json& out) {
  Fields(cdr, out)
      .header()
      .get<U32>("frame")
      .get<U8>("state")
      .get<Text>("state_name")
      .get<U8>("reason")
      .get<Text>("reason_name")
      .get<bool>("slip")
      .get<bool>("grip_ok")
      .get<bool>("alive")
      .get<bool>("accepted")
      .get<bool>("features_valid")
      .get<bool>("rates_valid")
      .get<U32>("markers")
      .get<double>("vx_mm_s")
      .get<double>("vy_mm_s")
      .get<double>("entropy_nat")
      .get<double>("entropy_rate_nat_s")
      .get<double>("decided_us")
      .get<U8>("contact")
      .get<bool>("contact_known")
      .get<U8>("evidence")
      .get<Text>("evidence_name")
      .get<double>("evidence_value")
      .get<double>("evidence_threshold")
      .get<Text>("evidence_unit")
      .get<U32>("evidence_frames")
      .get<double>("imprint_um")
      .get<double>("coarse_um")
      .get<std::array<U32, 15>>("histogram")
      .get<U8>("load_basis")
      .get<bool>("load_within")
      .get<bool>("load_strained")
      .get<double>("shear_x_n")
      .get<double>("shear_y_n")
      .get<double>("normal_n")
      .get<double>("friction_use");
}

void markers(Cdr& cdr, Json& out) {
  Fields(cdr, out)
      .header()
      .get<U32>("frame")
      .get<Octets>("row")
      .get<Octets>("col")
      .get<Octets>("valid")
      .get<Doubles>("x_px")
      .get<Doubles>("y_px")
      .get<Doubles>("dx_px")
      .get<Doubles>("dy_px");
}

void camera(Cdr& cdr, Json& out) {
  Json whole;
  Fields(cdr, whole).header().get<Text>("format").get<Octets>("data");
  std::uint64_t sum = 14695981039346656037U;  // FNV-1a
  for (const std::uint8_t byte : whole["data"].get<Octets>()) sum = (sum ^ byte) * 1099511628211U;
  out["format"] = whole["format"];
  out["size"] = whole["data"].size();
  out["fnv1a"] = sum;
}

void diagnostics(Cdr& cdr, Json& out) {
  Fields fields(cdr, out);
  fields.header().get<U32>("statuses");
  fields.get<U8>("level").get<Text>("name").get<Text>("message").get<Text>("hardware_id");
  U32 count = 0;
  cdr >> count;
  for (U32 k = 0; k < count; ++k) {
    Text key, value;
    cdr >> key >> value;
    out["values"][key] = value;
  }
}

void answer(Cdr& cdr, Json& out) {
  Fields(cdr, out).get<U8>("command").get<U8>("argument").get<U8>("result").get<Text>("result_name");
}

class Printer : public dds::DataReaderListener {
 public:
  Printer(std::string topic, void (*take_apart)(Cdr&, Json&)) : topic_(std::move(topic)), take_apart_(take_apart) {}
  void on_data_available(dds::DataReader* reader) override {
    static std::mutex one_line;
    Bytes bytes;
    dds::SampleInfo info;
    while (reader->take_next_sample(&bytes, &info) == ReturnCode_t::RETCODE_OK) {
      if (!info.valid_data) continue;
      Json out{{"topic", topic_}};
      try {
        FastBuffer buffer(bytes.data(), bytes.size());
        Cdr cdr(buffer, Cdr::DEFAULT_ENDIAN, Cdr::DDS_CDR);
        cdr.read_encapsulation();
        take_apart_(cdr, out);
        // Behind the last field: what rounds the length up to a multiple of 4.
        out["rest"] = bytes.size() - cdr.getSerializedDataLength();
      } catch (const std::exception& error) {
        out["error"] = error.what();
      }
      const std::lock_guard lock(one_line);
      std::cout << out.dump() << std::endl;
    }
  }

 private:
  std::string topic_;
  void (*take_apart_)(Cdr&, Json&);
};

// On 127.0.0.1 alone, without multicast.
dds::DomainParticipantQos loopback() {
  dds::DomainParticipantQos qos;
  auto transport = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  transport->interfaceWhiteList.emplace_back("127.0.0.1");
  transport->maxInitialPeersRange = 10;
  transport->receiveBufferSize = 4'000'000;
  qos.transport().use_builtin_transports = false;
  qos.transport().user_transports.push_back(transport);
  rtps::Locator_t here;
  rtps::IPLocator::setIPv4(here, 127, 0, 0, 1);
  qos.wire_protocol().builtin.initialPeersList.push_back(here);
  rtps::Locator_t own;
  rtps::IPLocator::setIPv4(own, 127, 0, 0, 1);
  qos.wire_protocol().builtin.metatrafficUnicastLocatorList.push_back(own);
  return qos;
}

struct Topic {
  const char* name;
  const char* type;
  void (*take_apart)(Cdr&, Json&);
  bool reliable;
};
constexpr Topic kTopics[] = {
    {"rt/holdfast/slip", "holdfast_msgs::msg::dds_::SlipState_", slip, true},
    {"rt/holdfast/markers", "holdfast_msgs::msg::dds_::MarkerField_", markers, false},
    {"rt/holdfast/camera/compressed", "sensor_msgs::msg::dds_::CompressedImage_", camera, true},
    {"rt/diagnostics", "diagnostic_msgs::msg::dds_::DiagnosticArray_", diagnostics, true},
    {"rt/holdfast/answer", "holdfast_msgs::msg::dds_::Answer_", answer, true},
};

int run(std::uint32_t domain) {
  auto* const participant = dds::DomainParticipantFactory::get_instance()->create_participant(domain, loopback());
  if (participant == nullptr) return 1;
  auto* const subscriber = participant->create_subscriber(dds::SUBSCRIBER_QOS_DEFAULT);
  std::vector<std::unique_ptr<Printer>> printers;
  for (const Topic& one : kTopics) {
    dds::TypeSupport(new Raw(one.type)).register_type(participant);
    auto* const topic = participant->create_topic(one.name, one.type, dds::TOPIC_QOS_DEFAULT);
    dds::DataReaderQos qos;
    qos.reliability().kind = one.reliable ? dds::RELIABLE_RELIABILITY_QOS : dds::BEST_EFFORT_RELIABILITY_QOS;
    qos.history().depth = 10;
    qos.endpoint().history_memory_policy = rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
    printers.push_back(std::make_unique<Printer>(one.name, one.take_apart));
    if (subscriber->create_datareader(topic, qos, printers.back().get()) == nullptr) return 1;
  }
  constexpr const char* kCommand = "holdfast_msgs::msg::dds_::Command_";
  dds::TypeSupport(new Raw(kCommand)).register_type(participant);
  auto* const topic = participant->create_topic("rt/holdfast/command", kCommand, dds::TOPIC_QOS_DEFAULT);
  auto* const writer =
      participant->create_publisher(dds::PUBLISHER_QOS_DEFAULT)->create_datawriter(topic, dds::DATAWRITER_QOS_DEFAULT);
  if (writer == nullptr) return 1;
  int command = 0, argument = 0;
  while (std::cin >> command >> argument) {
    // What is written before a reader is found is lost, and that a sample was heard says nothing of it.
    dds::PublicationMatchedStatus matched;
    while (writer->get_publication_matched_status(matched) == ReturnCode_t::RETCODE_OK && matched.current_count == 0) {
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    Bytes bytes{0, 1, 0, 0, static_cast<char>(command), static_cast<char>(argument)};
    writer->write(&bytes);
  }
  std::_Exit(0);  // nothing here is worth an orderly end
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: fast_dds_peer DOMAIN\n");
    return 2;
  }
  return run(static_cast<std::uint32_t>(std::strtoul(argv[1], nullptr, 10)));
}
