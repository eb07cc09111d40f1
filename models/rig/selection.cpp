#include "selection.h"

#include <fnmatch.h>

#include <algorithm>
#include <iterator>
#include <map>

#include "geometry.h"
#include "numbers.h"

namespace kincal {
namespace {

const std::string kGeometry = "geometry/";

/// Whether a text begins with the first n letters of another. The last of them, in which names
/// mostly differ, is compared first.
bool begins_with(const std::string& text, const std::string& other, size_t n) {
  return n == 0 ||
         (text.size() >= n && text[n - 1] == other[n - 1] &&
          std::equal(other.begin(), other.begin() + static_cast<std::ptrdiff_t>(n), text.begin()));
}

}  // namespace

bool glob_matches(const std::string& glob, const std::string& name) {
  return fnmatch(glob.c_str(), name.c_str(), FNM_NOESCAPE) == 0;
}

std::vector<Freed> ParameterTable::select_exact(const std::string& name) const {
  std::vector<Freed> out;
  for (size_t p = 0; p < all.size(); ++p) {
    const std::string& own = all[p].name;
    if (all[p].replaced_by >= 0 || all[p].hidden() || !begins_with(name, own, own.size()))
      continue;  // component names begin with the parameter's
    const bool whole = name.size() == own.size();
    Freed freed{static_cast<int>(p), {}};
    for (int c = 0; c < all[p].size(); ++c)
      if (whole || name == all[p].component_name(c)) freed.components.push_back(c);
    if (!freed.components.empty()) out.push_back(std::move(freed));
  }
  return out;
}

std::vector<Freed> ParameterTable::select_geometry(const std::string& pattern,
                                                   const std::string& where) const {
  // Names of links may hold dots: the first pair of dots with a link on both sides, else the first
  // one.
  int links[2] = {-1, -1};
  size_t dots = std::string::npos;
  for (size_t at = pattern.find("..", kGeometry.size()); at != std::string::npos;
       at = pattern.find("..", at + 1)) {
    const int base = tree_.find_link(pattern.substr(kGeometry.size(), at - kGeometry.size())),
              tip = tree_.find_link(pattern.substr(at + 2));
    if (dots == std::string::npos || (base >= 0 && tip >= 0))
      dots = at, links[0] = base, links[1] = tip;
    if (base >= 0 && tip >= 0) break;
  }
  if (dots == std::string::npos)
    throw std::invalid_argument(
        where + ": '" + pattern +
        "': geometry/BASE..TIP is expected, two links with two dots between");
  const std::string names[2] = {pattern.substr(kGeometry.size(), dots - kGeometry.size()),
                                pattern.substr(dots + 2)};
  for (int end = 0; end < 2; ++end)
    if (links[end] < 0) throw NameError::link(where, pattern, names[end], tree_.links);
  std::vector<Freed> out;
  std::vector<OriginComponents> found;
  try {
    found = independent_geometry(tree_, {{links[0], links[1]}}, has_pose_);
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(where + ": '" + pattern + "': " + error.what());
  }
  for (OriginComponents& o : found) out.push_back({joint_origin[o.joint], std::move(o.components)});
  if (out.empty())
    throw std::invalid_argument(
        where + ": '" + pattern +
        "' has no number of its own: fewer than two joints move between these links, " +
        "and the poses at its ends determine the rest");
  return out;
}

std::vector<Freed> ParameterTable::find(const std::string& pattern,
                                        const std::string& where) const {
  if (pattern.rfind(kGeometry, 0) == 0) return select_geometry(pattern, where);
  std::vector<Freed> out = select(pattern);
  for (const Parameter& p : all)
    if (out.empty() && p.replaced_by >= 0 &&
        (pattern == p.name || pattern.rfind(p.name + ".", 0) == 0 || glob_matches(pattern, p.name)))
      throw std::invalid_argument(where + ": '" + pattern + "': the rig calibrates " +
                                  all[p.replaced_by].name + " in place of " + p.name +
                                  ", which stays as it is");
  if (out.empty()) throw NameError(where, pattern, names());
  return out;
}

std::vector<Freed> ParameterTable::select(const std::string& pattern) const {
  if (pattern.rfind(kGeometry, 0) == 0) {
    try {
      return select_geometry(pattern, "");
    } catch (const std::invalid_argument&) {
      return {};
    }
  }
  std::vector<Freed> out = select_exact(pattern);
  const size_t head = pattern.find_first_of("*?["), tail = pattern.find_last_of("*?[]") + 1;
  if (!out.empty() || head == std::string::npos) return out;
  // What stands before the first and behind the last special character is taken by the letter, and
  // quick to compare; the last letter first.
  const size_t behind = pattern.size() - tail;
  const auto ends_alike = [&](const std::string& name) {
    return !name.empty() && (behind == 0 || name.back() == pattern.back());
  };
  const auto matches = [&](const std::string& name) {
    return ends_alike(name) && name.size() >= behind &&
           name.compare(name.size() - behind, behind, pattern, tail) == 0 &&
           glob_matches(pattern, name);
  };
  std::string component;
  for (size_t p = 0; p < all.size(); ++p) {
    const std::string& name = all[p].name;
    const size_t common = std::min(head, name.size());
    if (all[p].replaced_by >= 0 || all[p].hidden() || !begins_with(pattern, name, common))
      continue;  // neither this name nor those of its components
    const bool whole = matches(name);
    Freed freed{static_cast<int>(p), {}};
    for (int c = 0; c < all[p].size(); ++c) {
      const std::string& part = all[p].components[c];  // empty: its name is the parameter's
      bool found = whole;
      if (!whole && ends_alike(part)) {
        component.assign(name).append(".").append(part);
        found = matches(component);
      }
      if (found) freed.components.push_back(c);
    }
    if (!freed.components.empty()) out.push_back(std::move(freed));
  }
  return out;
}

std::vector<std::string> ParameterTable::names() const {
  std::vector<std::string> out;
  for (const Parameter& p : all) {
    if (p.replaced_by >= 0 || p.hidden()) continue;
    out.push_back(p.name);
    for (int c = 0; c < p.size(); ++c)
      if (!p.components[c].empty()) out.push_back(p.component_name(c));
  }
  return out;
}

void merge(std::vector<Freed>& into, const std::vector<Freed>& more) {
  for (const Freed& f : more) {
    const auto same = std::find_if(into.begin(), into.end(),
                                   [&](const Freed& g) { return g.parameter == f.parameter; });
    if (same == into.end()) {
      into.push_back(f);
      continue;
    }
    std::vector<int> both;
    std::set_union(same->components.begin(), same->components.end(), f.components.begin(),
                   f.components.end(), std::back_inserter(both));
    same->components = both;
  }
}

const Freed* find_freed(const std::vector<Freed>& free, int parameter) {
  for (const Freed& f : free)
    if (f.parameter == parameter) return &f;
  return nullptr;
}

Freed whole(const ParameterTable& table, int parameter) {
  return {parameter, indices(table.all[parameter].components.size())};
}

bool is_given(const Rig& rig, const Parameter& p) {
  return p.kind == ParameterKind::sensor_pose   ? rig.sensors[p.owner].pose_given
         : p.kind == ParameterKind::target_pose ? rig.targets[p.owner].pose_given
                                                : true;
}

std::vector<int> open_poses(const Rig& rig, const ParameterTable& table) {
  const auto is_given = [](const auto& x) { return x.pose_given; };
  if (std::all_of(rig.sensors.begin(), rig.sensors.end(), is_given) &&
      std::all_of(rig.targets.begin(), rig.targets.end(), is_given))
    return {};  // as most rigs, whose globs need not be looked at
  std::vector<char> freed(table.all.size(), rig.steps.empty()), prior(table.all.size(), 0);
  for (const Step& step : rig.steps) {
    for (const std::string& pattern : step.free)
      for (const Freed& f : table.select(pattern))
        if (f.whole(table.all[f.parameter])) freed[f.parameter] = 1;
    for (const PriorSetting& setting : step.priors)
      for (const Freed& f : table.select(setting.pattern)) prior[f.parameter] = 1;
  }
  std::vector<int> out;
  const auto add = [&](int p, bool given) {
    if (p >= 0 && !given && freed[p] && !prior[p] && table.all[p].replaced_by < 0) out.push_back(p);
  };
  for (size_t s = 0; s < rig.sensors.size(); ++s)
    add(table.sensor_pose[s], rig.sensors[s].pose_given);
  for (size_t t = 0; t < rig.targets.size(); ++t)
    if (rig.targets[t].link >= 0) add(table.target_pose[t], rig.targets[t].pose_given);
  return out;
}

void clear_steps(Rig& rig) {
  const ParameterTable table(rig);
  const std::vector<int> open = open_poses(rig, table);
  const auto held = [&](int p) { return std::find(open.begin(), open.end(), p) == open.end(); };
  for (size_t s = 0; s < rig.sensors.size(); ++s)
    if (held(table.sensor_pose[s])) rig.sensors[s].pose_given = true;
  for (size_t t = 0; t < rig.targets.size(); ++t)
    if (held(table.target_pose[t])) rig.targets[t].pose_given = true;
  rig.steps.clear();
}

std::vector<Component> components_of(const std::vector<Freed>& free) {
  std::vector<Component> out;
  for (const Freed& f : free)
    for (int c : f.components) out.push_back({f.parameter, c});
  return out;
}

VectorXd changed_values(const ParameterTable& table, VectorXd values,
                        const std::vector<Component>& components, const VectorXd& by) {
  std::map<int, Vector6d> poses;
  for (size_t i = 0; i < components.size(); ++i) {
    const Component& c = components[i];
    const double change = by(static_cast<Eigen::Index>(i));
    if (table.all[c.parameter].pose)
      poses.emplace(c.parameter, Vector6d::Zero()).first->second(c.index) += change;
    else
      values(table.all[c.parameter].start + c.index) += change;
  }
  for (const auto& [p, increment] : poses)
    set_pose(values, table.all[p].start, get_pose(values, table.all[p].start) * exp_se3(increment));
  return values;
}

}  // namespace kincal
