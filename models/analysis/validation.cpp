#include "validation.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <map>
#include <set>
#include <stdexcept>

#include "../calibration/calibration.h"
#include "../rig/numbers.h"
#include "../rig/selection.h"

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

/// Mounted targets whose pose some step frees; all of them where there are no steps yet.
std::vector<char> movable_targets(const Rig& rig) {
  const ParameterTable table(rig);
  std::vector<char> out(rig.targets.size(), 0);
  for (size_t t = 0; t < out.size(); ++t) out[t] = rig.steps.empty() && rig.targets[t].link >= 0;
  for (const Step& step : rig.steps)
    for (const std::string& pattern : step.free)
      for (const Freed& f : table.select(pattern))
        for (size_t t = 0; t < out.size(); ++t) out[t] = out[t] || table.target_pose[t] == f.parameter;
  return out;
}

/// Those of them that are placements: a sensor sees several, one in a sample.
std::vector<char> placements(const Rig& rig, const std::vector<Sample>& samples) {
  const std::vector<char> movable = movable_targets(rig);
  std::vector<std::set<int>> seen(rig.sensors.size());
  std::vector<char> alone(rig.sensors.size(), 1);
  for (const Sample& s : samples) {
    std::vector<std::set<int>> here(rig.sensors.size());
    for (const View& v : s.views)
      if (movable[v.target]) here[v.sensor].insert(v.target);
    for (size_t i = 0; i < here.size(); ++i) {
      seen[i].insert(here[i].begin(), here[i].end());
      if (here[i].size() > 1) alone[i] = 0;
    }
  }
  std::vector<char> out(rig.targets.size(), 0);
  for (size_t i = 0; i < seen.size(); ++i)
    if (alone[i] && seen[i].size() > 1)
      for (int t : seen[i]) out[t] = 1;
  return out;
}

/// Quantile 97.5 % of Student's t with n >= 2 degrees of freedom: Cornish and Fisher's expansion about the normal's (Abramowitz, Stegun
/// 26.7.5), 0.12 % off at n = 3, better beyond.
double student_quantile(long n) {
  if (n == 2) return std::sqrt(2 / (0.05 * 1.95) - 2);
  constexpr double z = 1.959963984540054, q = z * z;
  const double a = 1 / static_cast<double>(n);
  return z * (1 + a * ((q + 1) / 4 +
                       a * (((5 * q + 16) * q + 3) / 96 + a * ((((3 * q + 19) * q + 17) * q - 15) / 384 +
                                                               a * (((((79 * q + 776) * q + 1482) * q - 1920) * q - 945) / 92160)))));
}

/// Squares of a sensor's residuals in one block.
struct BlockSums {
  long points = 0;
  double squared = 0, as_read = 0, rotation = 0, rotation_as_read = 0;
};

/// Sums by sensor and sample of held-out residuals.
struct HeldOutSums {
  std::map<std::pair<int, int>, BlockSums> all;  // (sensor, sample of the whole set)
  std::map<int, long> missing;                   // sensor -> views

  void add(const Calibration& calibration, const CalibrationResult& result, const std::vector<int>& index) {
    const Rig& rig = calibration.rig();
    for (const Sample& s : calibration.samples())
      if (!s.train)
        for (const View& v : s.views) ++missing[v.sensor];
    for (bool read : {false, true})
      for (const ViewResiduals& r : read ? result.residuals_as_read : result.residuals) {
        if (calibration.samples()[r.sample].train) continue;
        BlockSums& sums = all[{r.view->sensor, index[r.sample]}];
        const bool whole = rig.sensors[r.view->sensor].model->whole_pose();
        const double squared = whole ? r.raw.head<3>().squaredNorm() : r.raw.squaredNorm();
        const double rotation = whole ? r.raw.tail<3>().squaredNorm() : 0;
        (read ? sums.as_read : sums.squared) += squared;
        (read ? sums.rotation_as_read : sums.rotation) += rotation;
        if (read) {
          sums.points += whole ? 1 : r.raw.size() / rig.sensors[r.view->sensor].model->rows();
          --missing[r.view->sensor];
        }
      }
  }
};

std::vector<HeldOutError> errors(const Rig& rig, const Blocks& blocks, const HeldOutSums& held_out) {
  std::vector<HeldOutError> out;
  for (size_t s = 0; s < rig.sensors.size(); ++s) {
    const auto missing = held_out.missing.find(static_cast<int>(s));
    if (missing == held_out.missing.end()) continue;
    HeldOutError e;
    e.sensor = rig.sensors[s].name;
    e.unit = rig.sensors[s].model->unit();
    e.whole_pose = rig.sensors[s].model->whole_pose();
    e.missing = missing->second;
    std::map<int, BlockSums> by_block, by_sample;
    BlockSums total;
    const auto add = [](BlockSums& to, const BlockSums& more) {
      to.points += more.points;
      to.squared += more.squared;
      to.as_read += more.as_read;
      to.rotation += more.rotation;
      to.rotation_as_read += more.rotation_as_read;
    };
    for (const auto& entry : held_out.all) {
      if (entry.first.first != static_cast<int>(s)) continue;
      const int block = blocks.of[entry.first.second];
      e.by_target = e.by_target || blocks.target[block];
      add(by_block[block], entry.second);
      add(by_sample[entry.first.second], entry.second);
      add(total, entry.second);
    }
    if (by_block.size() < 3) e.by_target = false;
    const std::map<int, BlockSums>& parts = e.by_target || by_block.size() >= 3 ? by_block : by_sample;
    e.points = total.points;
    e.blocks = static_cast<long>(parts.size());
    const auto judge = [&](double BlockSums::*squares, double& rms, Interval& interval) {
      rms = total.points ? std::sqrt(total.*squares / static_cast<double>(total.points)) : kNan;
      std::vector<double> values;
      std::vector<long> points;
      for (const auto& part : parts) {
        values.push_back(part.second.*squares);
        points.push_back(part.second.points);
      }
      interval = rms_interval(values, points);
    };
    judge(&BlockSums::squared, e.rms, e.of_rms);
    judge(&BlockSums::as_read, e.rms_as_read, e.of_rms_as_read);
    e.rotation = e.rotation_as_read = kNan;
    if (e.whole_pose) {
      judge(&BlockSums::rotation, e.rotation, e.of_rotation);
      judge(&BlockSums::rotation_as_read, e.rotation_as_read, e.of_rotation_as_read);
    }
    out.push_back(e);
  }
  return out;
}

const HeldOutError* find_sensor(const std::vector<HeldOutError>& all, const std::string& name) {
  for (const HeldOutError& e : all)
    if (e.sensor == name && e.points + e.missing > 0) return &e;
  return nullptr;
}

}  // namespace

Blocks make_blocks(const Rig& rig, const std::vector<Sample>& samples) {
  const std::vector<char> placement = placements(rig, samples);
  // Placements of different sensors may meet in a sample: then they go together, under the name of the first.
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
  for (const Sample& s : samples) {
    int target = -1;
    for (const View& v : s.views)
      if (placement[v.target]) target = find(v.target);
    const int next = static_cast<int>(out.names.size());
    const int block = target < 0 ? next : of_target.emplace(target, next).first->second;
    if (block == next) {
      out.names.push_back(target < 0 ? s.id : rig.targets[target].name);
      out.target.push_back(target >= 0);
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
    std::set<std::string> seen;  // sensors and targets: what must not all be in one fold
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
      if (!placement[v.target]) card.seen.insert("target/" + rig.targets[v.target].name);
    }
  }
  std::vector<Card> deck;
  for (auto& card : cards) deck.push_back(std::move(card.second));
  std::sort(deck.begin(), deck.end(), [&](const Card& a, const Card& b) {
    if (a.seen != b.seen) return a.seen < b.seen;
    if (a.hash != b.hash) return a.hash < b.hash;
    return out.blocks.names[a.block] < out.blocks.names[b.block];
  });
  for (size_t i = 0; i < deck.size(); ++i) deck[i].fold = static_cast<int>(i % static_cast<size_t>(count));
  std::set<std::string> names;
  for (const Card& card : deck) names.insert(card.seen.begin(), card.seen.end());
  for (const std::string& name : names) {
    std::set<int> folds;
    Card* first = nullptr;
    for (Card& card : deck)
      if (card.seen.count(name)) {
        folds.insert(card.fold);
        if (!first) first = &card;
      }
    if (folds.size() == 1 && first->fold >= 0) first->fold = -1;
  }
  std::set<int> filled;
  long holdable = 0;
  std::string targets;
  for (const Card& card : deck) {
    if (card.fold >= 0) {
      filled.insert(card.fold);
      ++holdable;
    }
    if (out.blocks.target[card.block]) targets += (targets.empty() ? "" : ", ") + out.blocks.names[card.block];
  }
  if (static_cast<int>(filled.size()) < count)
    throw std::invalid_argument(std::to_string(count) + " folds of " + std::to_string(holdable) +
                                (targets.empty() ? " training samples" : " parts of the training samples") + " that can be held out" +
                                (targets.empty() ? "" : " (those of a target are held out together: " + targets + ")") +
                                ": at most as many folds, at least 2");
  for (size_t i = 0; i < samples.size(); ++i)
    if (samples[i].train)
      for (const Card& card : deck)
        if (card.block == out.blocks.of[i]) out.of[i] = card.fold;
  return out;
}

Interval rms_interval(const std::vector<double>& squares, const std::vector<long>& points) {
  const size_t m = squares.size();
  double sum = 0;
  long count = 0;
  for (size_t i = 0; i < m; ++i) sum += squares[i], count += points[i];
  if (m < 3) return {};
  if (sum == 0) return {0, 0};
  std::vector<double> theta;
  double mean = 0;
  for (size_t i = 0; i < m; ++i) {
    const double left = sum - squares[i];
    if (!(left > 0) || count == points[i]) return {};  // all of it in one block
    theta.push_back(std::log(left / static_cast<double>(count - points[i])));
    mean += theta.back() / static_cast<double>(m);
  }
  double variance = 0;
  for (double t : theta) variance += (t - mean) * (t - mean);
  const double error = std::sqrt(variance * static_cast<double>(m - 1) / static_cast<double>(m));
  const double rms = std::sqrt(sum / static_cast<double>(count)), factor = std::exp(student_quantile(static_cast<long>(m) - 1) * error / 2);
  if (factor > 10) return {};  // one block is nearly all of it: the scatter over blocks says nothing
  return {rms / factor, rms * factor};
}

std::vector<HeldOutError> held_out_errors(const Calibration& calibration, const CalibrationResult& result) {
  std::vector<int> same;
  for (size_t i = 0; i < calibration.samples().size(); ++i) same.push_back(static_cast<int>(i));
  HeldOutSums sums;
  sums.add(calibration, result, same);
  return errors(calibration.rig(), make_blocks(calibration.rig(), calibration.samples()), sums);
}

std::optional<CrossValidation> cross_validate(const Calibration& calibration, const CalibrationOptions& options, int count) {
  const Folds folds = deal_folds(calibration.rig(), calibration.samples(), count);
  CrossValidation out;
  out.by_target = folds.by_target();
  out.never = folds.held_out(-1);
  HeldOutSums sums;
  for (int f = 0; f < count; ++f) {
    std::vector<Sample> samples;
    std::vector<int> index;
    for (int i : calibration.training()) {
      samples.push_back(calibration.samples()[i]);
      samples.back().train = folds.of[i] != f;
      index.push_back(i);
    }
    CalibrationOptions fold_options = options;
    fold_options.judge = true;
    if (options.progress)
      fold_options.progress = [&, f](const std::string&, int iteration, double chi2, double damping) {
        return options.progress("fold " + std::to_string(f + 1) + " of " + std::to_string(count), iteration, chi2, damping);
      };
    CrossValidation::Fold fold;
    fold.held_out = folds.held_out(f);
    try {
      Calibration without(calibration.rig(), std::move(samples));
      const std::optional<CalibrationResult> result = without.run(fold_options);
      if (!result) return std::nullopt;
      fold.converged = result->status != Status::not_converged;
      fold.determined = result->unobservable.empty();
      sums.add(without, *result, index);
    } catch (const std::exception& error) {
      fold.error = error.what();
      for (int i : calibration.training())
        if (folds.of[i] == f)
          for (const View& v : calibration.samples()[i].views) ++sums.missing[v.sensor];
    }
    out.folds.push_back(std::move(fold));
  }
  out.sensors = errors(calibration.rig(), folds.blocks, sums);
  return out;
}

bool Validation::met() const {
  return std::all_of(requirements.begin(), requirements.end(), [](const Judgement& j) { return j.met; });
}

std::string judgement_text(const Judgement& j) {
  const Requirement& r = j.requirement;
  std::string out = r.text;
  if (r.quantity == Requirement::Quantity::sensor && r.text.find(r.name) == std::string::npos) out += " (" + r.name + ")";
  out += ": ";
  if (std::isfinite(j.measured)) {
    char value[64];
    std::snprintf(value, sizeof value, "%.4g", j.measured / r.factor);
    out += value + (r.unit.empty() ? "" : " " + r.unit);
  } else {
    out += "unknown";
  }
  const std::map<std::string, std::string> words = {{"test", "rms as read, held out"},
                                                    {"cross_validation", "rms as read, cross-validated"},
                                                    {"train", "rms as read in training (nothing is held out)"},
                                                    {"samples", "predicted over the samples' postures"},
                                                    {"limits", "predicted over the joints' limits"}};
  const auto found = words.find(j.from);
  if (found != words.end()) out += ", " + found->second;
  return j.why.empty() ? out : out + "; " + j.why;
}

Judgement judge(const Requirement& requirement, const CalibrationResult& result) {
  Judgement out;
  out.requirement = requirement;
  out.measured = kNan;
  const Validation& validation = result.validation;
  if (requirement.quantity == Requirement::Quantity::sensor) {
    const HeldOutError* e = find_sensor(validation.test, requirement.name);
    out.from = "test";
    if (!e && validation.cross_validation) {
      e = find_sensor(validation.cross_validation->sensors, requirement.name);
      out.from = "cross_validation";
    }
    if (e) {
      out.measured = requirement.rotation ? e->rotation_as_read : e->rms_as_read;
      if (e->missing > 0) out.why = std::to_string(e->missing) + " held-out views cannot be evaluated";
    } else {
      out.from = "train";
      for (const SensorResult& s : result.sensors)
        if (s.name == requirement.name) out.measured = requirement.rotation ? s.train.rotation_as_read : s.train.rms_as_read;
      if (!std::isfinite(out.measured)) out.why = "the sensor sees nothing";
    }
  } else if (requirement.quantity == Requirement::Quantity::frame) {
    for (const FrameReport& f : validation.frames)
      if (f.frame == requirement.name && !f.workspaces.empty()) {
        const FrameSigma& sigma = f.workspaces.front();
        out.from = sigma.workspace;
        out.measured = requirement.rotation ? sigma.rotation.rms : sigma.position.rms;
      }
    if (!std::isfinite(out.measured)) out.why = "the data do not determine it";
  } else if (result.dof > 0) {
    out.measured = result.chi2 / static_cast<double>(result.dof);
  } else {
    out.why = "there are no degrees of freedom";
  }
  out.met = out.why.empty() && out.measured < requirement.limit;
  return out;
}

}  // namespace kincal
