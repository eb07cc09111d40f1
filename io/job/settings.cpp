#include "settings.h"

#include <algorithm>

#include "../document/json.h"
#include "../document/names.h"

namespace kincal {
namespace {

using S = CalibrateSettings;

const std::vector<Setting>& all_settings() {
  static const std::vector<Setting> settings = {
      {"noise", "a text", &S::noise},
      {"step", "a text", &S::step},
      {"linear_solver", "a text", &S::linear_solver},
      {"free", "a list of names", &S::free},
      {"fix", "a list of names", &S::fix},
      {"group", "a list of names", &S::groups},
      {"no_group", "a list of names", &S::no_groups},
      {"report_frame", "a list of names", &S::report_frames},
      {"require", "a list of texts", &S::require},
      {"iterations", "an integer", &S::iterations},
      {"threads", "an integer", &S::threads},
      {"restarts", "an integer", &S::restarts},
      {"holdout", "an integer", &S::holdout},
      {"cross_validate", "an integer", &S::cross_validate},
      {"reject", "true or false", &S::reject},
      {"estimate_noise", "true or false", &S::estimate_noise},
      {"no_report", "true or false", &S::no_report},
      {"write_reduction", "true or false", &S::write_reduction}};
  return settings;
}

bool is_text(const Node& node) { return node.kind == Node::Kind::scalar && node.quoted; }

/// Sets a field from a JSON value; false: the value is of another kind.
struct Take {
  S& to;
  const Field& value;

  bool operator()(std::string S::*field) const {
    if (!is_text(*value.node)) return false;
    to.*field = value.node->text;
    return true;
  }
  bool operator()(std::vector<std::string> S::*field) const {
    if (is_text(*value.node)) {
      to.*field = {value.node->text};
      return true;
    }
    const std::vector<Node>& items = value.node->items;
    if (value.node->kind != Node::Kind::sequence || !value.node->numbers.empty() ||
        !std::all_of(items.begin(), items.end(), is_text))
      return false;
    for (const Node& item : items) (to.*field).push_back(item.text);
    return true;
  }
  bool operator()(int S::*field) const {
    const Node& node = *value.node;
    if (node.kind != Node::Kind::scalar || node.quoted || node.text.empty() ||
        node.text.find_first_not_of("+-0123456789") != std::string::npos)
      return false;
    to.*field = value.integer(-1'000'000'000, 1'000'000'000);
    return true;
  }
  bool operator()(bool S::*field) const {
    const Node& node = *value.node;
    if (node.kind != Node::Kind::scalar || node.quoted ||
        (node.text != "true" && node.text != "false"))
      return false;
    to.*field = node.text == "true";
    return true;
  }
};

}  // namespace

const Setting& find_setting(const std::string& name, const std::vector<std::string>& names) {
  std::vector<std::string> valid = names;
  if (names.empty())
    for (const Setting& one : all_settings()) valid.emplace_back(one.name);
  if (std::find(valid.begin(), valid.end(), name) == valid.end())
    throw InputError(name + ": there is no such option" + nearest_or_all(name, valid, "there are"));
  return *std::find_if(all_settings().begin(), all_settings().end(),
                       [&](const Setting& one) { return name == one.name; });
}

CalibrateSettings parse_settings(const std::string& json, const std::vector<std::string>& names) {
  const std::string path = "settings";
  const Node node = parse_json(json, path);
  const Field all = top(node, path);
  CalibrateSettings out;
  out.words = Words::keywords;
  if (node.kind != Node::Kind::mapping)
    all.fail("a mapping of options to values is expected, e.g. {\"noise\": \"latent\"}");
  for (const auto& [name, value] : node.members) {
    const Setting& setting = find_setting(name, names);
    const Field field{&value, &path, name};
    if (!std::visit(Take{out, field}, setting.field))
      throw InputError(name + ": " + setting.expected + " is expected");
  }
  check_settings(out);
  return out;
}

}  // namespace kincal
