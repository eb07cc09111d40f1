#include "comparison.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>

#include "../../models/rig/numbers.h"
#include "../../models/rig/selection.h"
#include "../document/files.h"
#include "../document/json.h"
#include "../document/names.h"
#include "../document/numbers.h"
#include "../rig/samples_file.h"
#include "../rig/simulation_file.h"
#include "json_values.h"

namespace kincal {
namespace {

constexpr double kEqual =
    1e-9;  // written numbers carry 17 digits; angles go through roll, pitch, yaw
constexpr int kPostures = 1000;
constexpr std::uint64_t kSeed = 1;

std::string motion_of(const Joint& j) {
  return std::string(type_name(j.type)) +
         (j.has_axis() ? " about or along " + shortest(j.axis) : "");
}

/// Links, joints, their topology and their motions must be the same; origins may differ.
void check_same_robot(const CalibratedFiles& a, const CalibratedFiles& b) {
  const Tree &s = a.rig_file.urdf.tree, &t = b.rig_file.urdf.tree;
  const auto refuse = [&](const std::string& why) {
    throw InputError(a.path + " and " + b.path + " are calibrations of different robots: " + why);
  };
  const auto only = [&](const std::string& kind, const std::set<std::string>& in_s,
                        const std::set<std::string>& in_t, const CalibratedFiles& f) {
    for (const std::string& name : in_s)
      if (!in_t.count(name)) refuse(kind + " '" + name + "' is only in " + f.rig_file.urdf.path);
  };
  const auto joints = [](const Tree& tree) {
    std::set<std::string> out;
    for (const Joint& j : tree.joints) out.insert(j.name);
    return out;
  };
  const std::set<std::string> links_s(s.links.begin(), s.links.end()),
      links_t(t.links.begin(), t.links.end());
  only("link", links_s, links_t, a);
  only("link", links_t, links_s, b);
  only("joint", joints(s), joints(t), a);
  only("joint", joints(t), joints(s), b);
  for (const Joint& j : s.joints) {
    const Joint& k = t.joints[t.find_joint(j.name)];
    if (s.links[j.parent] != t.links[k.parent] || s.links[j.child] != t.links[k.child])
      refuse("joint '" + j.name + "' is between '" + s.links[j.parent] + "' and '" +
             s.links[j.child] + "' in one, between '" + t.links[k.parent] + "' and '" +
             t.links[k.child] + "' in the other");
    if (j.type != k.type || (j.has_axis() && (j.axis - k.axis).norm() > kEqual))
      refuse("joint '" + j.name + "' is " + motion_of(j) + " in one, " + motion_of(k) +
             " in the other");
    const bool mimics =
        j.mimic && k.mimic && s.joints[j.mimic->master].name == t.joints[k.mimic->master].name &&
        j.mimic->multiplier == k.mimic->multiplier && j.mimic->offset == k.mimic->offset;
    if ((j.mimic || k.mimic) && !mimics)
      refuse("joint '" + j.name + "' does not follow the same joint in the same way");
  }
  if (s.links[a.rig_file.rig.base] != t.links[b.rig_file.rig.base])
    throw InputError(a.path + " has the base " + s.links[a.rig_file.rig.base] + ", " + b.path +
                     " has " + t.links[b.rig_file.rig.base] +
                     ": frames can be compared relative to the same base only");
}

std::vector<double> xyz_rpy(const Pose& p) {
  const Vector3d rpy = rpy_from_rotation(p.rotation);
  return {p.translation.x(), p.translation.y(), p.translation.z(), rpy.x(), rpy.y(), rpy.z()};
}

/// How well a number is known that was held for want of evidence: what predictions count; 0: exact.
double held_sigma(const CalibratedFiles& files, int parameter, int component) {
  if (!files.unknowns) return 0;
  const std::vector<Component>& columns = files.unknowns->columns;
  for (size_t i = 0; i < columns.size(); ++i)
    if (const auto k = static_cast<Eigen::Index>(i);
        columns[i].parameter == parameter && columns[i].index == component)
      return std::sqrt(std::max(0.0, files.unknowns->covariance(k, k)));
  return 0;
}

/// The difference of parameter p of a and q of b; nullopt: the same and freed in neither.
std::optional<ParameterDifference> parameter_difference(const CalibratedFiles& a,
                                                        const CalibratedFiles& b, int p, int q) {
  const Parameter &in_a = a.table.all[p], &in_b = b.table.all[q];
  ParameterDifference out;
  out.name = in_a.name;
  out.components = in_a.components;
  out.units = in_a.units;
  out.pose = in_a.pose;
  double largest = 0;
  if (in_a.pose) {
    const Pose x = get_pose(a.values, in_a.start), y = get_pose(b.values, in_b.start),
               e = inverse(x) * y;
    out.a = xyz_rpy(x);
    out.b = xyz_rpy(y);
    const Vector3d turned = log_so3(e.rotation);
    for (const Vector3d& part : {e.translation, turned})
      for (int i = 0; i < 3; ++i) out.difference.push_back(part(i));
    largest = std::max(e.translation.norm(), turned.norm()) / kEqual;
  } else {
    for (int c = 0; c < in_a.size(); ++c) {
      out.a.push_back(a.values(in_a.start + c));
      out.b.push_back(b.values(in_b.start + c));
      out.difference.push_back(out.b[c] - out.a[c]);
      largest = std::max(largest,
                         std::abs(out.difference[c]) / (1e-12 * std::max(1.0, std::abs(out.a[c]))));
    }
  }
  const auto of_a = a.sigma.find(in_a.name), of_b = b.sigma.find(in_b.name);
  if (of_a == a.sigma.end() && of_b == b.sigma.end() && largest <= 1) return std::nullopt;
  for (int c = 0; c < in_a.size(); ++c) {
    double s = of_a == a.sigma.end() ? 0 : of_a->second[c],
           t = of_b == b.sigma.end() ? 0 : of_b->second[c];
    if (s == 0 && t > 0) s = held_sigma(a, p, c);
    if (t == 0 && (s > 0 || a.exact)) t = held_sigma(b, q, c);
    out.undetermined.push_back(std::isnan(s) || std::isnan(t));
    const double both = a.status.empty() || b.status.empty() ? kNan : std::hypot(s, t);
    out.sigma.push_back(both > 0 ? both : kNan);
  }
  return out;
}

/// Poses that a rig leaves open and no result gives: there is nothing to compare.
std::set<int> open_in(const CalibratedFiles& files) {
  std::set<int> out;
  for (const int p : open_poses(files.rig_file.rig, files.table))
    if (!files.sigma.count(files.table.all[p].name)) out.insert(p);
  return out;
}

/// The frames to compare that names say; @throws InputError where one's own pose is open.
std::vector<std::pair<Frame, Frame>> named_frames(const CalibratedFiles& a,
                                                  const CalibratedFiles& b,
                                                  const std::vector<std::string>& names) {
  std::vector<std::pair<Frame, Frame>> out;
  const std::set<int> open_a = open_in(a), open_b = open_in(b);
  for (const std::string& name : names) {
    out.push_back({frame_named(a.rig_file.rig, a.table, name, "--frame"),
                   frame_named(b.rig_file.rig, b.table, name, "--frame: " + b.path)});
    for (const CalibratedFiles* f : {&a, &b})
      if (f == &a ? open_a.count(out.back().first.pose) : open_b.count(out.back().second.pose))
        throw InputError("--frame: " + f->path + " leaves the pose of " + name +
                         " open: there is nothing to compare");
  }
  return out;
}

/// What carries a sensor or mounted target, and these.
std::vector<std::pair<Frame, Frame>> usual_frames(const CalibratedFiles& a,
                                                  const CalibratedFiles& b) {
  std::vector<std::pair<Frame, Frame>> out;
  const Rig& rig = a.rig_file.rig;
  const std::set<int> open_a = open_in(a), open_b = open_in(b);
  std::set<int> carrying;
  for (const Sensor& s : rig.sensors) carrying.insert(s.link);
  for (const Target& t : rig.targets)
    if (t.link >= 0) carrying.insert(t.link);
  for (const Frame& f : all_frames(rig, a.table)) {
    const std::optional<Frame> g = find_frame(b.rig_file.rig, b.table, f.name);
    if (!g || (f.pose < 0 && (!carrying.count(f.link) || f.link == rig.base))) continue;
    if (open_a.count(f.pose) || open_b.count(g->pose)) continue;
    const auto identity = [](const Pose& p) {
      return p.translation.norm() == 0 && p.rotation == Matrix3d::Identity();
    };
    if (f.pose >= 0 && identity(get_pose(a.values, a.table.all[f.pose].start)) &&
        identity(get_pose(b.values, b.table.all[g->pose].start)))
      continue;  // the link itself
    out.push_back({f, *g});
  }
  return out;
}

Json statistics(double rms, double worst, double sigma) {
  return {{"rms", number(rms)},
          {"worst", number(worst)},
          {"sigma", number(sigma)},
          {"in_sigmas", number(rms / sigma)}};
}

}  // namespace

Frame frame_named(const Rig& rig, const ParameterTable& table, const std::string& name,
                  const std::string& where) {
  if (const std::optional<Frame> found = find_frame(rig, table, name)) return *found;
  std::vector<std::string> names;
  for (const Frame& f : all_frames(rig, table)) names.push_back(f.name);
  throw InputError(where + ": there is no frame '" + name + "' connected to the base " +
                   rig.tree.links[rig.base] +
                   " (a link, sensor/NAME, or target/NAME of a mounted one)" +
                   nearest_names(name, names));
}

Comparison compare(const CalibratedFiles& a, const CalibratedFiles& b,
                   const std::vector<std::string>& names, const std::string& samples) {
  check_same_robot(a, b);
  const Rig &rig = a.rig_file.rig, &other = b.rig_file.rig;
  Comparison out;
  out.base = rig.tree.links[rig.base];
  out.errors = a.exact;
  const std::set<int> open_a = open_in(a), open_b = open_in(b);
  for (const int p : open_a) out.open_in_a.push_back(a.table.all[p].name);
  for (const int p : open_b) out.open_in_b.push_back(b.table.all[p].name);
  for (size_t p = 0; p < a.table.all.size(); ++p) {
    if (a.table.all[p].hidden()) continue;
    const int q = find_parameter(b.table, a.table.all[p].name);
    if (open_a.count(static_cast<int>(p)) || open_b.count(q)) continue;
    if (q < 0 || b.table.all[q].size() != a.table.all[p].size() ||
        b.table.all[q].pose != a.table.all[p].pose) {
      out.only_in_a.push_back(a.table.all[p].name);
      continue;
    }
    if (auto difference = parameter_difference(a, b, static_cast<int>(p), q))
      out.parameters.push_back(std::move(*difference));
  }
  for (const Parameter& p : b.table.all) {
    if (p.hidden()) continue;
    const int q = find_parameter(a.table, p.name);
    if (q < 0 || a.table.all[q].size() != p.size() || a.table.all[q].pose != p.pose)
      out.only_in_b.push_back(p.name);
  }

  const std::vector<std::pair<Frame, Frame>> frames =
      names.empty() ? usual_frames(a, b) : named_frames(a, b, names);
  std::vector<Readings> postures;
  out.workspace = samples.empty() ? "limits" : "samples";
  if (samples.empty()) {
    postures = random_postures(rig, kPostures, kSeed);
  } else {
    for (const Sample& s : read_samples(samples, rig)) postures.push_back(s.readings);
  }
  std::vector<Readings> in_b;  // by b's joint indices
  for (const Readings& r : postures) {
    in_b.emplace_back(other.tree.joints.size(), kNan);
    for (size_t j = 0; j < r.size(); ++j)
      in_b.back()[other.tree.find_joint(rig.tree.joints[j].name)] = r[j];
  }
  for (const auto& f : frames)
    out.frames.push_back(compare_frame(a.robot(), b.robot(), f.first, f.second, postures, in_b));

  out.sigmas = a.unknowns && b.unknowns;
  for (const CalibratedFiles* f : {&a, &b}) {
    if (f->status.empty())
      out.notes.push_back(f->path +
                          " has no result.json: it has no sigmas, and joint offsets folded into "
                          "its robot cannot be distinguished from origins");
    else if (f->status != "converged")
      out.notes.push_back(f->path + ": status " + f->status);
  }
  return out;
}

bool is_truth_file(const std::string& path) {
  if (path.size() < 5 || path.substr(path.size() - 5) != ".json" || !file_exists(path))
    return false;
  const Node node = parse_json(read_file(path), path);
  const Field all = top(node, path);
  return node.kind == Node::Kind::mapping && all.has("parameters") && !all.has("status");
}

CalibratedFiles read_true_values(const std::string& path, const CalibratedFiles& result) {
  CalibratedFiles out = result;
  out.path = path;
  out.table.initial = result.nominal.size() > 0 ? result.nominal : result.values;
  std::vector<int> all(out.table.all.size());
  std::iota(all.begin(), all.end(), 0);
  out.values = parse_truth(read_file(path), path, out.table, all);
  out.sigma.clear();
  out.doubts.clear();
  out.status = "converged";
  out.unknowns = Unknowns();  // none: everything is exact
  out.exact = true;
  return out;
}

ErrorsInSigmas errors_in_sigmas(const CalibratedFiles& b, const Comparison& comparison,
                                bool estimated) {
  ErrorsInSigmas out;
  for (const ParameterDifference& d : comparison.parameters) {
    const auto of_b = b.sigma.find(d.name);
    for (size_t c = 0; c < d.difference.size(); ++c) {
      const double in_sigmas = std::abs(d.difference[c] / d.sigma[c]);
      if (!std::isfinite(in_sigmas) || (of_b != b.sigma.end() && of_b->second[c] > 0) != estimated)
        continue;
      ++out.components;
      out.rms += in_sigmas * in_sigmas;
      out.worst = std::max(out.worst, in_sigmas);
    }
  }
  out.rms = std::sqrt(out.rms / std::max(1, out.components));
  return out;
}

std::string comparison_json(const CalibratedFiles& a, const CalibratedFiles& b,
                            const Comparison& comparison) {
  Json json;
  json["a"] = a.path;
  json["b"] = b.path;
  json["base"] = comparison.base;
  json["parameters"] = Json::object();
  for (const ParameterDifference& d : comparison.parameters) {
    std::vector<double> in_sigmas;
    for (size_t c = 0; c < d.difference.size(); ++c)
      in_sigmas.push_back(d.difference[c] / d.sigma[c]);
    json["parameters"][d.name] = {
        {"unit", d.units},           {"a", numbers(d.a)},
        {"b", numbers(d.b)},         {"difference", numbers(d.difference)},
        {"sigma", numbers(d.sigma)}, {"in_sigmas", numbers(in_sigmas)}};
  }
  if (comparison.errors)
    for (const bool estimated : {true, false}) {
      const ErrorsInSigmas e = errors_in_sigmas(b, comparison, estimated);
      json["errors"][estimated ? "estimated" : "held"] = {{"components", e.components},
                                                          {"rms_in_sigmas", number(e.rms)},
                                                          {"worst", number(e.worst)}};
    }
  json["workspace"] = comparison.workspace;
  json["frames"] = Json::object();
  for (const FrameDifference& f : comparison.frames)
    json["frames"][f.frame] = {
        {"postures", f.postures},
        {"position", statistics(f.position_rms, f.position_worst, f.position_sigma)},
        {"rotation", statistics(f.rotation_rms, f.rotation_worst, f.rotation_sigma)}};
  json["only_in_a"] = comparison.only_in_a;
  json["only_in_b"] = comparison.only_in_b;
  json["open_in_a"] = comparison.open_in_a;
  json["open_in_b"] = comparison.open_in_b;
  json["notes"] = comparison.notes;
  return json_text(json);
}

}  // namespace kincal
