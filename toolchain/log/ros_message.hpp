// SPDX-License-Identifier: Apache-2.0
// ROS 2 messages from one table each: the text of their schema, their bytes, and back.
//
// A message is a struct, and a Message<T> that names it and lists its members. The type of a member says how it is
// written in the schema and how in CDR (XCDR1, little endian, as rosbag2 has it), so that the two cannot drift apart:
//   bool, std::uint8_t, std::int32_t, std::uint32_t, double   of that width; an enum as its underlying type
//   std::string_view                                           string; of the bytes, when decoded
//   std::span<const std::uint8_t>                              uint8[]; likewise
//   std::vector<T>, std::array<number, N>                      T[] of a number or message, number[N]
//   a struct with a Message                                    package/Type
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>
#include <vector>

namespace holdfast::log {

template <typename Struct, typename Member>
struct Field {
  std::string_view name;
  Member Struct::*member;
  std::string_view comment;  // unit and meaning, for the schema; may be empty
};

template <typename Struct, typename Member>
[[nodiscard]] constexpr Field<Struct, Member> field(std::string_view name, Member Struct::*member,
                                                    std::string_view comment = {}) {
  return {name, member, comment};
}

// Specialised for each message: kPackage, kType, and kFields, a tuple of Field.
template <typename T>
struct Message;

template <typename T>
concept IsMessage = requires {
  Message<T>::kFields;
};
template <typename T>
concept IsNumber = std::is_arithmetic_v<T> || std::is_enum_v<T>;
template <typename T>
struct IsArrayType : std::false_type {};
template <typename T, std::size_t N>
struct IsArrayType<std::array<T, N>> : std::true_type {};
template <typename T>
concept IsArray = IsArrayType<T>::value;
template <typename T>
struct IsVectorType : std::false_type {};
template <typename T>
struct IsVectorType<std::vector<T>> : std::bool_constant<IsNumber<T> || IsMessage<T>> {};
template <typename T>
concept IsSequence = std::is_same_v<T, std::span<const std::uint8_t>> || IsVectorType<T>::value;

// Calls what(field) for each member in order.
template <IsMessage T, typename What>
void for_each_field(const What& what) {
  std::apply([&](const auto&... fields) { (what(fields), ...); }, Message<T>::kFields);
}

// "package/msg/Type"
template <IsMessage T>
[[nodiscard]] std::string schema_name() {
  return std::string(Message<T>::kPackage) + "/msg/" + std::string(Message<T>::kType);
}

namespace ros {

template <typename T>
[[nodiscard]] std::string type_name() {
  if constexpr (IsMessage<T>) {
    return std::string(Message<T>::kPackage) + "/" + std::string(Message<T>::kType);
  } else if constexpr (std::is_enum_v<T>) {
    return type_name<std::underlying_type_t<T>>();
  } else if constexpr (std::is_same_v<T, bool>) {
    return "bool";
  } else if constexpr (std::is_same_v<T, std::uint8_t>) {
    return "uint8";
  } else if constexpr (std::is_same_v<T, std::int32_t>) {
    return "int32";
  } else if constexpr (std::is_same_v<T, std::uint32_t>) {
    return "uint32";
  } else if constexpr (std::is_same_v<T, double>) {
    return "float64";
  } else if constexpr (std::is_same_v<T, std::string_view>) {
    return "string";
  } else if constexpr (IsArray<T>) {
    return type_name<typename T::value_type>() + "[" + std::to_string(std::tuple_size_v<T>) + "]";
  } else {
    static_assert(IsSequence<T>);
    return type_name<std::remove_const_t<typename T::value_type>>() + "[]";
  }
}

template <typename T>
struct Element {
  using Type = T;
};
template <typename T>
struct Element<std::vector<T>> {
  using Type = T;
};

template <IsMessage T>
void add_schema(std::string& text, std::set<std::string>& seen) {
  for_each_field<T>([&]<typename S, typename M>(const Field<S, M>& f) {
    text += type_name<M>() + " " + std::string(f.name);
    if (!f.comment.empty()) text += "  # " + std::string(f.comment);
    text += "\n";
  });
  for_each_field<T>([&]<typename S, typename M>(const Field<S, M>&) {
    using Inner = typename Element<M>::Type;
    if constexpr (IsMessage<Inner>) {
      if (!seen.insert(type_name<Inner>()).second) return;
      text += std::string(80, '=') + "\nMSG: " + type_name<Inner>() + "\n";
      add_schema<Inner>(text, seen);
    }
  });
}

}  // namespace ros

// The .msg text, and behind it those of the messages inside.
template <IsMessage T>
[[nodiscard]] std::string schema_text() {
  std::string text;
  std::set<std::string> seen;
  ros::add_schema<T>(text, seen);
  return text;
}

class CdrWriter {
 public:
  template <typename T>
  void put(const T& value) {
    if constexpr (IsMessage<T>) {
      for_each_field<T>([&](const auto& f) { put(value.*f.member); });
    } else if constexpr (IsNumber<T>) {
      while ((bytes_.size() - kHead) % sizeof(T) != 0) bytes_.push_back(0);
      std::uint8_t raw[sizeof(T)];
      std::memcpy(raw, &value, sizeof raw);
      bytes_.insert(bytes_.end(), raw, raw + sizeof raw);
    } else if constexpr (std::is_same_v<T, std::string_view>) {
      put(static_cast<std::uint32_t>(value.size() + 1));
      bytes_.insert(bytes_.end(), value.begin(), value.end());
      bytes_.push_back(0);
    } else {
      if constexpr (!IsArray<T>) put(static_cast<std::uint32_t>(value.size()));
      if constexpr (sizeof(typename T::value_type) == 1) {
        bytes_.insert(bytes_.end(), value.begin(), value.end());
      } else {
        for (const auto& element : value) put(element);
      }
    }
  }
  [[nodiscard]] std::vector<std::uint8_t> take() { return std::move(bytes_); }

 private:
  static constexpr std::size_t kHead = 4;
  std::vector<std::uint8_t> bytes_{0, 1, 0, 0};  // CDR, little endian
};

// The least bytes of a value, but for what aligns it.
template <typename T>
[[nodiscard]] constexpr std::size_t least_bytes() {
  if constexpr (IsMessage<T>) {
    std::size_t sum = 0;
    for_each_field<T>([&]<typename S, typename M>(const Field<S, M>&) { sum += least_bytes<M>(); });
    return sum;
  } else if constexpr (IsNumber<T>) {
    return sizeof(T);
  } else if constexpr (IsArray<T>) {
    return std::tuple_size_v<T> * least_bytes<typename T::value_type>();
  } else {
    return sizeof(std::uint32_t) + (std::is_same_v<T, std::string_view> ? 1 : 0);
  }
}

// Strict: what is not exactly what CdrWriter writes is refused, so that nothing is read into other bytes.
class CdrReader {
 public:
  explicit CdrReader(std::span<const std::uint8_t> bytes) : bytes_(bytes), at_(kHead) {
    ok_ = bytes.size() >= kHead && bytes[0] == 0 && bytes[1] == 1 && bytes[2] == 0 && bytes[3] == 0;
  }
  [[nodiscard]] bool at_end() const { return ok_ && at_ == bytes_.size(); }

  template <typename T>
  void get(T& value) {
    if constexpr (IsMessage<T>) {
      for_each_field<T>([&](const auto& f) { get(value.*f.member); });
    } else if constexpr (IsNumber<T>) {
      while (ok_ && (at_ - kHead) % sizeof(T) != 0) {
        const auto padding = take(1);
        ok_ = ok_ && padding[0] == 0;
      }
      const auto raw = take(sizeof(T));
      if (!ok_) return;
      if constexpr (std::is_same_v<T, bool>) {
        ok_ = raw[0] <= 1;
        value = raw[0] == 1;
      } else {
        std::memcpy(&value, raw.data(), sizeof(T));
      }
    } else if constexpr (std::is_same_v<T, std::string_view>) {
      std::uint32_t size = 0;
      get(size);
      const auto raw = take(size);
      ok_ = ok_ && size > 0 && std::memchr(raw.data(), 0, size) == raw.data() + size - 1;
      if (ok_) value = {reinterpret_cast<const char*>(raw.data()), size - 1U};
    } else if constexpr (IsArray<T>) {
      for (auto& element : value) get(element);
    } else {
      std::uint32_t size = 0;
      get(size);
      if constexpr (std::is_same_v<T, std::span<const std::uint8_t>>) {
        value = take(size);
      } else {
        // Not more is reserved than there are bytes for.
        ok_ = ok_ && size <= (bytes_.size() - at_) / least_bytes<typename T::value_type>();
        value.assign(ok_ ? size : 0, {});
        for (auto& element : value) get(element);
      }
    }
  }

 private:
  static constexpr std::size_t kHead = 4;
  std::span<const std::uint8_t> take(std::size_t size) {
    ok_ = ok_ && size <= bytes_.size() - at_;
    if (!ok_) return {};
    const auto taken = bytes_.subspan(at_, size);
    at_ += size;
    return taken;
  }

  std::span<const std::uint8_t> bytes_;
  std::size_t at_;
  bool ok_ = false;
};

template <IsMessage T>
[[nodiscard]] std::vector<std::uint8_t> encode(const T& message) {
  CdrWriter writer;
  writer.put(message);
  return writer.take();
}

// Texts and bytes of the result point into `bytes`. None: not such a message.
template <IsMessage T>
[[nodiscard]] std::optional<T> decode(std::span<const std::uint8_t> bytes) {
  CdrReader reader(bytes);
  T message;
  reader.get(message);
  return reader.at_end() ? std::optional(std::move(message)) : std::nullopt;
}

}  // namespace holdfast::log
