#include "plan.h"
#include <algorithm>
#include <iterator>
#include <map>
#include <set>
#include <stdexcept>

#include "../estimation/estimation.h"

namespace kincal {
namespace {

/// By the sensors of a step, and by parameter: whether its measurements depend on it; empty: no
/// training sample has a view of its sensors.
using Used = std::map<std::vector<int>, std::vector<char>>;

/// Training samples that show every pair of sensor and target that any of them shows: what
/// influences a view is by structure that of its pair.
std::vector<int> one_of_each_pair(const Recording& recording) {
  std::set<std::pair<int, int>> pairs;
  std::vector<int> out;
  for (int i : recording.training()) {
    const size_t before = pairs.size();
    for (const View& v : recording.samples[i].views) pairs.insert({v.sensor, v.target});
    if (pairs.size() > before) out.push_back(i);
  }
  return out;
}

const std::vector<char>& used_by(const Recording& recording, const Step& step, Used& used) {
  const auto [found, is_new] = used.try_emplace(step.sensors);
  if (!is_new) return found->second;
  EstimationSetup setup;
  setup.noise = NoiseMode::none;
  setup.sensors = step.sensors;
  const Estimation probe(recording, one_of_each_pair(recording), setup);
  if (!probe.groups().empty()) found->second = probe.influencing();
  return found->second;
}

std::string place(const char* list, size_t i) {
  return std::string(list) + "[" + std::to_string(i) + "]";
}

/// Returns what names mean together; `plain`, by parameter: it was named without a glob.
struct Wanted {
  std::vector<Freed> free;
  std::vector<char> plain;
};

void add(const Recording& recording, const std::string& pattern, const std::string& where,
         Wanted& wanted) {
  const std::vector<Freed> found = recording.table.find(pattern, where);
  if (recording.table.is_plain_name(pattern)) wanted.plain[found[0].parameter] = 1;
  merge(wanted.free, found);
}

void take_out(const std::vector<Freed>& found, std::vector<Freed>& from) {
  for (const Freed& f : found)
    for (Freed& w : from)
      if (w.parameter == f.parameter) {
        std::vector<int> left;
        std::set_difference(w.components.begin(), w.components.end(), f.components.begin(),
                            f.components.end(), std::back_inserter(left));
        w.components = left;
      }
}

/// Deals what is wanted to what is free, unused, or seen by held-out samples only.
void deal(const Recording& recording, const Wanted& wanted, const std::vector<char>& used,
          StepPlan& plan) {
  const ParameterTable& table = recording.table;
  std::vector<char> seen_in_training(recording.rig.targets.size(), 0),
      seen_held_out(recording.rig.targets.size(), 0);
  for (const Sample& s : recording.samples)
    for (const View& v : s.views) (s.train ? seen_in_training : seen_held_out)[v.target] = 1;
  for (const Freed& f : wanted.free) {
    if (f.components.empty()) continue;
    const Parameter& p = table.all[f.parameter];
    if (p.kind == ParameterKind::target_pose && seen_held_out[p.owner] &&
        !seen_in_training[p.owner]) {
      plan.held_out.push_back(p.name);
      merge(plan.seen_held_out, {f});
    } else if (!used[f.parameter] && !wanted.plain[f.parameter]) {
      plan.unused.push_back(p.name);
    } else {
      plan.free.push_back(f);
    }
  }
  if (!plan.free.empty()) return;
  std::string why;
  for (const std::string& n : plan.unused)
    why += (why.empty() ? "; no measurement of it depends on " : ", ") + n;
  for (const std::string& n : plan.held_out) why += "; only held-out samples see " + n;
  throw std::invalid_argument("step '" + plan.name + "' frees nothing" + why);
}

/// Priors of what is free; each must cover something that the step means to free.
void place_priors(const ParameterTable& table, const Step& step,
                  const std::vector<Freed>& meant_free, StepPlan& plan) {
  for (const PriorSetting& prior : step.priors) {
    bool covers = false;
    for (const Freed& f : table.find(prior.pattern, prior.where)) {
      if (prior.split && !table.all[f.parameter].pose)
        throw std::invalid_argument(
            prior.where + ": '" + table.all[f.parameter].name +
            "' is not a pose: a number is expected, not {translation, rotation}");
      const Freed* meant = find_freed(meant_free, f.parameter);
      const Freed* freed = find_freed(plan.free, f.parameter);
      for (int c : f.components) {
        if (meant && std::count(meant->components.begin(), meant->components.end(), c))
          covers = true;
        if (!freed || !std::count(freed->components.begin(), freed->components.end(), c)) continue;
        plan.priors.erase(std::remove_if(plan.priors.begin(), plan.priors.end(),
                                         [&](const Prior& p) {
                                           return p.parameter == f.parameter && p.component == c;
                                         }),
                          plan.priors.end());  // later entries win
        plan.priors.push_back(
            {f.parameter, c, prior.split && c >= 3 ? prior.rotation : prior.translation});
      }
    }
    if (!covers)
      throw std::invalid_argument(prior.where + ": '" + prior.pattern +
                                  "' covers nothing that this step estimates");
  }
}

/// A step's plan but for its counts. `used`: by used_by().
StepPlan resolve(const Recording& recording, const Step& step, const std::vector<char>& used,
                 const std::vector<std::string>& free, const std::vector<std::string>& fix) {
  const ParameterTable& table = recording.table;
  StepPlan plan;
  plan.name = step.name;
  plan.sensors = step.sensors;
  plan.loss = step.loss.value_or(Loss());
  Wanted wanted{{}, std::vector<char>(table.all.size(), 0)};
  for (size_t i = 0; i < step.free.size(); ++i)
    add(recording, step.free[i],
        i < step.free_where.size() ? step.free_where[i] : "step '" + step.name + "': free", wanted);
  for (size_t i = 0; i < free.size(); ++i) add(recording, free[i], place("free", i), wanted);
  if (used.empty())
    throw std::invalid_argument("step '" + step.name +
                                "': no training sample has a view of its sensors");
  const std::vector<Freed> with_fixed =
      wanted.free;  // priors are checked against what the step means to free
  for (size_t i = 0; i < fix.size(); ++i)
    take_out(table.find(fix[i], place("fix", i)), wanted.free);
  deal(recording, wanted, used, plan);
  place_priors(table, step, with_fixed, plan);
  return plan;
}

std::vector<const Step*> steps_to_run(const Rig& rig, const std::string& last_step) {
  if (rig.steps.empty())
    throw std::invalid_argument("the rig has no `estimate`: nothing is to be calibrated");
  std::vector<const Step*> out;
  std::string names;
  for (const Step& step : rig.steps) {
    out.push_back(&step);
    if (step.name == last_step) return out;
    names += (names.empty() ? "" : ", ") + step.name;
  }
  if (!last_step.empty())
    throw std::invalid_argument("last_step: there is no step '" + last_step + "'; the rig has " +
                                names);
  return out;
}

/// One message for each free and fix that changes nothing in the last step.
std::vector<std::string> without_effect(const Recording& recording, const Step& step,
                                        const std::vector<char>& used,
                                        const StepSelection& selection) {
  const auto freed = [&](const std::vector<std::string>& free,
                         const std::vector<std::string>& fix) {
    std::map<int, std::vector<int>> out;
    const StepPlan plan = resolve(recording, step, used, free, fix);
    for (const std::vector<Freed>& part : {plan.free, plan.seen_held_out})
      for (const Freed& f : part) out[f.parameter] = f.components;
    return out;
  };
  std::vector<std::string> out;
  if (selection.free.empty() && selection.fix.empty()) return out;
  const std::map<int, std::vector<int>> all = freed(selection.free, selection.fix);
  for (const bool fix : {false, true}) {
    const std::vector<std::string>& patterns = fix ? selection.fix : selection.free;
    for (size_t i = 0; i < patterns.size(); ++i) {
      std::vector<std::string> others = patterns;
      others.erase(others.begin() + static_cast<std::ptrdiff_t>(i));
      try {
        if (freed(fix ? selection.free : others, fix ? others : selection.fix) != all) continue;
      } catch (const std::invalid_argument&) {  // without it the step would free nothing, or a
                                                // prior would cover nothing
        continue;
      }
      bool free = false;
      for (const Freed& f : recording.table.select(patterns[i]))
        free = free || all.count(f.parameter);
      const std::string name = "step '" + step.name + "'";
      out.push_back((fix ? "`fix` '" : "`free` '") + patterns[i] + "' changes nothing: " +
                    (fix    ? "it is not free in " + name + " anyway"
                     : free ? "it is free in " + name + " anyway"
                            : "no measurement of " + name + " depends on it, or `fix` holds it"));
    }
  }
  return out;
}

/// Whether all of `a` is among `b`.
bool among(const std::vector<Freed>& a, const std::vector<Freed>& b) {
  return std::all_of(a.begin(), a.end(), [&](const Freed& f) {
    const Freed* g = find_freed(b, f.parameter);
    return g && std::includes(g->components.begin(), g->components.end(), f.components.begin(),
                              f.components.end());
  });
}

}  // namespace

std::vector<StepPlan> resolve_steps(const Recording& recording, const StepSelection& selection) {
  const std::vector<const Step*> steps = steps_to_run(recording.rig, selection.last_step);
  std::vector<StepPlan> out;
  Used known;
  for (const Step* step : steps) {
    const bool last = step == steps.back();
    const std::vector<char>& used = used_by(recording, *step, known);
    out.push_back(last ? resolve(recording, *step, used, selection.free, selection.fix)
                       : resolve(recording, *step, used, {}, {}));
    if (last) out.back().without_effect = without_effect(recording, *step, used, selection);
  }
  for (size_t i = 0; i < out.size(); ++i)
    for (size_t later = i + 1; later < out.size(); ++later)
      out[i].repeated = out[i].repeated || among(out[i].free, out[later].free);
  return out;
}

void check_steps(const Recording& recording) {
  if (recording.samples.empty()) throw std::invalid_argument("there are no samples");
  Used known;
  for (const Step& step : recording.rig.steps)
    resolve(recording, step, used_by(recording, step, known), {}, {});
}

void count(const Recording& recording, NoiseMode noise, StepPlan& plan) {
  EstimationSetup setup;
  setup.noise = noise;
  setup.sensors = plan.sensors;
  setup.free = plan.free;
  setup.priors = plan.priors;
  const Estimation problem(recording, recording.training(), setup);
  plan.unknowns = problem.shared_size();
  for (size_t g = 0; g < problem.groups().size(); ++g) {
    plan.rows += problem.groups()[g].rows;
    plan.unknowns += problem.groups()[g].private_size;
    plan.samples += problem.sample_of(static_cast<int>(g)) >= 0;
  }
}

}  // namespace kincal
