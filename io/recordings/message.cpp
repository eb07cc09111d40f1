#include "message.h"

#include <algorithm>
#include <array>
#include <map>
#include <sstream>

#include "bytes.h"

namespace kincal {

namespace {

struct Primitive {
  std::string_view name;
  FieldKind kind;
};

constexpr std::array<Primitive, 18> kPrimitives = {
    {{"bool", FieldKind::boolean},
     {"int8", FieldKind::int8},
     {"byte", FieldKind::int8},
     {"uint8", FieldKind::uint8},
     {"char", FieldKind::uint8},
     {"int16", FieldKind::int16},
     {"uint16", FieldKind::uint16},
     {"int32", FieldKind::int32},
     {"uint32", FieldKind::uint32},
     {"int64", FieldKind::int64},
     {"uint64", FieldKind::uint64},
     {"float32", FieldKind::float32},
     {"float64", FieldKind::float64},
     {"string", FieldKind::text},
     {"time", FieldKind::time},
     {"duration", FieldKind::duration},
     {"builtin_interfaces/Time", FieldKind::time},
     {"builtin_interfaces/Duration", FieldKind::duration}}};

/// Bytes of one number; 0: of what is none.
size_t width_of(FieldKind kind) {
  switch (kind) {
    case FieldKind::boolean:
    case FieldKind::int8:
    case FieldKind::uint8:
      return 1;
    case FieldKind::int16:
    case FieldKind::uint16:
      return 2;
    case FieldKind::int32:
    case FieldKind::uint32:
    case FieldKind::float32:
      return 4;
    case FieldKind::int64:
    case FieldKind::uint64:
    case FieldKind::float64:
      return 8;
    default:
      return 0;
  }
}

/// package/Type for package/msg/Type.
std::string plain_type(std::string name) {
  const size_t at = name.find("/msg/");
  if (at != std::string::npos) name.erase(at, 4);
  return name;
}

struct RawField {
  std::string type, name;
  bool array = false;
  std::uint64_t count = 0;
};

/// A line's field; an empty name where it has none (a constant, a remark, nothing).
RawField field_of(const std::string& line) {
  std::istringstream words(line.substr(0, line.find('#')));
  RawField out;
  std::string rest;
  words >> out.type >> out.name;
  std::getline(words, rest);
  const size_t bracket = out.type.find('[');
  if (bracket != std::string::npos) {
    const std::string size = out.type.substr(bracket + 1, out.type.find(']') - bracket - 1);
    out.array = true;
    if (!size.empty() && size.find_first_not_of("0123456789") == std::string::npos &&
        size.size() < 10)
      out.count = std::stoull(size);
    else if (!size.empty() && size.rfind("<=", 0) != 0)
      throw Damage("definition: '" + line + "' has no valid size of an array");
    out.type.resize(bracket);
    if (out.count == 0 && size.find_first_not_of('0') == std::string::npos && !size.empty())
      throw Damage("definition: '" + line + "' is an array of size 0");
  }
  out.type = plain_type(out.type.substr(0, out.type.find("<=")));  // string<=20
  const size_t next = rest.find_first_not_of(" \t\r");
  const bool constant =
      out.name.find('=') != std::string::npos || (next != std::string::npos && rest[next] == '=');
  if (constant) out.name.clear();
  return out;
}

using Sections = std::map<std::string, std::vector<RawField>>;

/// The parts of a definition by their types; the first is of `type`.
void read_sections(const std::string& type, const std::string& text, Sections& sections) {
  std::istringstream lines(text);
  std::string name = type;
  bool title = false;
  sections[name];
  for (std::string line; std::getline(lines, line);) {
    if (!line.empty() && line.back() == '\r') line.pop_back();
    if (line.size() >= 20 && line.find_first_not_of('=') == std::string::npos) {
      title = true;
    } else if (title) {
      if (line.rfind("MSG: ", 0) != 0) throw Damage("definition: '" + line + "' names no type");
      name = plain_type(line.substr(5));
      while (!name.empty() && (name.back() == ' ' || name.back() == '\t')) name.pop_back();
      sections[name].clear();
      title = false;
    } else {
      RawField one = field_of(line);
      if (!one.name.empty()) sections[name].push_back(std::move(one));
    }
  }
}

/// Types as far as they are read; those that are being read have depth -1.
struct TypeReader {
  struct Known {
    int at = 0, depth = -1;  // depth: 0 of a type without other types in it
  };
  Sections sections;
  MessageTypes types;
  std::map<std::string, Known> index;

  /// The full name of a type that a message of `package` uses.
  std::string full_name(const std::string& name, const std::string& package) {
    if (name == "Header") return "std_msgs/Header";
    return name.find('/') == std::string::npos ? package + "/" + name : name;
  }

  /// `above`: how many types this one is a part of.
  Known add(const std::string& name, int above) {
    constexpr int deepest = 32;
    const auto known = index.find(name);
    if (known != index.end()) {
      if (known->second.depth < 0) throw Damage("definition: type '" + name + "' contains itself");
      return known->second;
    }
    if (above > deepest) throw Damage("definition: types are nested more than 32 deep");
    if (!sections.count(name)) {
      const std::string standard = standard_definition(name);
      if (standard.empty()) throw Damage("definition: type '" + name + "' is not there");
      read_sections(name, standard, sections);
    }
    const std::vector<RawField> raw = sections[name];
    Known out{static_cast<int>(types.size()), -1};
    types.push_back({name, {}});
    index[name] = out;
    int depth = 0;
    const std::string package = name.substr(0, name.find('/'));
    for (const RawField& one : raw) {
      MessageField next{one.name, FieldKind::message, -1, one.array, one.count};
      const auto primitive = std::find_if(kPrimitives.begin(), kPrimitives.end(),
                                          [&](const Primitive& p) { return p.name == one.type; });
      if (primitive != kPrimitives.end()) {
        next.kind = primitive->kind;
      } else {
        const Known part = add(full_name(one.type, package), above + 1);
        next.type = part.at;
        depth = std::max(depth, part.depth + 1);
      }
      types[out.at].fields.push_back(std::move(next));
    }
    if (depth > deepest) throw Damage("definition: types are nested more than 32 deep");
    out.depth = depth;
    return index[name] = out;
  }
};

struct Decoder {
  const MessageTypes& types;
  Bytes bytes;
  bool cdr = false, swapped = false;
  size_t all = 0;     // bytes after CDR's first four
  size_t values = 0;  // that it may still have

  /// Values take memory, and those of types without fields no byte of the message.
  void count_values(std::uint64_t count) {
    if (count > values) throw Damage("it has more values than its bytes can hold");
    values -= count;
  }

  void align(size_t width) {
    if (!cdr || width < 2) return;
    const size_t over = (all - bytes.left.size()) % width;
    if (over) bytes.take(width - over);
  }

  template <class Number>
  Number number() {
    align(sizeof(Number));
    return bytes.number<Number>(swapped);
  }

  std::string_view text() {
    const auto count = number<std::uint32_t>();
    std::string_view out = bytes.take(count);
    if (cdr && !out.empty() && out.back() == '\0') out.remove_suffix(1);
    return out;
  }

  MessageValue single(const MessageField& f) {
    switch (f.kind) {
      case FieldKind::boolean:
      case FieldKind::uint8:
        return {std::int64_t{number<std::uint8_t>()}};
      case FieldKind::int8:
        return {std::int64_t{number<std::int8_t>()}};
      case FieldKind::int16:
        return {std::int64_t{number<std::int16_t>()}};
      case FieldKind::uint16:
        return {std::int64_t{number<std::uint16_t>()}};
      case FieldKind::int32:
        return {std::int64_t{number<std::int32_t>()}};
      case FieldKind::uint32:
        return {std::int64_t{number<std::uint32_t>()}};
      case FieldKind::int64:
        return {number<std::int64_t>()};
      case FieldKind::uint64:
        return {static_cast<std::int64_t>(number<std::uint64_t>())};
      case FieldKind::float32:
        return {double{number<float>()}};
      case FieldKind::float64:
        return {number<double>()};
      case FieldKind::time:
      case FieldKind::duration: {
        const auto s = number<std::uint32_t>(), ns = number<std::uint32_t>();
        const bool duration = f.kind == FieldKind::duration;  // ROS 2 has s signed in both
        const std::int64_t whole = cdr || duration ? static_cast<std::int32_t>(s) : std::int64_t{s};
        return {whole * 1000000000 +
                (duration && !cdr ? static_cast<std::int32_t>(ns) : std::int64_t{ns})};
      }
      case FieldKind::text:
        return {text()};
      default:
        return message(f.type);
    }
  }

  MessageValue several(const MessageField& f) {
    const std::uint64_t count = f.count ? f.count : number<std::uint32_t>();
    const size_t width = width_of(f.kind);
    if (width) {
      if (count > 0) align(width);
      return {NumberArray{f.kind, bytes.take(count * width), swapped}};
    }
    count_values(count);
    std::vector<MessageValue> out;
    out.reserve(count);
    for (std::uint64_t i = 0; i < count; ++i) out.push_back(single(f));
    return {std::move(out)};
  }

  MessageValue message(int type) {
    std::vector<MessageValue> out;
    count_values(types[type].fields.size());
    out.reserve(types[type].fields.size());
    for (const MessageField& f : types[type].fields)
      out.push_back(f.array ? several(f) : single(f));
    if (types[type].fields.empty() && cdr) bytes.take(1);  // IDL has no empty structures
    return {std::move(out), &types[type]};
  }
};

std::string small(std::string_view name) {
  std::string out(name);
  std::transform(out.begin(), out.end(), out.begin(), [](char c) {
    return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  });
  return out;
}

[[noreturn]] void no_such(const char* what) { throw Damage(std::string("a field is not ") + what); }

}  // namespace

MessageTypes read_definition(const std::string& type, const std::string& text) {
  TypeReader reader;
  const std::string name = plain_type(type);
  if (!text.empty()) read_sections(name, text, reader.sections);
  reader.add(name, 0);
  return std::move(reader.types);
}

std::string standard_definition(const std::string& type) {
  static const std::map<std::string, std::string> known = {
      {"std_msgs/Header", "time stamp\nstring frame_id"},
      {"std_msgs/String", "string data"},
      {"sensor_msgs/JointState",
       "Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort"},
      {"sensor_msgs/Image",
       "Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 "
       "step\nuint8[] data"},
      {"sensor_msgs/CompressedImage", "Header header\nstring format\nuint8[] data"},
      {"sensor_msgs/RegionOfInterest",
       "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify"},
      {"sensor_msgs/CameraInfo",
       "Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] "
       "d\nfloat64[9] k\nfloat64[9] r\nfloat64[12] p\nuint32 binning_x\nuint32 "
       "binning_y\nRegionOfInterest roi"},
      {"sensor_msgs/LaserScan",
       "Header header\nfloat32 angle_min\nfloat32 angle_max\nfloat32 angle_increment\nfloat32 "
       "time_increment\nfloat32 scan_time\nfloat32 range_min\nfloat32 range_max\nfloat32[] "
       "ranges\nfloat32[] intensities"},
      {"sensor_msgs/PointField", "string name\nuint32 offset\nuint8 datatype\nuint32 count"},
      {"sensor_msgs/PointCloud2",
       "Header header\nuint32 height\nuint32 width\nPointField[] fields\nbool "
       "is_bigendian\nuint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense"},
      {"geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z"},
      {"geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z"},
      {"geometry_msgs/Quaternion", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w"},
      {"geometry_msgs/Pose", "Point position\nQuaternion orientation"},
      {"geometry_msgs/PoseStamped", "Header header\nPose pose"},
      {"geometry_msgs/Transform", "Vector3 translation\nQuaternion rotation"},
      {"geometry_msgs/TransformStamped",
       "Header header\nstring child_frame_id\nTransform transform"},
      {"tf2_msgs/TFMessage", "geometry_msgs/TransformStamped[] transforms"}};
  const auto found = known.find(type);
  return found == known.end() ? std::string() : found->second;
}

size_t NumberArray::size() const { return bytes.size() / width_of(kind); }

double NumberArray::operator[](size_t i) const {
  const auto at = [&](auto like) {
    return static_cast<double>(Bytes::number_at<decltype(like)>(bytes, i, swapped));
  };
  switch (kind) {
    case FieldKind::int8:
      return at(std::int8_t{});
    case FieldKind::int16:
      return at(std::int16_t{});
    case FieldKind::uint16:
      return at(std::uint16_t{});
    case FieldKind::int32:
      return at(std::int32_t{});
    case FieldKind::uint32:
      return at(std::uint32_t{});
    case FieldKind::int64:
      return at(std::int64_t{});
    case FieldKind::uint64:
      return at(std::uint64_t{});
    case FieldKind::float32:
      return at(float{});
    case FieldKind::float64:
      return at(double{});
    default:
      return at(std::uint8_t{});
  }
}

MessageValue decode_message(const MessageTypes& types, Wire wire, std::string_view data) {
  constexpr size_t most_values = 10000000;
  Decoder decoder{types, {data}};
  decoder.values = std::min(4 * data.size() + 1000, most_values);
  if (wire == Wire::cdr) {
    const std::string_view first = decoder.bytes.take(4);
    if (first[0] != 0 || (first[1] != 0 && first[1] != 1))
      throw Damage("unsupported CDR (representation " +
                   std::to_string(static_cast<unsigned char>(first[1])) + ")");
    decoder.cdr = true;
    decoder.swapped = first[1] == 0;
    decoder.all = decoder.bytes.left.size();
  }
  MessageValue out = decoder.message(0);
  if (wire == Wire::ros1 && !decoder.bytes.left.empty())
    throw Damage(std::to_string(decoder.bytes.left.size()) + " bytes are left over");
  return out;
}

const MessageValue& field(const MessageValue& message, std::string_view path) {
  const std::string_view name = path.substr(0, path.find('.'));
  const auto* values = std::get_if<std::vector<MessageValue>>(&message.value);
  if (values && message.type)
    for (size_t i = 0; i < values->size(); ++i) {
      const std::string& is = message.type->fields[i].name;
      if (is != name && is != small(name)) continue;
      return name.size() == path.size() ? (*values)[i]
                                        : field((*values)[i], path.substr(name.size() + 1));
    }
  throw Damage("field '" + std::string(name) + "' is not there" +
               (message.type ? ", in " + message.type->name : ""));
}

double number_of(const MessageValue& value) {
  if (const auto* i = std::get_if<std::int64_t>(&value.value)) return static_cast<double>(*i);
  if (const auto* d = std::get_if<double>(&value.value)) return *d;
  no_such("a number");
}

std::int64_t nanoseconds_of(const MessageValue& value) {
  if (const auto* i = std::get_if<std::int64_t>(&value.value)) return *i;
  no_such("a time");
}

std::string_view text_of(const MessageValue& value) {
  if (const auto* t = std::get_if<std::string_view>(&value.value)) return *t;
  no_such("a text");
}

NumberArray numbers_of(const MessageValue& value) {
  if (const auto* n = std::get_if<NumberArray>(&value.value)) return *n;
  no_such("an array of numbers");
}

const std::vector<MessageValue>& list_of(const MessageValue& value) {
  const auto* list = std::get_if<std::vector<MessageValue>>(&value.value);
  if (list && !value.type) return *list;
  no_such("an array");
}

}  // namespace kincal
