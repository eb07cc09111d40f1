#include "document.h"

#include <algorithm>
#include <charconv>
#include <cmath>

#include "error.h"
#include "names.h"
#include "numbers.h"

namespace kincal {
namespace {

std::string shortened(const std::string& text) {
  return text.size() <= 60 ? text : text.substr(0, 57) + "...";
}

/// What stands there, for messages: 'abc', 'abc' (a string), a list, a mapping, nothing.
std::string describe(const Node& node) {
  switch (node.kind) {
    case Node::Kind::null:
      return "nothing";
    case Node::Kind::sequence:
      return "a list";
    case Node::Kind::mapping:
      return "a mapping";
    default:
      return "'" + shortened(node.text) + "'" + (node.quoted ? " (a string)" : "");
  }
}

}  // namespace

Field top(const Node& node, const std::string& path) { return {&node, &path, ""}; }

std::string Field::where() const {
  return *path + (node->line > 0 ? ":" + std::to_string(node->line) : "") +
         (name.empty() ? "" : ": " + name);
}

void Field::fail(const std::string& what) const { throw InputError(where() + ": " + what); }

bool Field::has(const std::string& key) const { return node->find(key) != nullptr; }

Field Field::operator[](const std::string& key) const {
  const Node* member = node->find(key);
  if (!member) fail("key '" + key + "' is missing");
  return {member, path, name.empty() ? key : name + "." + key};
}

Field Field::item(size_t i) const {
  if (!node->numbers.empty()) fail("a list of numbers");
  if (i >= node->items.size()) fail("a list of values is expected, not " + describe(*node));
  return {&node->items[i], path, name + "[" + std::to_string(i) + "]"};
}

size_t Field::size() const {
  if (!node->numbers.empty()) return node->numbers.size() / std::max(node->columns, 1);
  return node->kind == Node::Kind::mapping ? node->members.size() : node->items.size();
}

const std::vector<std::pair<std::string, Node>>& Field::members() const {
  if (node->kind != Node::Kind::mapping) fail("a mapping is expected, not " + describe(*node));
  return node->members;
}

void Field::check_keys(const std::vector<std::string>& required,
                       const std::vector<std::string>& optional) const {
  const auto among = [](const std::vector<std::string>& names, const std::string& key) {
    return std::find(names.begin(), names.end(), key) != names.end();
  };
  for (const auto& [key, value] : members())
    if (!among(required, key) && !among(optional, key)) {
      std::vector<std::string> valid = required, missing;
      valid.insert(valid.end(), optional.begin(), optional.end());
      const std::string near = nearest_names(key, valid);
      std::string all;
      for (const std::string& one : valid) all += (all.empty() ? "; valid: " : ", ") + one;
      Field{&value, path, name}.fail("unknown key '" + key + "'" + (near.empty() ? all : near));
    }
  for (const std::string& key : required) (*this)[key];
}

double Field::number() const {
  if (node->kind == Node::Kind::scalar && !node->numbers.empty()) return node->numbers[0];
  double value = 0;
  if (node->kind != Node::Kind::scalar || node->quoted || !read_number(node->text, value))
    fail("a finite number is expected, not " + describe(*node));
  return value;
}

double Field::number_at_least(double low) const {
  const double value = number();
  if (value < low)
    fail("a number of at least " + shortest(low) + " is expected, not " + describe(*node));
  return value;
}

double Field::positive() const {
  const double value = number();
  if (!(value > 0)) fail("a number greater than 0 is expected, not " + describe(*node));
  return value;
}

int Field::integer(int low, int high) const {
  int value = 0;
  const std::string& text = node->text;
  const char *begin = text.data() + (text[0] == '+'), *end = text.data() + text.size();
  const auto [at, error] = std::from_chars(begin, end, value);
  const bool whole = node->kind == Node::Kind::scalar && !node->quoted && error == std::errc() &&
                     at == end && !starts_with_zero({begin, static_cast<size_t>(end - begin)});
  if (!whole || value < low || value > high)
    fail("an integer in " + std::to_string(low) + " .. " + std::to_string(high) +
         " is expected, not " + describe(*node));
  return value;
}

int Field::integer_item(size_t i, int low, int high) const {
  constexpr int kMost =
      99'999;  // up to here a whole number is an integer however it was written: 3, 3.0
  const double value =
      node->columns == 0 && i < node->numbers.size() ? node->numbers[i] : low - 1.0;
  if (value >= low && value <= std::min(high, kMost) && value == static_cast<int>(value))
    return static_cast<int>(value);
  return item(i).integer(low, high);
}

bool Field::boolean() const {
  const bool yes = node->text == "true" || node->text == "True" || node->text == "TRUE";
  const bool no = node->text == "false" || node->text == "False" || node->text == "FALSE";
  if (node->kind != Node::Kind::scalar || node->quoted || (!yes && !no))
    fail("true or false is expected, not " + describe(*node));
  return yes;
}

std::string Field::string() const {
  if (node->kind != Node::Kind::scalar || !node->numbers.empty())
    fail("a text is expected, not " + describe(*node));
  return node->text;
}

std::vector<double> Field::vector(int count) const {
  const bool plain =
      node->kind == Node::Kind::sequence && !node->numbers.empty() && node->columns == 0;
  if (plain && (count < 0 || size() == static_cast<size_t>(count))) return node->numbers;
  if (node->kind != Node::Kind::sequence ||
      (count >= 0 && node->items.size() != static_cast<size_t>(count)))
    fail("a list of " + (count >= 0 ? std::to_string(count) + " " : "") +
         "numbers is expected, not " + describe(*node) +
         (node->kind == Node::Kind::sequence ? " of " + std::to_string(node->items.size()) : ""));
  std::vector<double> values(size());
  for (size_t i = 0; i < values.size(); ++i) values[i] = item(i).number();
  return values;
}

std::vector<double> Field::table(int columns) const {
  if (!node->numbers.empty() && node->columns == columns) return node->numbers;
  if (node->kind != Node::Kind::sequence)
    fail("a list of lists of " + std::to_string(columns) + " numbers is expected, not " +
         describe(*node));
  std::vector<double> values;
  values.reserve(node->items.size() * columns);
  for (size_t i = 0; i < size(); ++i) {
    if (!node->numbers.empty()) item(i);  // fails
    const Node& row = node->items[i];
    if (row.kind != Node::Kind::sequence || row.items.size() != static_cast<size_t>(columns))
      item(i).vector(columns);  // fails
    for (int k = 0; k < columns; ++k) {
      const Node& one = row.items[k];
      double value = 0;
      if (one.kind != Node::Kind::scalar || one.quoted || !read_number(one.text, value))
        item(i).item(k).number();  // fails
      values.push_back(value);
    }
  }
  return values;
}

std::vector<std::string> Field::strings() const {
  if (node->kind != Node::Kind::sequence)
    fail("a list of texts is expected, not " + describe(*node));
  std::vector<std::string> values;
  for (size_t i = 0; i < size(); ++i) values.push_back(item(i).string());
  return values;
}

Pose Field::pose() const {
  static const std::vector<std::string> keys = {"xyz", "rpy", "quat"};
  check_keys({}, keys);
  Pose pose;
  if (has("xyz")) pose.translation = Eigen::Map<const Vector3d>((*this)["xyz"].vector(3).data());
  if (has("rpy") && has("quat")) fail("either rpy or quat, not both");
  if (has("rpy")) {
    const std::vector<double> rpy = (*this)["rpy"].vector(3);
    for (const double angle : rpy)
      if (!(std::abs(angle) < 2 * kPi + 0.1))
        (*this)["rpy"].fail(shortest(angle) +
                            " rad is more than a turn: radians are expected, degrees have to be "
                            "multiplied by pi / 180");
    pose.rotation = rotation_from_rpy(Eigen::Map<const Vector3d>(rpy.data()));
  }
  if (has("quat")) {
    const Field field = (*this)["quat"];
    const std::vector<double> q = field.vector(4);
    const double length = Eigen::Map<const Eigen::Vector4d>(q.data()).norm();
    if (!(std::abs(length - 1) <= 1e-3))
      field.fail("a unit quaternion [x, y, z, w] is expected, this one's length is " +
                 shortest(length));
    pose.rotation = rotation_from_quaternion(Eigen::Map<const Eigen::Vector4d>(q.data()));
  }
  return pose;
}

}  // namespace kincal
