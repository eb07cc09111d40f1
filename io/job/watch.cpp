#include "watch.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "../../models/evidence/evidence.h"
#include "../../models/monitor/state_bytes.h"
#include "../../models/rig/words.h"
#include "../document/names.h"

namespace kincal {
namespace {

const char* word(SampleState state) {
  switch (state) {
    case SampleState::fits:
      return "fits";
    case SampleState::outlier:
      return "outlier";
    case SampleState::tells_nothing:
      return "tells nothing";
    case SampleState::undefined:
      return "undefined";
  }
  return "";
}

/// How many samples after the alarm it is said what has moved. One sample often cannot tell: of a
/// simulated PR2 it named the wrong stereo pair, 20 the right one in 12 of 12 robots.
constexpr long kNaming = 20;

constexpr std::uint64_t kWatch = 1;  // whose state it is: a Watch's, with its monitor's in it

/// A change in the units that people read: mrad and mm.
std::string size_text(double value, double sigma, const std::string& unit) {
  if (unit == "rad") return text("%+.3g +- %.2g mrad", 1e3 * value, 1e3 * sigma);
  if (unit == "m") return text("%+.3g +- %.2g mm", 1e3 * value, 1e3 * sigma);
  return text("%+.3g +- %.2g%s%s", value, sigma, unit.empty() ? "" : " ", unit.c_str());
}

/// The components of a group that changed by most sigmas, at most three and those beyond two
/// sigmas.
std::string changes_text(const Monitor& monitor, const Moved& moved) {
  const DriftGroup& group = monitor.groups()[moved.group];
  std::vector<int> order;
  for (int i = 0; i < static_cast<int>(group.columns.size()); ++i) order.push_back(i);
  const auto sigmas = [&](int i) { return std::abs(moved.change(i)) / moved.sigma(i); };
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) { return sigmas(a) > sigmas(b); });
  std::string out;
  for (size_t k = 0; k < order.size() && k < 3; ++k) {
    if (k > 0 && !(sigmas(order[k]) > 2)) break;
    const Component& c = monitor.columns()[group.columns[order[k]]];
    const std::string& name = monitor.table().all[c.parameter].components[c.index];
    out += (k ? ", " : "") + (name.empty() ? "" : name + " ") +
           size_text(moved.change(order[k]), moved.sigma(order[k]), monitor.table().unit(c));
  }
  return out;
}

std::string found_text(const Monitor& monitor, const std::vector<Moved>& found,
                       const std::vector<std::string>& ids) {
  const Moved& first = found.front();
  std::string out = monitor.groups()[first.group].name +
                    " has moved: " + changes_text(monitor, first) + ", since sample '" +
                    ids[first.since] + "'";
  if (found.size() > 1) {
    out += "; as well explained by ";
    for (size_t i = 1; i < found.size(); ++i)
      out += (i > 1 ? ", " : "") + monitor.groups()[found[i].group].name +
             text(" (%.0f %%)", 100 * found[i].probability);
  }
  return out;
}

Json found_json(const Monitor& monitor, const std::vector<Moved>& found,
                const std::vector<std::string>& ids) {
  Json out = Json::array();
  for (const Moved& moved : found) {
    const DriftGroup& group = monitor.groups()[moved.group];
    Json changes = Json::object();
    for (size_t i = 0; i < group.columns.size(); ++i) {
      const Component& c = monitor.columns()[group.columns[i]];
      changes[monitor.table().name(c)] = {{"change", moved.change(static_cast<Eigen::Index>(i))},
                                          {"sigma", moved.sigma(static_cast<Eigen::Index>(i))},
                                          {"unit", monitor.table().unit(c)}};
    }
    out.push_back({{"group", group.name},
                   {"probability", moved.probability},
                   {"since", ids[moved.since]},
                   {"changes", changes}});
  }
  return out;
}

Json sample_json(const Monitor& monitor, const Innovation& innovation, const std::string& id) {
  Json sensors = Json::object();
  for (const SensorInnovation& s : innovation.sensors)
    sensors[monitor.rig().sensors[s.sensor].name] = {
        {"chi2", s.chi2}, {"dof", s.dof}, {"probability", s.probability}};
  Json out = {{"sample", id},
              {"state", word(innovation.state)},
              {"chi2", innovation.chi2},
              {"dof", innovation.dof},
              {"probability", innovation.probability},
              {"unexplained", innovation.unexplained},
              {"sensors", sensors},
              {"drift", nullptr}};
  if (!innovation.why.empty()) out["why"] = innovation.why;
  return out;
}

std::string noise_name(const Monitor& monitor, const NoiseSeen& noise) {
  if (noise.sensor < 0) return "readings of " + monitor.rig().tree.joints[noise.part].name;
  const Sensor& sensor = monitor.rig().sensors[noise.sensor];
  const std::string part = sensor.model->noise_parts()[noise.part].name;
  return sensor.name + (part.empty() ? "" : " (" + part + ")");
}

/// Noise is told that is a quarter larger or smaller than stated.
constexpr double kToldFactor = 1.25;

std::string worst(const Monitor& monitor, const Innovation& innovation) {
  const SensorInnovation* least = nullptr;
  for (const SensorInnovation& s : innovation.sensors)
    if (!least || s.probability < least->probability) least = &s;
  return least ? "; " + monitor.rig().sensors[least->sensor].name + " most" : "";
}

}  // namespace

Watch::Watch(const CalibratedFiles& files, const MonitorOptions& options)
    : monitor_(state_of(files), options), every_(options.samples_between_alarms) {}

Watch::Told Watch::show(const Sample& sample) {
  const Innovation innovation = monitor_.add(sample);
  ids_.push_back(sample.id);
  unexplained_ += innovation.unexplained;
  Json json = sample_json(monitor_, innovation, sample.id);
  std::string words;
  if (innovation.state == SampleState::outlier)
    words = text("does not fit: chi2 %.4g of %.0f", innovation.chi2, innovation.dof) +
            worst(monitor_, innovation) +
            (innovation.unexplained
                 ? "; samples in a row do not fit, and nothing that moved explains them"
                 : "");
  if (innovation.state == SampleState::undefined) words = "cannot be evaluated: " + innovation.why;
  if (!innovation.alarm) name_at_ = 0;  // what raised it was outliers that nothing explains
  if (innovation.alarm && name_at_ == 0) {
    name_at_ = monitor_.samples() + kNaming;
    tell(json, words, false);
  } else if (innovation.alarm && monitor_.samples() >= name_at_) {
    tell(json, words, true);
  }
  return {json.dump(), words};
}

void Watch::end() {
  Json json;
  std::string words;
  if (name_at_ > 0) tell(json, words, true);
}

/// Tells what may have moved; `named`: from now on the robot counts as calibrated with that.
void Watch::tell(Json& json, std::string& words, bool named) {
  Groups groups = monitor_.moved();
  const double least = groups.front().probability / kAsLikelyOdds;
  while (groups.back().probability < least) groups.pop_back();
  json["drift"] = {{"named", named}, {"groups", found_json(monitor_, groups, ids_)}};
  words += (words.empty() ? "" : "; ") + std::string(named ? "" : "something has moved, maybe ") +
           found_text(monitor_, groups, ids_);
  if (!named) return;
  found_.push_back(std::move(groups));
  monitor_.restart(true);
  name_at_ = 0;
}

void Watch::transfer(StateBytes& bytes) {
  bytes.list(ids_, [&](std::string& id) { bytes.value(id); });
  bytes.list(found_, [&](Groups& groups) {
    bytes.list(groups, [&](Moved& moved) {
      bytes.value(moved.group);
      bytes.value(moved.probability);
      bytes.value(moved.since);
      bytes.value(moved.change);
      bytes.value(moved.sigma);
      bytes.value(moved.chi2);
      bytes.value(moved.residuals);
    });
  });
  bytes.value(unexplained_);
  bytes.value(name_at_);
}

std::string Watch::save() const {
  Watch copy(*this);
  StateBytes bytes(kWatch);
  std::string monitor = monitor_.save();
  bytes.value(monitor);
  copy.transfer(bytes);
  return bytes.finish();
}

void Watch::load(const std::string& from) {
  StateBytes bytes(from, kWatch);
  std::string monitor;
  bytes.value(monitor);
  Watch copy(*this);
  copy.monitor_.load(monitor);
  copy.transfer(bytes);
  bytes.expect_end();
  if (static_cast<long>(copy.ids_.size()) != copy.monitor_.samples())
    throw std::invalid_argument("state: it is damaged");
  *this = std::move(copy);
}

Json Watch::recalibrated(const std::vector<Sample>& samples,
                         std::vector<std::string> groups) const {
  if (groups.empty())
    for (const Groups& found : found_)
      groups.push_back(monitor_.groups()[found.front().group].name);
  if (groups.empty())
    throw std::invalid_argument(
        "groups: no group was reported as moved; name those that may have moved");
  std::vector<int> indices;
  std::vector<std::string> names;
  for (const DriftGroup& group : monitor_.groups()) names.push_back(group.name);
  for (const std::string& name : groups) {
    const auto found = std::find(names.begin(), names.end(), name);
    if (found == names.end())
      throw std::invalid_argument("groups: there is no group '" + name + "'" +
                                  nearest_or_all(name, names, "there are"));
    const auto index = static_cast<int>(found - names.begin());
    if (std::find(indices.begin(), indices.end(), index) == indices.end()) indices.push_back(index);
  }
  const Recalibration done = monitor_.recalibrated(samples, indices);
  Json values = Json::object();
  for (const int index : indices)
    for (const int column : monitor_.groups()[index].columns) {
      const Component& c = monitor_.columns()[column];
      values[monitor_.table().name(c)] = {
          {"change", done.change(column)},
          {"sigma", std::sqrt(done.state.covariance(column, column))},
          {"unit", monitor_.table().unit(c)},
          {"determined", done.undetermined[column] == 0}};
    }
  return {{"samples", done.samples}, {"values", values}};
}

Json Watch::found() const {
  Json out = Json::array();
  for (const Groups& groups : found_) out.push_back(found_json(monitor_, groups, ids_));
  return out;
}

Json Watch::noise() const {
  Json out = Json::object();
  for (const NoiseSeen& n : monitor_.noise()) out[noise_name(monitor_, n)] = n.factor;
  return out;
}

std::string Watch::summary() const {
  std::string out = text("%ld samples, %ld outliers. ", monitor_.samples(), monitor_.outliers());
  if (unexplained_ > 0)
    out += text(
        "Several samples in a row did not fit (%ld times), and no single change explains them.\n",
        unexplained_);
  if (found_.empty() && unexplained_ == 0)
    out += text("Nothing has moved (one false alarm in about %.0f samples).\n", every_);
  if (!found_.empty()) out += "Moved:\n";
  for (const Groups& groups : found_) out += "  " + found_text(monitor_, groups, ids_) + "\n";
  for (const NoiseSeen& n : monitor_.noise())
    if (std::abs(std::log(n.factor)) > std::log(kToldFactor))
      out += "  Noise of " + noise_name(monitor_, n) +
             text(": %.2f times the calibration's (%.0f residuals)\n", n.factor, n.residuals);
  return out;
}

}  // namespace kincal
