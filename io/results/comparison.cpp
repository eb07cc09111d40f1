#include "comparison.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <set>

#include "result_json.h"

namespace kincal {
namespace {

namespace fs = std::filesystem;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kSame = 1e-9;  // written numbers carry 17 digits; angles go through roll, pitch, yaw
constexpr int kPostures = 1000;
constexpr std::uint64_t kSeed = 1;

/// A list of numbers and nulls.
std::vector<double> numbers_or_null(const Field& field) {
  std::vector<double> out;
  if (!field.node->numbers.empty()) return field.node->numbers;
  for (size_t i = 0; i < field.size(); ++i) {
    const Field item = field.item(i);
    out.push_back(item.node->kind == Node::Kind::null ? kNan : item.number());
  }
  return out;
}

/// Rows of a CSV file as this program writes them.
std::vector<std::vector<std::string>> read_csv(const std::string& path) {
  std::vector<std::vector<std::string>> rows;
  std::vector<std::string> row;
  std::string cell;
  bool quoted = false;
  const std::string text = read_file(path);
  for (size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (quoted) {
      if (c != '"')
        cell += c;
      else if (i + 1 < text.size() && text[i + 1] == '"')
        cell += text[++i];
      else
        quoted = false;
    } else if (c == '"') {
      quoted = true;
    } else if (c == ',' || c == '\n') {
      row.push_back(cell);
      cell.clear();
      if (c == '\n') {
        rows.push_back(row);
        row.clear();
      }
    } else {
      cell += c;
    }
  }
  return rows;
}

double csv_number(const std::string& text, const std::string& path) {
  Node node;
  node.kind = Node::Kind::scalar;
  node.text = text;
  return top(node, path).number();
}

/// (parameter, component) of a name; (-1, -1): there is none.
std::pair<int, int> find_component(const ParameterTable& table, const std::string& name) {
  for (size_t p = 0; p < table.all.size(); ++p)
    for (int c = 0; c < table.all[p].size(); ++c)
      if (table.all[p].component_name(c) == name) return {static_cast<int>(p), c};
  return {-1, -1};
}

int find_parameter(const ParameterTable& table, const std::string& name) {
  for (size_t p = 0; p < table.all.size(); ++p)
    if (table.all[p].name == name) return static_cast<int>(p);
  return -1;
}

/// Offsets and reductions that a result put into its robot, taken out again.
void unfold(const Field& result, CalibratedFiles& out) {
  const Tree& tree = out.rig_file.rig.tree;
  std::vector<double> offsets(tree.joints.size(), 0.0), back(tree.joints.size(), 0.0);
  std::vector<Pose> origins;
  for (const Joint& j : tree.joints) origins.push_back(j.parent_T_joint);
  const Field robot = result["robot"], joints = robot["joints"];
  for (size_t i = 0; i < joints.size(); ++i) {
    const std::string& name = joints.node->members[i].first;
    const int j = tree.find_joint(name);
    const std::vector<double> xyz = joints[name]["new"]["xyz"].vector(3);
    if (j < 0 || (origins[j].translation - Eigen::Map<const Vector3d>(xyz.data())).norm() > kSame)
      throw InputError(joints[name].where() + ": is not that of " + out.rig_file.urdf.path + ": this result.json belongs to another robot");
    offsets[j] = joints[name]["offset"].number();
    back[j] = -offsets[j];
  }
  origins = fold_offsets(tree, origins, back);
  for (size_t j = 0; j < tree.joints.size(); ++j) {
    set_pose(out.values, out.table.all[out.table.joint_origin[j]].start, origins[j]);
    if (out.table.joint_offset[j] >= 0) out.values(out.table.all[out.table.joint_offset[j]].start) += offsets[j];
  }
  const Field reductions = robot["reductions"];
  for (size_t i = 0; i < reductions.size(); ++i) {
    const std::string& name = reductions.node->members[i].first;
    const int j = tree.find_joint(name);
    if (j >= 0 && reductions[name]["written"].boolean())
      out.values(out.table.all[out.table.joint_scale[j]].start) = reductions[name]["scale"].number();
  }
}

/// Unknowns of the last step from covariance.csv and result.json.
Unknowns read_unknowns(const std::string& path, const Field& result, const ParameterTable& table) {
  const std::vector<std::vector<std::string>> rows = read_csv(path);
  if (rows.empty() || rows.size() != rows[0].size() + 1) throw InputError(path + ": as many rows as columns and a header are expected");
  Unknowns out;
  const Eigen::Index n = static_cast<Eigen::Index>(rows[0].size());
  out.covariance.setZero(n, n);
  std::map<std::string, int> column;
  std::map<int, int> components;
  for (Eigen::Index c = 0; c < n; ++c) {
    const std::pair<int, int> found = find_component(table, rows[0][c]);
    if (found.first < 0) throw InputError(path + ":1: '" + rows[0][c] + "' is no parameter of the rig beside it");
    out.columns.push_back(found);
    ++components[found.first];
    column[rows[0][c]] = static_cast<int>(c);
    if (rows[c + 1].size() != rows[0].size())
      throw InputError(path + ":" + std::to_string(c + 2) + ": a number for every name is expected");
    for (Eigen::Index d = 0; d < n; ++d) out.covariance(c, d) = csv_number(rows[c + 1][d], path + ":" + std::to_string(c + 2));
  }
  for (const auto& p : components)
    if (table.all[p.first].pose && p.second < 6) {
      const std::vector<double> xi = numbers_or_null(result["parameters"][table.all[p.first].name]["value"]);
      out.charts[p.first] = right_jacobian_se3(Eigen::Map<const Vector6d>(xi.data()));
    }
  const Field directions = result["unobservable"];
  out.undetermined.setZero(n, static_cast<Eigen::Index>(directions.size()));
  for (size_t k = 0; k < directions.size(); ++k) {
    const Field direction = directions.item(k);
    for (const auto& member : direction.node->members)
      if (column.count(member.first))
        out.undetermined(column[member.first], static_cast<Eigen::Index>(k)) = direction[member.first].number();
  }
  return out;
}

std::string motion_of(const Joint& j) {
  static const char* const types[] = {"fixed", "revolute", "continuous", "prismatic", "floating", "planar"};
  std::string out = types[static_cast<int>(j.type)];
  if (j.moves()) out += " about or along " + shortest(j.axis.x()) + " " + shortest(j.axis.y()) + " " + shortest(j.axis.z());
  return out;
}

/// Links, joints and how they hang together and move must be the same; origins may differ.
void check_same_robot(const CalibratedFiles& a, const CalibratedFiles& b) {
  const Tree &s = a.rig_file.rig.tree, &t = b.rig_file.rig.tree;
  const auto refuse = [&](const std::string& why) {
    throw InputError(a.path + " and " + b.path + " are calibrations of different robots: " + why);
  };
  const auto only = [&](const std::string& what, std::set<std::string> in_s, const std::set<std::string>& in_t, const CalibratedFiles& f) {
    for (const std::string& name : in_s)
      if (!in_t.count(name)) refuse(what + " '" + name + "' is only in " + f.rig_file.urdf.path);
  };
  const auto joints = [](const Tree& tree) {
    std::set<std::string> out;
    for (const Joint& j : tree.joints) out.insert(j.name);
    return out;
  };
  const std::set<std::string> links_s(s.links.begin(), s.links.end()), links_t(t.links.begin(), t.links.end());
  only("link", links_s, links_t, a);
  only("link", links_t, links_s, b);
  only("joint", joints(s), joints(t), a);
  only("joint", joints(t), joints(s), b);
  for (const Joint& j : s.joints) {
    const Joint& k = t.joints[t.find_joint(j.name)];
    if (s.links[j.parent] != t.links[k.parent] || s.links[j.child] != t.links[k.child])
      refuse("joint '" + j.name + "' is between '" + s.links[j.parent] + "' and '" + s.links[j.child] + "' in one, between '" +
             t.links[k.parent] + "' and '" + t.links[k.child] + "' in the other");
    if (j.type != k.type || (j.moves() && (j.axis - k.axis).norm() > kSame))
      refuse("joint '" + j.name + "' is " + motion_of(j) + " in one, " + motion_of(k) + " in the other");
    const bool mimics = j.mimic && k.mimic && s.joints[j.mimic->master].name == t.joints[k.mimic->master].name &&
                        j.mimic->multiplier == k.mimic->multiplier && j.mimic->offset == k.mimic->offset;
    if ((j.mimic || k.mimic) && !mimics) refuse("joint '" + j.name + "' does not follow the same joint in the same way");
  }
  if (s.links[a.rig_file.rig.base] != t.links[b.rig_file.rig.base])
    throw InputError(a.path + " has the base " + s.links[a.rig_file.rig.base] + ", " + b.path + " has " + t.links[b.rig_file.rig.base] +
                     ": frames can be compared relative to the same base only");
}

std::vector<double> xyz_rpy(const Pose& p) {
  const Vector3d rpy = rpy_from_rotation(p.rotation);
  return {p.translation.x(), p.translation.y(), p.translation.z(), rpy.x(), rpy.y(), rpy.z()};
}

/// The difference of parameter p of a and q of b; nullopt: the same and freed in neither.
std::optional<ParameterDifference> parameter_difference(const CalibratedFiles& a, const CalibratedFiles& b, int p, int q) {
  const Parameter &in_a = a.table.all[p], &in_b = b.table.all[q];
  ParameterDifference out;
  out.name = in_a.name;
  out.components = in_a.components;
  out.units = in_a.units;
  double largest = 0;
  if (in_a.pose) {
    const Pose x = get_pose(a.values, in_a.start), y = get_pose(b.values, in_b.start), e = inverse(x) * y;
    out.a = xyz_rpy(x);
    out.b = xyz_rpy(y);
    const Vector3d turned = log_so3(e.rotation);
    for (const Vector3d& part : {e.translation, turned})
      for (int i = 0; i < 3; ++i) out.difference.push_back(part(i));
    largest = std::max(e.translation.norm(), turned.norm()) / kSame;
  } else {
    for (int c = 0; c < in_a.size(); ++c) {
      out.a.push_back(a.values(in_a.start + c));
      out.b.push_back(b.values(in_b.start + c));
      out.difference.push_back(out.b[c] - out.a[c]);
      largest = std::max(largest, std::abs(out.difference[c]) / (1e-12 * std::max(1.0, std::abs(out.a[c]))));
    }
  }
  const auto of_a = a.sigma.find(in_a.name), of_b = b.sigma.find(in_b.name);
  if (of_a == a.sigma.end() && of_b == b.sigma.end() && largest <= 1) return std::nullopt;
  for (int c = 0; c < in_a.size(); ++c) {
    const double s = of_a == a.sigma.end() ? 0 : of_a->second[c], t = of_b == b.sigma.end() ? 0 : of_b->second[c];
    const double both = a.status.empty() || b.status.empty() ? kNan : std::hypot(s, t);
    out.sigma.push_back(both > 0 ? both : kNan);
  }
  return out;
}

Json statistics(double rms, double worst, double sigma) {
  return {{"rms", number(rms)}, {"worst", number(worst)}, {"sigma", number(sigma)}, {"in_sigmas", number(rms / sigma)}};
}

}  // namespace

Frame frame_named(const Rig& rig, const ParameterTable& table, const std::string& name, const std::string& where) {
  if (const std::optional<Frame> found = find_frame(rig, table, name)) return *found;
  std::vector<std::string> names;
  for (const Frame& f : all_frames(rig, table)) names.push_back(f.name);
  throw InputError(where + ": there is no frame '" + name + "' with a way to it from the base " + rig.tree.links[rig.base] +
                   " (a link, sensor/NAME, or target/NAME of a mounted one)" + nearest_names(name, names));
}

CalibratedFiles read_calibrated(const std::string& given) {
  const fs::path path(given);
  std::error_code ignored;
  const bool folder = fs::is_directory(path, ignored);
  const bool json = !folder && path.extension() == ".json";
  const fs::path rig = folder || json ? (folder ? path : path.parent_path()) / "rig.yaml" : path;
  const fs::path result = json ? path : rig.parent_path() / "result.json";
  if (!fs::exists(rig, ignored))
    throw InputError(given + ": a result directory, its result.json, or a rig.yaml is expected: there is no " + rig.string());
  RigFile rig_file = read_rig(rig.string());
  ParameterTable table(rig_file.rig);
  const VectorXd values = table.initial;
  CalibratedFiles out{given, std::move(rig_file), std::move(table), values, "", {}, std::nullopt};
  if (!json && !fs::exists(result, ignored)) return out;

  const std::string where = result.string();
  const Node node = parse_json(read_file(where), where);
  const Field all = top(node, where);
  if (!all.has("robot") || !all.has("parameters") || !all.has("status"))
    throw InputError(where + ": is no result of `kincal calibrate`: it has no robot, parameters and status");
  unfold(all, out);
  out.status = all["status"].string();
  const Field parameters = all["parameters"];
  for (size_t i = 0; i < parameters.size(); ++i) {
    const std::string& name = parameters.node->members[i].first;
    const int p = find_parameter(out.table, name);
    if (p < 0) throw InputError(parameters[name].where() + ": is no parameter of " + rig.string());
    std::vector<double> sigma = numbers_or_null(parameters[name]["sigma"]);
    if (static_cast<int>(sigma.size()) != out.table.all[p].size()) parameters[name]["sigma"].fail("a number a component is expected");
    out.sigma[name] = std::move(sigma);
  }
  const fs::path covariance = rig.parent_path() / "covariance.csv";
  if (fs::exists(covariance, ignored)) out.unknowns = read_unknowns(covariance.string(), all, out.table);
  return out;
}

Comparison compare(const CalibratedFiles& a, const CalibratedFiles& b, const std::vector<std::string>& names, const std::string& samples) {
  check_same_robot(a, b);
  const Rig &rig = a.rig_file.rig, &other = b.rig_file.rig;
  Comparison out;
  out.base = rig.tree.links[rig.base];
  for (size_t p = 0; p < a.table.all.size(); ++p) {
    const int q = find_parameter(b.table, a.table.all[p].name);
    if (q < 0 || b.table.all[q].size() != a.table.all[p].size() || b.table.all[q].pose != a.table.all[p].pose) {
      out.only_in_a.push_back(a.table.all[p].name);
      continue;
    }
    if (auto difference = parameter_difference(a, b, static_cast<int>(p), q)) out.parameters.push_back(std::move(*difference));
  }
  for (const Parameter& p : b.table.all) {
    const int q = find_parameter(a.table, p.name);
    if (q < 0 || a.table.all[q].size() != p.size() || a.table.all[q].pose != p.pose) out.only_in_b.push_back(p.name);
  }

  std::vector<std::pair<Frame, Frame>> frames;
  for (const std::string& name : names)
    frames.push_back({frame_named(rig, a.table, name, "--frame"), frame_named(other, b.table, name, "--frame: " + b.path)});
  if (names.empty()) {
    std::set<int> carrying;
    for (const Sensor& s : rig.sensors) carrying.insert(s.link);
    for (const Target& t : rig.targets)
      if (t.link >= 0) carrying.insert(t.link);
    for (const Frame& f : all_frames(rig, a.table)) {
      const std::optional<Frame> g = find_frame(other, b.table, f.name);
      if (!g || (f.pose < 0 && (!carrying.count(f.link) || f.link == rig.base))) continue;
      const auto identity = [](const Pose& p) { return p.translation.norm() == 0 && p.rotation == Matrix3d::Identity(); };
      if (f.pose >= 0 && identity(get_pose(a.values, a.table.all[f.pose].start)) &&
          identity(get_pose(b.values, b.table.all[g->pose].start)))
        continue;  // the link itself
      frames.push_back({f, *g});
    }
  }
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
    for (size_t j = 0; j < r.size(); ++j) in_b.back()[other.tree.find_joint(rig.tree.joints[j].name)] = r[j];
  }
  for (const auto& f : frames) out.frames.push_back(compare_frame(a.robot(), b.robot(), f.first, f.second, postures, in_b));

  for (const CalibratedFiles* f : {&a, &b}) {
    if (f->status.empty())
      out.notes.push_back(f->path +
                          " has no result.json: there are no sigmas of it, and joint offsets that were folded into its robot "
                          "cannot be told from origins");
    else if (f->status != "converged")
      out.notes.push_back(f->path + ": status " + f->status);
  }
  return out;
}

std::string comparison_json(const CalibratedFiles& a, const CalibratedFiles& b, const Comparison& comparison) {
  Json json;
  json["a"] = a.path;
  json["b"] = b.path;
  json["base"] = comparison.base;
  json["parameters"] = Json::object();
  for (const ParameterDifference& d : comparison.parameters) {
    std::vector<double> in_sigmas;
    for (size_t c = 0; c < d.difference.size(); ++c) in_sigmas.push_back(d.difference[c] / d.sigma[c]);
    json["parameters"][d.name] = {{"unit", d.units},           {"a", numbers(d.a)},
                                  {"b", numbers(d.b)},         {"difference", numbers(d.difference)},
                                  {"sigma", numbers(d.sigma)}, {"in_sigmas", numbers(in_sigmas)}};
  }
  json["workspace"] = comparison.workspace;
  json["frames"] = Json::object();
  for (const FrameDifference& f : comparison.frames)
    json["frames"][f.frame] = {{"postures", f.postures},
                               {"position", statistics(f.position_rms, f.position_worst, f.position_sigma)},
                               {"rotation", statistics(f.rotation_rms, f.rotation_worst, f.rotation_sigma)}};
  json["only_in_a"] = comparison.only_in_a;
  json["only_in_b"] = comparison.only_in_b;
  json["notes"] = comparison.notes;
  return json.dump(1) + "\n";
}

}  // namespace kincal
