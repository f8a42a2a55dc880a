// A foreign participant for the tests: Debian's Fast DDS, which is the default wire of ROS 2, on 127.0.0.1 alone.
//
//   fastdds_peer publish   DOMAIN TOPIC TYPE [latched] [seconds=N] [count=N]  < samples
//   fastdds_peer subscribe DOMAIN TOPIC TYPE [latched] [seconds=N] [count=N]
//   fastdds_peer encode TYPE  < samples
//   fastdds_peer decode TYPE  < payloads in hexadecimal
//
// TOPIC and TYPE are names of ROS ("joint_states", "sensor_msgs/msg/JointState"). A sample on standard input is the
// values of its fields in order, separated by white space: numbers, "texts", and the length of a sequence before its
// items. Each line of the output is one JSON object: {"matched": number of readers or writers}, {"payload": hex} for a
// sample that was sent, or {"payload": hex, "message": {...}} for one that was received. `encode` and `decode` say the
// same of samples that are never sent.
//
// `publish` ends when its input does and every reader has all samples; `subscribe` ends after `count` samples. Both end
// after `seconds` (20) in any case, with status 3. A sample that is not latched is lost on a side that has not found the
// other one yet, so the first sample has to wait until both sides say that they have. The structures below are written by hand from the interface texts, and Fast CDR alone turns them into bytes.

#include <fastcdr/Cdr.h>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>
#include <unistd.h>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/DataWriterListener.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>

#include <algorithm>
#include <cmath>
#include <condition_variable>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <iomanip>
#include <iostream>
#include <map>
#include <memory>
#include <mutex>
#include <sstream>
#include <string>
#include <type_traits>
#include <vector>

using namespace eprosima::fastdds::dds;
namespace rtps = eprosima::fastrtps::rtps;

// The messages. each() names the fields in the order in which they are sent.

struct Time {
  int32_t sec{};
  uint32_t nanosec{};
  template <class Self, class Visit>
  static void each(Self& s, Visit&& field) {
    field("sec", s.sec);
    field("nanosec", s.nanosec);
  }
};

struct Header {
  Time stamp;
  std::string frame_id;
  template <class Self, class Visit>
  static void each(Self& s, Visit&& field) {
    field("stamp", s.stamp);
    field("frame_id", s.frame_id);
  }
};

struct String {
  std::string data;
  template <class Self, class Visit>
  static void each(Self& s, Visit&& field) {
    field("data", s.data);
  }
};

struct Point {
  double x{}, y{}, z{};
  template <class Self, class Visit>
  static void each(Self& s, Visit&& field) {
    field("x", s.x);
    field("y", s.y);
    field("z", s.z);
  }
};

using Vector3 = Point;

struct Quaternion {
  double x{}, y{}, z{}, w{1};
  template <class Self, class Visit>
  static void each(Self& s, Visit&& field) {
    field("x", s.x);
    field("y", s.y);
    field("z", s.z);
    field("w", s.w);
  }
};

struct Pose {
  Point position;
  Quaternion orientation;
  template <class Self, class Visit>
  static void each(Self& s, Visit&& field) {
    field("position", s.position);
    field("orientation", s.orientation);
  }
};

struct PoseStamped {
  Header header;
  Pose pose;
  template <class Self, class Visit>
  static void each(Self& s, Visit&& field) {
    field("header", s.header);
    field("pose", s.pose);
  }
};

struct Transform {
  Vector3 translation;
  Quaternion rotation;
  template <class Self, class Visit>
  static void each(Self& s, Visit&& field) {
    field("translation", s.translation);
    field("rotation", s.rotation);
  }
};

struct TransformStamped {
  Header header;
  std::string child_frame_id;
  Transform transform;
  template <class Self, class Visit>
  static void each(Self& s, Visit&& field) {
    field("header", s.header);
    field("child_frame_id", s.child_frame_id);
    field("transform", s.transform);
  }
};

struct TFMessage {
  std::vector<TransformStamped> transforms;
  template <class Self, class Visit>
  static void each(Self& s, Visit&& field) {
    field("transforms", s.transforms);
  }
};

struct JointState {
  Header header;
  std::vector<std::string> name;
  std::vector<double> position, velocity, effort;
  template <class Self, class Visit>
  static void each(Self& s, Visit&& field) {
    field("header", s.header);
    field("name", s.name);
    field("position", s.position);
    field("velocity", s.velocity);
    field("effort", s.effort);
  }
};

// What can be done with them.

template <class T>
struct is_vector : std::false_type {};
template <class T>
struct is_vector<std::vector<T>> : std::true_type {};
template <class T>
constexpr bool is_plain = std::is_arithmetic_v<T> || std::is_same_v<T, std::string>;

template <class T>
void write(eprosima::fastcdr::Cdr& cdr, const T& value) {
  if constexpr (is_plain<T>) {
    cdr << value;
  } else if constexpr (is_vector<T>::value) {
    if constexpr (is_plain<typename T::value_type>) {
      cdr << value;
    } else {
      cdr << static_cast<uint32_t>(value.size());
      for (const auto& item : value) write(cdr, item);
    }
  } else {
    T::each(value, [&](const char*, const auto& field) { write(cdr, field); });
  }
}

template <class T>
void read(eprosima::fastcdr::Cdr& cdr, T& value) {
  if constexpr (is_plain<T>) {
    cdr >> value;
  } else if constexpr (is_vector<T>::value) {
    if constexpr (is_plain<typename T::value_type>) {
      cdr >> value;
    } else {
      uint32_t count{};
      cdr >> count;
      value.clear();
      for (uint32_t i = 0; i < count; ++i) read(cdr, value.emplace_back());
    }
  } else {
    T::each(value, [&](const char*, auto& field) { read(cdr, field); });
  }
}

std::string quoted(const std::string& text) {
  std::ostringstream out;
  out << '"';
  for (const unsigned char c : text) {
    if (c == '"' || c == '\\') {
      out << '\\' << c;
    } else if (c < 0x20) {
      out << "\\u" << std::hex << std::setw(4) << std::setfill('0') << int{c} << std::dec;
    } else {
      out << c;
    }
  }
  out << '"';
  return out.str();
}

template <class T>
void print(std::ostream& out, const T& value) {
  if constexpr (std::is_same_v<T, std::string>) {
    out << quoted(value);
  } else if constexpr (std::is_floating_point_v<T>) {
    if (std::isnan(value)) {
      out << "NaN";
    } else if (std::isinf(value)) {
      out << (value > 0 ? "Infinity" : "-Infinity");
    } else {
      out << std::setprecision(17) << value;
    }
  } else if constexpr (std::is_arithmetic_v<T>) {
    out << value;
  } else if constexpr (is_vector<T>::value) {
    out << '[';
    for (std::size_t i = 0; i < value.size(); ++i) {
      if (i > 0) out << ", ";
      print(out, value[i]);
    }
    out << ']';
  } else {
    out << '{';
    const char* comma = "";
    T::each(value, [&](const char* name, const auto& field) {
      out << comma << '"' << name << "\": ";
      print(out, field);
      comma = ", ";
    });
    out << '}';
  }
}

template <class T>
void parse(std::istream& in, T& value) {
  if constexpr (std::is_same_v<T, std::string>) {
    in >> std::quoted(value);
  } else if constexpr (std::is_floating_point_v<T>) {
    std::string word;  // the stream itself would refuse nan and inf
    in >> word;
    value = std::strtod(word.c_str(), nullptr);
  } else if constexpr (std::is_arithmetic_v<T>) {
    in >> value;
  } else if constexpr (is_vector<T>::value) {
    std::size_t count{};
    in >> count;
    value.resize(in ? count : 0);
    for (auto& item : value) parse(in, item);
  } else {
    T::each(value, [&](const char*, auto& field) { parse(in, field); });
  }
}

std::string hex(const unsigned char* bytes, std::size_t count) {
  static const char digits[] = "0123456789abcdef";
  std::string text;
  for (std::size_t i = 0; i < count; ++i) {
    text += digits[bytes[i] >> 4];
    text += digits[bytes[i] & 15];
  }
  return text;
}

// One sample of any of the types, and the type as Fast DDS wants it.

struct Sample {
  std::string payload;  // the bytes as they were sent or received, in hexadecimal
  virtual ~Sample() = default;
  virtual void parse_from(std::istream& in) = 0;
  virtual void print_to(std::ostream& out) const = 0;
};

template <class T>
struct SampleOf final : Sample {
  T message;
  void parse_from(std::istream& in) override { parse(in, message); }
  void print_to(std::ostream& out) const override { print(out, message); }
};

template <class T>
struct Type final : TopicDataType {
  explicit Type(const std::string& dds_name) {
    setName(dds_name.c_str());
    m_typeSize = 1 << 20;  // of the buffer for one serialised sample
    m_isGetKeyDefined = false;
  }

  bool serialize(void* data, rtps::SerializedPayload_t* payload) override {
    auto& sample = *static_cast<SampleOf<T>*>(static_cast<Sample*>(data));
    std::fill_n(payload->data, payload->max_size, 0);  // Fast CDR leaves what lies in the gaps before aligned fields
    eprosima::fastcdr::FastBuffer buffer(reinterpret_cast<char*>(payload->data), payload->max_size);
    eprosima::fastcdr::Cdr cdr(buffer, eprosima::fastcdr::Cdr::DEFAULT_ENDIAN, eprosima::fastcdr::Cdr::DDS_CDR);
    payload->encapsulation = cdr.endianness() == eprosima::fastcdr::Cdr::BIG_ENDIANNESS ? CDR_BE : CDR_LE;
    try {
      cdr.serialize_encapsulation();
      write(cdr, sample.message);
    } catch (const eprosima::fastcdr::exception::Exception& error) {
      std::cerr << "cannot serialise: " << error.what() << '\n';
      return false;
    }
    payload->length = static_cast<uint32_t>(cdr.getSerializedDataLength());
    sample.payload = hex(payload->data, payload->length);
    return true;
  }

  bool deserialize(rtps::SerializedPayload_t* payload, void* data) override {
    auto& sample = *static_cast<SampleOf<T>*>(static_cast<Sample*>(data));
    eprosima::fastcdr::FastBuffer buffer(reinterpret_cast<char*>(payload->data), payload->length);
    eprosima::fastcdr::Cdr cdr(buffer, eprosima::fastcdr::Cdr::DEFAULT_ENDIAN, eprosima::fastcdr::Cdr::DDS_CDR);
    try {
      cdr.read_encapsulation();
      read(cdr, sample.message);
    } catch (const eprosima::fastcdr::exception::Exception& error) {
      std::cerr << "cannot deserialise: " << error.what() << '\n';
      return false;
    }
    sample.payload = hex(payload->data, payload->length);
    return true;
  }

  std::function<uint32_t()> getSerializedSizeProvider(void*) override {
    return [this] { return m_typeSize; };
  }
  void* createData() override { return static_cast<Sample*>(new SampleOf<T>); }
  void deleteData(void* data) override { delete static_cast<Sample*>(data); }
  bool getKey(void*, rtps::InstanceHandle_t*, bool) override { return false; }
};

template <class T>
std::unique_ptr<TopicDataType> make_type(const std::string& dds_name) {
  return std::make_unique<Type<T>>(dds_name);
}

const std::map<std::string, std::unique_ptr<TopicDataType> (*)(const std::string&)> types = {
    {"geometry_msgs/msg/Point", make_type<Point>},         {"geometry_msgs/msg/PoseStamped", make_type<PoseStamped>},
    {"sensor_msgs/msg/JointState", make_type<JointState>}, {"std_msgs/msg/String", make_type<String>},
    {"tf2_msgs/msg/TFMessage", make_type<TFMessage>},
};

// What it says.

std::mutex output;

void say(const std::string& line) {
  const std::lock_guard<std::mutex> lock(output);
  std::cout << line << std::endl;
}

void say_matched(int count) { say("{\"matched\": " + std::to_string(count) + "}"); }

void say_sent(const Sample& sample) { say("{\"payload\": \"" + sample.payload + "\"}"); }

void say_received(const Sample& sample) {
  std::ostringstream message;
  sample.print_to(message);
  say("{\"payload\": \"" + sample.payload + "\", \"message\": " + message.str() + "}");
}

// The programme.

struct Arguments {
  std::string verb, type, topic;
  uint32_t domain{};
  bool latched{};
  unsigned seconds{20};
  int count{1};
};

Arguments parse_arguments(int argc, char** argv) {
  Arguments arguments;
  std::vector<std::string> words(argv + 1, argv + argc);
  const auto next = [&words] {
    if (words.empty()) throw std::runtime_error("arguments are missing; see the top of fastdds_peer.cpp");
    const std::string word = words.front();
    words.erase(words.begin());
    return word;
  };
  arguments.verb = next();
  if (arguments.verb == "publish" || arguments.verb == "subscribe") {
    arguments.domain = static_cast<uint32_t>(std::stoul(next()));
    arguments.topic = next();
  } else if (arguments.verb != "encode" && arguments.verb != "decode") {
    throw std::runtime_error("unknown verb: " + arguments.verb);
  }
  arguments.type = next();
  if (types.count(arguments.type) == 0) throw std::runtime_error("unknown type: " + arguments.type);
  while (!words.empty()) {
    const std::string word = next();
    if (word == "latched") {
      arguments.latched = true;
    } else if (word.rfind("seconds=", 0) == 0) {
      arguments.seconds = static_cast<unsigned>(std::stoul(word.substr(8)));
    } else if (word.rfind("count=", 0) == 0) {
      arguments.count = std::stoi(word.substr(6));
    } else {
      throw std::runtime_error("unknown argument: " + word);
    }
  }
  return arguments;
}

std::string dds_name(const std::string& ros_name) {  // pkg/msg/Name -> pkg::msg::dds_::Name_
  const auto first = ros_name.find('/'), last = ros_name.rfind('/');
  return ros_name.substr(0, first) + "::" + ros_name.substr(first + 1, last - first - 1) +
         "::dds_::" + ros_name.substr(last + 1) + "_";
}

// Nothing but UDP on 127.0.0.1, and no multicast at all: every other participant is found by its well-known port.
DomainParticipant* make_participant(uint32_t domain) {
  DomainParticipantQos qos;
  auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  udp->interfaceWhiteList.push_back("127.0.0.1");
  udp->maxInitialPeersRange = 16;
  qos.transport().use_builtin_transports = false;
  qos.transport().user_transports.push_back(udp);
  rtps::Locator_t loopback;
  rtps::IPLocator::setIPv4(loopback, 127, 0, 0, 1);  // port 0: as the domain and the participant's number say
  auto& builtin = qos.wire_protocol().builtin;
  builtin.metatrafficUnicastLocatorList.push_back(loopback);
  builtin.initialPeersList.push_back(loopback);
  builtin.discovery_config.initial_announcements.count = 20;
  builtin.discovery_config.initial_announcements.period = {0, 100'000'000};
  qos.wire_protocol().default_unicast_locator_list.push_back(loopback);
  qos.name("fastdds_peer");
  return DomainParticipantFactory::get_instance()->create_participant(domain, qos);
}

template <class Qos>
Qos reliable(Qos qos, const Arguments& arguments) {
  qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
  qos.durability().kind = arguments.latched ? TRANSIENT_LOCAL_DURABILITY_QOS : VOLATILE_DURABILITY_QOS;
  qos.history().kind = KEEP_LAST_HISTORY_QOS;
  qos.history().depth = arguments.latched ? 1 : 100;
  qos.endpoint().history_memory_policy = rtps::DYNAMIC_RESERVE_MEMORY_MODE;
  return qos;
}

struct Matches final : DataWriterListener {
  void on_publication_matched(DataWriter*, const PublicationMatchedStatus& status) override {
    say_matched(status.current_count);
  }
};

bool more_input() { return std::cin >> std::ws && std::cin.peek() != std::istream::traits_type::eof(); }

std::unique_ptr<Sample> new_sample(TypeSupport& type) {
  return std::unique_ptr<Sample>(static_cast<Sample*>(type.create_data()));
}

std::unique_ptr<Sample> next_sample(TypeSupport& type) {
  auto sample = new_sample(type);
  sample->parse_from(std::cin);
  if (!std::cin) throw std::runtime_error("the input is not a " + type.get_type_name());
  return sample;
}

void encode(TypeSupport& type) {
  rtps::SerializedPayload_t payload(type->m_typeSize);
  while (more_input()) {
    const auto sample = next_sample(type);
    if (!type.serialize(static_cast<void*>(sample.get()), &payload)) throw std::runtime_error("not encoded");
    say_sent(*sample);
  }
}

void decode(TypeSupport& type) {
  rtps::SerializedPayload_t payload(type->m_typeSize);
  std::string text;
  while (std::cin >> text) {
    payload.length = static_cast<uint32_t>(text.size() / 2);
    if (payload.length > payload.max_size) throw std::runtime_error("the payload is too long");
    for (std::size_t i = 0; i < payload.length; ++i) {
      payload.data[i] = static_cast<unsigned char>(std::stoi(text.substr(2 * i, 2), nullptr, 16));
    }
    const auto sample = new_sample(type);
    if (!type.deserialize(&payload, static_cast<void*>(sample.get()))) throw std::runtime_error("not decoded");
    say_received(*sample);
  }
}

void publish(DomainParticipant& participant, Topic& topic, TypeSupport& type, const Arguments& arguments) {
  Matches matches;
  DataWriter* writer = participant.create_publisher(PUBLISHER_QOS_DEFAULT)
                           ->create_datawriter(&topic, reliable(DATAWRITER_QOS_DEFAULT, arguments), &matches);
  while (more_input()) {
    const auto sample = next_sample(type);
    if (!writer->write(static_cast<void*>(sample.get()))) throw std::runtime_error("the sample was not sent");
    say_sent(*sample);
  }
  writer->wait_for_acknowledgments({5, 0});
  writer->set_listener(nullptr);
}

struct Printer final : DataReaderListener {
  TypeSupport& type;
  std::mutex mutex;
  std::condition_variable changed;
  int missing;
  Printer(TypeSupport& type, int count) : type(type), missing(count) {}
  void on_subscription_matched(DataReader*, const SubscriptionMatchedStatus& status) override {
    say_matched(status.current_count);
  }
  void on_data_available(DataReader* reader) override {
    const auto sample = new_sample(type);
    SampleInfo info;
    while (reader->take_next_sample(static_cast<void*>(sample.get()), &info) == ReturnCode_t::RETCODE_OK) {
      if (!info.valid_data) continue;
      const std::lock_guard<std::mutex> lock(mutex);
      if (missing == 0) return;
      say_received(*sample);
      --missing;
      changed.notify_all();
    }
  }
};

void subscribe(DomainParticipant& participant, Topic& topic, TypeSupport& type, const Arguments& arguments) {
  Printer printer(type, arguments.count);
  DataReader* reader = participant.create_subscriber(SUBSCRIBER_QOS_DEFAULT)
                           ->create_datareader(&topic, reliable(DATAREADER_QOS_DEFAULT, arguments), &printer);
  std::unique_lock<std::mutex> lock(printer.mutex);
  printer.changed.wait(lock, [&] { return printer.missing == 0; });
  lock.unlock();
  reader->set_listener(nullptr);
}

int main(int argc, char** argv) {
  try {
    const Arguments arguments = parse_arguments(argc, argv);
    std::signal(SIGALRM, [](int) { _exit(3); });
    alarm(arguments.seconds);
    TypeSupport type(types.at(arguments.type)(dds_name(arguments.type)).release());
    if (arguments.verb == "encode") return encode(type), 0;
    if (arguments.verb == "decode") return decode(type), 0;
    DomainParticipant* participant = make_participant(arguments.domain);
    if (participant == nullptr) throw std::runtime_error("no participant: the domain is not usable on 127.0.0.1");
    type.register_type(participant);
    Topic* topic = participant->create_topic("rt/" + arguments.topic, type.get_type_name(), TOPIC_QOS_DEFAULT);
    if (arguments.verb == "publish") {
      publish(*participant, *topic, type, arguments);
    } else {
      subscribe(*participant, *topic, type, arguments);
    }
    participant->delete_contained_entities();
    DomainParticipantFactory::get_instance()->delete_participant(participant);
  } catch (const std::exception& error) {
    std::cerr << "error: " << error.what() << std::endl;
    return 1;
  }
}
