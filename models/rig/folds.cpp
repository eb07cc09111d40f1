#include "folds.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <set>
#include <stdexcept>

#include "geometry.h"
#include "numbers.h"
#include "parameters.h"
#include "recording.h"

namespace kincal {
namespace {

/// FNV-1a, its bits then mixed by the finaliser of splitmix64: the same everywhere.
std::uint64_t hash(const std::string& text) {
  std::uint64_t h = 0xcbf29ce484222325u;
  for (unsigned char c : text) h = (h ^ c) * 0x100000001b3u;
  h = (h ^ (h >> 30)) * 0xbf58476d1ce4e5b9u;
  h = (h ^ (h >> 27)) * 0x94d049bb133111ebu;
  return h ^ (h >> 31);
}

/// Mounted targets of which steps free the pose and nothing else, for another number of a target
/// that is held out whole would be without data; all mounted ones where there are no steps yet.
std::vector<char> movable_targets(const Rig& rig) {
  const ParameterTable table(rig);
  std::vector<char> out(rig.targets.size(), 0), other(rig.targets.size(), 0);
  for (size_t t = 0; t < out.size(); ++t) out[t] = rig.steps.empty() && rig.targets[t].link >= 0;
  for (const Step& step : rig.steps)
    for (const std::string& pattern : step.free)
      for (const Freed& f : table.select(pattern))
        for (size_t t = 0; t < out.size(); ++t) {
          out[t] = out[t] || table.target_pose[t] == f.parameter;
          other[t] = other[t] || table.target_square[t] == f.parameter ||
                     table.target_warp[t] == f.parameter || table.target_print[t] == f.parameter ||
                     table.target_points[t] == f.parameter;
        }
  for (size_t t = 0; t < out.size(); ++t) out[t] = out[t] && !other[t];
  return out;
}

/// Those of them that are placements: on one rigid body a sensor sees several, one in a sample.
std::vector<char> placements(const Rig& rig, const std::vector<Sample>& samples) {
  const std::vector<char> movable = movable_targets(rig);
  using Place = std::pair<int, int>;  // sensor, body
  std::map<Place, std::set<int>> seen;
  std::set<Place> crowded;  // several in a sample
  for (const Sample& s : samples) {
    std::map<Place, std::set<int>> together;
    for (const View& v : s.views)
      if (movable[v.target])
        together[{v.sensor, body_of(rig.tree, rig.targets[v.target].link)}].insert(v.target);
    for (const auto& [place, targets] : together) {
      seen[place].insert(targets.begin(), targets.end());
      if (targets.size() > 1) crowded.insert(place);
    }
  }
  std::vector<char> out(rig.targets.size(), 0);
  for (const auto& [place, targets] : seen)
    if (!crowded.count(place) && targets.size() > 1)
      for (int t : targets) out[t] = 1;
  // What a sensor sees as its only placement of a body is all that the sensor tells of the way
  // there.
  for (bool changed = true; changed;) {
    changed = false;
    for (const auto& [place, targets] : seen) {
      std::vector<int> placed;
      for (int t : targets)
        if (out[t]) placed.push_back(t);
      if (placed.size() != 1) continue;
      out[placed[0]] = 0;
      changed = true;
    }
  }
  return out;
}

}  // namespace

namespace {

constexpr double kSigmas = 5;    // of a difference of readings of one posture, at most
constexpr double kExact = 1e-9;  // rad or m, of joints that are exact

/// By sample: the first one of its posture.
std::vector<int> first_of_posture(const Rig& rig, const std::vector<Sample>& samples) {
  std::vector<int> out(samples.size()), joints;
  for (size_t j = 0; j < rig.joints.size(); ++j)
    if (rig.tree.joints[j].has_reading()) joints.push_back(static_cast<int>(j));
  // The joint that moves most finds those that may be alike.
  int widest = -1;
  double most = 0;
  for (const int j : joints) {
    double low = kInfinity, high = -low;
    for (const Sample& s : samples)
      if (!s.readings.empty() && std::isfinite(s.readings[j]))
        low = std::min(low, s.readings[j]), high = std::max(high, s.readings[j]);
    if (high - low > most) most = high - low, widest = j;
  }
  double window = kExact;
  for (const Sample& s : samples)
    if (widest >= 0)
      window = std::max(window, kSigmas * std::sqrt(2.0) * joint_sigma(rig, s, widest));
  std::multimap<double, int> postures;  // by that joint's reading
  for (size_t i = 0; i < samples.size(); ++i) {
    const Sample& sample = samples[i];
    out[i] = static_cast<int>(i);
    const bool free = std::any_of(sample.views.begin(), sample.views.end(),
                                  [&](const View& v) { return rig.targets[v.target].link < 0; });
    if (widest < 0 || free || sample.readings.empty() || std::isnan(sample.readings[widest]))
      continue;
    const double reading = sample.readings[widest];
    const auto end = postures.upper_bound(reading + window);
    for (auto at = postures.lower_bound(reading - window);
         at != end && out[i] == static_cast<int>(i); ++at)
      if (is_same_posture(rig, samples[at->second], sample, joints)) out[i] = at->second;
    if (out[i] == static_cast<int>(i)) postures.insert({reading, out[i]});
  }
  return out;
}

}  // namespace

bool is_same_posture(const Rig& rig, const Sample& a, const Sample& b,
                     const std::vector<int>& joints) {
  return std::all_of(joints.begin(), joints.end(), [&](int j) {
    if (std::isnan(a.readings[j]) || std::isnan(b.readings[j]))
      return std::isnan(a.readings[j]) && std::isnan(b.readings[j]);
    const double most = kSigmas * std::hypot(joint_sigma(rig, a, j), joint_sigma(rig, b, j));
    return std::abs(a.readings[j] - b.readings[j]) <= std::max(kExact, most);
  });
}

Blocks make_blocks(const Rig& rig, const std::vector<Sample>& samples) {
  const std::vector<char> placement = placements(rig, samples);
  // Placements of different sensors may meet in a sample: then they go together, under the name of
  // the first.
  std::vector<int> leader(rig.targets.size());
  for (size_t t = 0; t < leader.size(); ++t) leader[t] = static_cast<int>(t);
  const auto find = [&](int t) {
    while (leader[t] != t) t = leader[t];
    return t;
  };
  for (const Sample& s : samples) {
    int first = -1;
    for (const View& v : s.views)
      if (placement[v.target]) {
        if (first < 0) first = v.target;
        const int a = find(first), b = find(v.target);
        leader[std::max(a, b)] = std::min(a, b);
      }
  }
  Blocks out;
  std::map<int, int> of_target;
  const std::vector<int> posture = first_of_posture(rig, samples);
  for (size_t i = 0; i < samples.size(); ++i) {
    const Sample& s = samples[i];
    int target = -1;
    for (const View& v : s.views)
      if (placement[v.target]) target = find(v.target);
    const int next = static_cast<int>(out.names.size()), first = posture[i];
    const int block = target >= 0                   ? of_target.emplace(target, next).first->second
                      : first < static_cast<int>(i) ? out.of[first]
                                                    : next;
    if (block == next) {
      out.names.push_back(target < 0 ? s.id : rig.targets[target].name);
      out.target.push_back(target >= 0);
    } else if (target < 0 && !out.target[block]) {
      out.names[block] = std::min(out.names[block], s.id);  // (whatever the order)
    }
    out.of.push_back(block);
  }
  return out;
}

std::vector<std::string> Folds::held_out(int fold) const {
  std::set<int> found;
  for (size_t i = 0; i < of.size(); ++i)
    if (training[i] && of[i] == fold) found.insert(blocks.of[i]);
  std::vector<std::string> out;
  for (int b : found) out.push_back(blocks.names[b]);
  std::sort(out.begin(), out.end());
  return out;
}

bool Folds::by_target() const {
  for (size_t i = 0; i < of.size(); ++i)
    if (training[i] && blocks.target[blocks.of[i]]) return true;
  return false;
}

Folds deal_folds(const Rig& rig, const std::vector<Sample>& samples, int count) {
  Folds out;
  out.count = count;
  out.blocks = make_blocks(rig, samples);
  out.of.assign(samples.size(), -1);
  const std::vector<char> placement = placements(rig, samples);
  struct Card {
    std::set<std::string> seen;    // sensors and targets
    std::set<std::string> joints;  // on the ways between them
    std::uint64_t hash = 0;
    int block = -1, fold = -1;
  };
  std::map<int, Card> cards;  // by block
  for (size_t i = 0; i < samples.size(); ++i) {
    out.training.push_back(samples[i].train);
    if (!samples[i].train) continue;
    Card& card = cards[out.blocks.of[i]];
    card.block = out.blocks.of[i];
    card.hash = hash(out.blocks.names[card.block]);
    for (const View& v : samples[i].views) {
      card.seen.insert("sensor/" + rig.sensors[v.sensor].name);
      const Target& target = rig.targets[v.target];
      if (!placement[v.target]) card.seen.insert("target/" + target.name);
      const int to = target.link >= 0 ? target.link : rig.base;
      for (const PathStep& step : find_path(rig.tree, rig.sensors[v.sensor].link, to))
        card.joints.insert("joint/" + rig.tree.joints[driver(rig.tree, step.joint).joint].name);
    }
  }
  std::vector<Card> sorted;
  for (auto& card : cards) sorted.push_back(std::move(card.second));
  std::sort(sorted.begin(), sorted.end(), [&](const Card& a, const Card& b) {
    if (a.seen != b.seen) return a.seen < b.seen;
    if (a.hash != b.hash) return a.hash < b.hash;
    return out.blocks.names[a.block] < out.blocks.names[b.block];
  });
  for (size_t i = 0; i < sorted.size(); ++i)
    sorted[i].fold = static_cast<int>(i % static_cast<size_t>(count));
  // What must not all be in one fold.
  std::set<std::string> names;
  for (const Card& card : sorted) {
    names.insert(card.seen.begin(), card.seen.end());
    names.insert(card.joints.begin(), card.joints.end());
  }
  for (const std::string& name : names) {
    std::set<int> folds;
    Card* first = nullptr;
    for (Card& card : sorted)
      if (card.seen.count(name) || card.joints.count(name)) {
        folds.insert(card.fold);
        if (!first) first = &card;
      }
    if (folds.size() == 1 && first->fold >= 0) first->fold = -1;
  }
  std::set<int> filled;
  long holdable = 0;
  std::string targets;
  for (const Card& card : sorted) {
    if (card.fold >= 0) {
      filled.insert(card.fold);
      ++holdable;
    }
    if (out.blocks.target[card.block])
      targets += (targets.empty() ? "" : ", ") + out.blocks.names[card.block];
  }
  if (static_cast<int>(filled.size()) < count)
    throw std::invalid_argument(
        std::to_string(count) + " folds of " + std::to_string(holdable) +
        (targets.empty() ? " training samples" : " parts of the training samples") +
        " that can be held out" +
        (targets.empty() ? "" : " (those of a target are held out together: " + targets + ")") +
        ": from 2 to that many folds are possible");
  for (size_t i = 0; i < samples.size(); ++i)
    if (samples[i].train)
      for (const Card& card : sorted)
        if (card.block == out.blocks.of[i]) out.of[i] = card.fold;
  return out;
}

}  // namespace kincal
