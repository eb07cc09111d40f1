#include "number_lists.h"

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <limits>

#include "../document/document.h"
#include "../document/names.h"
#include "../document/numbers.h"
#include "foreign.h"

namespace kincal {
namespace {

// ------------------------------------------------------------------------------------------------
// arrays of numpy
constexpr char kMagic[] = "\x93NUMPY";
constexpr size_t kMagicBytes = 6;

/// What stands behind a key of the header, which is a dictionary of Python: {'descr': '<f8', ...}.
std::string value_of(const std::string& header, const std::string& key) {
  const size_t at = header.find("'" + key + "':");
  if (at == std::string::npos) return "";
  size_t begin = header.find_first_not_of(' ', at + key.size() + 3);
  if (begin == std::string::npos) return "";
  const char open = header[begin];
  const size_t end = open == '('    ? header.find(')', begin)
                     : open == '\'' ? header.find('\'', begin + 1)
                                    : header.find_first_of(",}", begin);
  if (open == '(' || open == '\'') ++begin;
  return end == std::string::npos ? "" : header.substr(begin, end - begin);
}

std::vector<size_t> shape_of(const std::string& text) {
  std::vector<size_t> out;
  size_t value = 0;
  bool digits = false;
  for (const char c : text + ",") {
    if (c >= '0' && c <= '9' && value < std::numeric_limits<size_t>::max() / 100) {
      value = 10 * value + static_cast<size_t>(c - '0');
      digits = true;
    } else if (c == ',' && digits) {
      out.push_back(value);
      value = 0;
      digits = false;
    }
  }
  return out;
}

template <class T>
double as_double(const char* bytes) {
  T value;
  std::memcpy(&value, bytes, sizeof value);
  return static_cast<double>(value);
}

struct NumberType {
  const char* name;
  size_t bytes;
  double (*read)(const char*);
};
constexpr NumberType kNumberTypes[] = {{"<f8", 8, as_double<double>},
                                       {"<f4", 4, as_double<float>},
                                       {"<i8", 8, as_double<std::int64_t>},
                                       {"<i4", 4, as_double<std::int32_t>}};

struct NumpyHead {
  const NumberType* type = nullptr;
  bool columns_first = false;  // Fortran's order
  std::vector<size_t> shape;
  size_t data = 0;  // where the numbers begin
};

NumpyHead numpy_head(const std::string& bytes, const std::string& path) {
  const auto byte = [&](size_t i) { return static_cast<unsigned char>(bytes[i]); };
  const bool wide = bytes.size() > kMagicBytes && byte(kMagicBytes) > 1;
  const size_t begin = wide ? 12 : 10;
  if (bytes.size() < begin) throw InputError(path + ": the array of numpy ends in its header");
  size_t length = byte(8) + 256u * byte(9);
  if (wide) length += (static_cast<size_t>(byte(10)) << 16) + (static_cast<size_t>(byte(11)) << 24);
  if (bytes.size() - begin < length)
    throw InputError(path + ": the array of numpy ends in its header");
  const std::string header = bytes.substr(begin, length), type = value_of(header, "descr");
  NumpyHead out;
  for (const NumberType& one : kNumberTypes)
    if (type == one.name) out.type = &one;
  if (!out.type)
    throw InputError(path + ": numbers of the type '" + type +
                     "' cannot be read; valid: <f8, <f4, <i8, <i4 (numpy.save of an array of "
                     "float64)");
  out.columns_first = value_of(header, "fortran_order") == "True";
  out.shape = shape_of(value_of(header, "shape"));
  out.data = begin + length;
  return out;
}

// ------------------------------------------------------------------------------------------------
// lists in YAML and JSON
constexpr const char* kNameLetters =
    "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-";

using Cells = std::vector<std::string>;

bool is_number_node(const Node& node) {
  double ignored = 0;
  return node.kind == Node::Kind::scalar && !node.quoted && read_number(node.text, ignored);
}

bool is_number_list(const Node& node, size_t least) {
  return node.kind == Node::Kind::sequence && node.items.size() >= least &&
         std::all_of(node.items.begin(), node.items.end(), is_number_node);
}

bool is_matrix(const Node& node) {
  return node.kind == Node::Kind::sequence && (node.items.size() == 3 || node.items.size() == 4) &&
         std::all_of(node.items.begin(), node.items.end(), [](const Node& row) {
           return row.items.size() == 4 && is_number_list(row, 4);
         });
}

void flatten(const Node& node, Cells& out) {
  if (is_number_node(node)) out.push_back(node.text);
  for (const Node& item : node.items) flatten(item, out);
}

/// The numbers of members by their names: {x, y, z, w}; empty: one is none.
Cells members_of(const Node* node, const Cells& names) {
  Cells out;
  for (const std::string& name : names) {
    const Node* member = node ? node->find(name) : nullptr;
    if (!member || !is_number_node(*member)) return {};
    out.push_back(member->text);
  }
  return out;
}

class Lists {
 public:
  explicit Lists(const std::string& path) : path_(path) {}

  void collect(const Node& node, const std::string& keys) {
    if (is_matrix(node) || is_number_list(node, 3)) {
      Cells cells;
      flatten(node, cells);
      return add(keys, node.line, {}, std::move(cells));
    }
    for (const Node& item : node.items) collect(item, keys);
    if (node.kind != Node::Kind::mapping || array(node, keys) || transform(node, keys) ||
        numbers(node, keys))
      return;
    for (const auto& [key, member] : node.members)
      collect(member, keys.empty() ? key : keys + "." + key);
  }

  /// The tables with rows of poses, or if there is none, all.
  std::vector<Table> tables() {
    const auto is_pose = [](const Table& table) { return table.columns() >= 6; };
    const bool poses = std::any_of(tables_.begin(), tables_.end(), is_pose);
    std::vector<Table> out;
    for (Table& table : tables_)
      if (!poses || is_pose(table)) out.push_back(std::move(table));
    return out;
  }

 private:
  /// rows, cols and data of OpenCV and ViSP: a pose, or a row of numbers for each row.
  bool array(const Node& node, const std::string& keys) {
    const Node *rows = node.find("rows"), *columns = node.find("cols"), *data = node.find("data");
    double high = 0, wide = 0;
    if (!rows || !columns || !data || !read_number(rows->text, high) ||
        !read_number(columns->text, wide))
      return false;
    Cells all;
    flatten(*data, all);
    if (high < 1 || wide < 1 || static_cast<double>(all.size()) != high * wide)
      throw InputError(path_ + ":" + std::to_string(node.line) + ": " +
                       (keys.empty() ? "data" : keys) + ": rows x cols = " + rows->text + " x " +
                       columns->text + " numbers are expected, there are " +
                       std::to_string(all.size()));
    const bool matrix = wide == 4 && (high == 3 || high == 4);
    const size_t each = matrix || wide == 1 ? all.size() : static_cast<size_t>(wide);
    const bool visp = high == 6 && wide == 1;
    for (size_t i = 0; i < all.size(); i += each)
      add(keys, data->line, {},
          {all.begin() + static_cast<long>(i), all.begin() + static_cast<long>(i + each)});
    if (visp) {
      Table& table = *find(keys);
      table.kind = "a pose of ViSP";
      table.format = "rotvec";
    }
    return true;
  }

  /// A transform or pose of ROS.
  bool transform(const Node& node, const std::string& keys) {
    const Node* position =
        node.find("translation") ? node.find("translation") : node.find("position");
    const Node* rotation = node.find("rotation") ? node.find("rotation") : node.find("orientation");
    Cells cells = members_of(position, {"x", "y", "z"});
    const Cells turn = members_of(rotation, {"x", "y", "z", "w"});
    if (cells.empty() || turn.empty()) return false;
    cells.insert(cells.end(), turn.begin(), turn.end());
    add(keys, node.line, {"x", "y", "z", "qx", "qy", "qz", "qw"}, std::move(cells));
    return true;
  }

  /// A mapping that has numbers only.
  bool numbers(const Node& node, const std::string& keys) {
    if (node.members.size() < 3 ||
        !std::all_of(node.members.begin(), node.members.end(),
                     [](const auto& member) { return is_number_node(member.second); }))
      return false;
    Cells header, cells;
    for (const auto& [key, member] : node.members) {
      header.push_back(key);
      cells.push_back(member.text);
    }
    add(keys, node.line, header, std::move(cells));
    return true;
  }

  std::vector<Table>::iterator find(const std::string& keys) {
    return std::find_if(tables_.begin(), tables_.end(),
                        [&](const Table& one) { return one.name == keys; });
  }

  void add(const std::string& keys, int line, const Cells& header, Cells cells) {
    auto table = find(keys);
    if (table == tables_.end()) {
      table = tables_.insert(tables_.end(), Table());
      table->path = path_;
      table->kind = keys.empty() ? "a list of numbers" : "a list of numbers, " + keys;
      table->name = keys;
      table->header = header;
      if (keys.find("FloatMatrix") != std::string::npos) {  // of Zivid, whose unit is mm
        table->kind = "a matrix of Zivid, in mm";
        table->length = 0.001;
      }
    }
    const std::string where = path_ + ":" + std::to_string(line);
    if (table->header != header || (!table->rows.empty() && cells.size() != table->columns()))
      throw InputError(where + ": " + keys + ": " + std::to_string(cells.size()) +
                       " numbers; the first has " + std::to_string(table->columns()) +
                       (table->header == header ? "" : ", or other names"));
    table->rows.push_back({where, std::move(cells)});
  }

  std::string path_;
  std::vector<Table> tables_;
};

}  // namespace

bool is_numpy(const std::string& bytes) { return bytes.compare(0, kMagicBytes, kMagic) == 0; }

Table numpy_table(const std::string& bytes, const std::string& path) {
  const NumpyHead head = numpy_head(bytes, path);
  const std::vector<size_t>& shape = head.shape;
  const auto is_transform = [&](size_t i) {
    return (shape[i] == 3 || shape[i] == 4) && shape[i + 1] == 4;
  };
  const bool one_matrix = shape.size() == 2 && is_transform(0),
             matrices = shape.size() == 3 && is_transform(1), rows = shape.size() == 2,
             one_row = shape.size() == 1;
  if (!one_matrix && !matrices && !rows && !one_row)
    throw InputError(path +
                     ": an array of N x n, N x 4 x 4 or N x 3 x 4 numbers is expected, not "
                     "one of " +
                     std::to_string(shape.size()) + " dimensions");
  const size_t each =
      one_matrix || (matrices) ? shape[shape.size() - 2] * shape[shape.size() - 1] : shape.back();
  const size_t count = one_matrix || one_row ? 1 : shape[0];
  const size_t present = (bytes.size() - head.data) / head.type->bytes;
  if (each == 0 || count > present / each)
    throw InputError(path + ": the array of numpy has " + std::to_string(present) +
                     " numbers, fewer than its shape");
  Table out;
  out.path = path;
  out.kind = "an array of numpy";
  const size_t high = one_matrix || matrices ? shape[shape.size() - 2] : 1, wide = each / high;
  for (size_t i = 0; i < count; ++i) {
    TableRow row{path + ": row " + std::to_string(i + 1), {}};
    for (size_t r = 0; r < high; ++r)
      for (size_t c = 0; c < wide; ++c) {
        const size_t at = head.columns_first ? i + count * (r + high * c) : i * each + r * wide + c;
        row.cells.push_back(shortest(head.type->read(&bytes[head.data + at * head.type->bytes])));
      }
    out.rows.push_back(std::move(row));
  }
  return out;
}

bool has_number_lists(const std::string& text, const std::string& path) {
  const std::string ending = lower_case(std::filesystem::path(path).extension().string());
  for (const char* known : {".yaml", ".yml", ".json", ".xml"})
    if (ending == known) return true;
  const size_t begin = text.find_first_not_of(" \t\r\n");
  if (begin == std::string::npos) return false;
  const std::string line = text.substr(begin, text.find('\n', begin) - begin);
  const size_t key = line.find_first_not_of(kNameLetters);  // a: or "a": of YAML
  return line[0] == '[' || line.compare(0, 2, "- ") == 0 || line.compare(0, 3, "---") == 0 ||
         line.compare(0, 5, "%YAML") == 0 ||
         (line[0] == '{' &&
          text.find_first_not_of(" \t\r\n", begin + 1) == text.find('"', begin)) ||
         (key != std::string::npos && key > 0 && line[key] == ':' &&
          (key + 1 == line.size() || line[key + 1] == ' ' || line[key + 1] == '\r'));
}

std::vector<Table> list_tables(const std::string& path) {
  Lists lists(path);
  lists.collect(read_any_tree(path), "");
  return lists.tables();
}

}  // namespace kincal
