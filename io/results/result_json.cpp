#include "result_json.h"

#include <algorithm>
#include <cmath>

namespace kincal {

namespace {

constexpr size_t kMostSamples = 2000;  // of which result.json tells

Json directions(const std::vector<Direction>& all) {
  Json out = Json::array();
  for (const Direction& d : all) {
    Json one = Json::object();
    for (const auto& c : d) one[c.first] = c.second;
    out.push_back(std::move(one));
  }
  return out;
}

Json statistics(const SplitStatistics& s, bool measures_pose, bool before) {
  Json out = {{"points", s.points}};
  if (before) out["rms_before"] = number(s.rms_before);
  out["rms"] = number(s.rms);
  out["rms_as_read"] = number(s.rms_as_read);
  if (std::isfinite(s.rms_uncorrected)) out["rms_uncorrected"] = s.rms_uncorrected;
  if (measures_pose) {
    if (before) out["rms_rotation_before"] = number(s.rotation_before);
    out["rms_rotation"] = number(s.rotation);
    out["rms_rotation_as_read"] = number(s.rotation_as_read);
    if (std::isfinite(s.rotation_uncorrected))
      out["rms_rotation_uncorrected"] = s.rotation_uncorrected;
  }
  return out;
}

Json sensor_table(const std::vector<SensorResult>& sensors, bool before) {
  Json out = Json::object();
  for (const SensorResult& s : sensors)
    out[s.name] = {{"unit", s.unit},
                   {"train", statistics(s.train, s.measures_pose, before)},
                   {"test", statistics(s.test, s.measures_pose, before)}};
  return out;
}

Json noise_table(const std::vector<NoiseLevel>& levels) {
  Json out = Json::array();
  for (const NoiseLevel& l : levels) {
    out.push_back({{"of", l.of},
                   {"part", l.part},
                   {"unit", l.unit},
                   {"assumed", number(l.guess > 0 ? l.guess : l.assumed)},
                   {"stated", l.guess == 0},
                   {"used", number(l.used)},
                   {"seen", number(l.seen)},
                   {"uncertainty", number(l.uncertainty)},
                   {"redundancy", number(l.redundancy)},
                   {"rows", l.rows},
                   {"own_views", l.own_views}});
    if (l.guess > 0) out.back()["interval"] = numbers({l.interval().first, l.interval().second});
  }
  return out;
}

Json interval(const Interval& i) {
  return std::isfinite(i.low) ? numbers({i.low, i.high}) : Json(nullptr);
}

Json held_out_table(const std::vector<HeldOutError>& sensors) {
  Json out = Json::object();
  for (const HeldOutError& e : sensors) {
    Json one = {{"unit", e.unit},
                {"points", e.points},
                {"missing", e.missing},
                {"blocks", e.blocks},
                {"by", e.by_target ? "target" : "sample"},
                {"rms", number(e.rms)},
                {"rms_95", interval(e.of_rms)},
                {"rms_as_read", number(e.rms_as_read)},
                {"rms_as_read_95", interval(e.of_rms_as_read)},
                {"median", number(e.median)},
                {"median_as_read", number(e.median_as_read)}};
    if (e.measures_pose) {
      one["rms_rotation"] = number(e.rotation);
      one["rms_rotation_95"] = interval(e.of_rotation);
      one["rms_rotation_as_read"] = number(e.rotation_as_read);
      one["rms_rotation_as_read_95"] = interval(e.of_rotation_as_read);
    }
    out[e.sensor] = one;
  }
  return out;
}

Json sigma_json(const SigmaStatistics& s) {
  return {{"rms", number(s.rms)}, {"median", number(s.median)}, {"worst", number(s.worst)}};
}

Json baselines_json(const Baselines& b) {
  Json sensors = Json::array();
  for (const Baseline& row : b.rows) {
    Json one = {{"sensor", row.sensor}, {"unit", row.unit}, {"points", row.points}};
    one["blocks"] = row.blocks;
    one["by"] = row.by_target ? "target" : "sample";
    if (b.rig) one["rig"] = number(row.rig);
    one["mounts"] = number(row.mounts);
    one["automatic"] = number(row.automatic);
    one["ratio"] = number(row.ratio);
    one["ratio_95"] = interval(row.of_ratio);
    one["worse"] = row.worse();
    sensors.push_back(one);
  }
  return {{"from", b.cross_validated ? "cross_validation" : "test"}, {"rows", sensors}};
}

Json stages_json(const StageErrors& stages) {
  Json rows = Json::array();
  for (const StageError& row : stages.rows)
    rows.push_back({{"added", row.added},
                    {"sensor", row.sensor},
                    {"unit", row.unit},
                    {"points", row.points},
                    {"blocks", row.blocks},
                    {"by", row.by_target ? "target" : "sample"},
                    {"rms", number(row.rms)},
                    {"ratio", number(row.ratio)},
                    {"ratio_95", interval(row.of_ratio)}});
  return {{"from", stages.cross_validated ? "cross_validation" : "test"}, {"rows", rows}};
}

/// What was asked for.
Json validation_json(const Validation& v) {
  Json out = Json::object();
  if (!v.held_out.empty()) out["held_out"] = v.held_out;
  if (!v.test.empty()) out["test"] = held_out_table(v.test);
  if (v.cross_validation) {
    const CrossValidation& c = *v.cross_validation;
    Json folds = Json::array();
    for (const CrossValidation::Fold& f : c.folds) {
      const char* status = !f.error.empty()            ? "failed"
                           : !f.converged || !f.judged ? "not_converged"
                           : !f.determined             ? "unobservable"
                                                       : "converged";
      folds.push_back({{"held_out", f.held_out}, {"status", status}, {"error", f.error}});
      if (c.reject) folds.back()["rejected"] = f.rejected.size();
    }
    out["cross_validation"] = {{"by", c.by_target ? "target" : "sample"},
                               {"folds", folds},
                               {"never_held_out", c.never},
                               {"sensors", held_out_table(c.sensors)}};
  }
  if (v.baselines) out["baselines"] = baselines_json(*v.baselines);
  if (v.stages) out["stages"] = stages_json(*v.stages);
  if (!v.frames.empty()) out["frames"] = Json::object();
  for (const FrameReport& f : v.frames) {
    Json workspaces = Json::object();
    for (const FrameSigma& s : f.workspaces)
      workspaces[s.workspace] = {{"postures", s.postures},
                                 {"position", sigma_json(s.position)},
                                 {"rotation", sigma_json(s.rotation)},
                                 {"position_with_readings", sigma_json(s.position_with_readings)},
                                 {"rotation_with_readings", sigma_json(s.rotation_with_readings)}};
    out["frames"][f.frame] = {
        {"base", f.base}, {"workspaces", workspaces}, {"taken_as_exact", f.held}};
  }
  if (!v.requirements.empty()) out["requirements"] = Json::array();
  for (const Judgement& j : v.requirements) {
    const Requirement& r = j.requirement;
    out["requirements"].push_back({{"require", r.text},
                                   {"name", r.name},
                                   {"from", j.from},
                                   {"unit", r.unit},
                                   {"limit", number(r.limit / r.factor)},
                                   {"measured", number(j.measured / r.factor)},
                                   {"met", j.met},
                                   {"why", j.why}});
  }
  return out;
}

Json weak_list(const std::vector<WeakDirection>& weak) {
  Json out = Json::array();
  for (const WeakDirection& w : weak) {
    Json parameters = Json::object();
    for (const auto& p : w.parameters) parameters[p.first] = p.second;
    out.push_back({{"parameters", std::move(parameters)},
                   {"unit", w.unit},
                   {"sigma", number(w.sigma)},
                   {"sigma_with_priors", number(w.sigma_with_priors)},
                   {"reason", w.reason},
                   {"joints", w.joints},
                   {"why", w.why},
                   {"cure", w.cure}});
  }
  return out;
}

void add_explanation(Json& json, const Explanation& e) {
  json["weak_directions"] = weak_list(e.weak);
  json["prior_decides"] = Json::array();
  for (const PriorDecides& p : e.prior_decides)
    json["prior_decides"].push_back({{"parameter", p.name},
                                     {"unit", p.unit},
                                     {"prior", number(p.prior)},
                                     {"sigma", number(p.sigma)}});
  json["correlations"] = Json::array();
  for (const Correlation& c : e.correlations)
    json["correlations"].push_back(
        {{"a", c.a}, {"b", c.b}, {"correlation", number(c.correlation)}});
}

const char* severity_name(Severity severity) {
  return severity == Severity::fault ? "fault" : severity == Severity::doubt ? "doubt" : "remark";
}

/// What findings and warnings have in common. `about`: the kinds that the verdict speaks of.
Json notice_json(const Notice& n, const std::vector<NoticeKind>& about) {
  Json out = {{"id", id(n.kind)},
              {"text", sentences(n)},
              {"severity", severity_name(n.severity)},
              {"what", n.what}};
  if (!n.why.empty()) out["why"] = n.why;
  if (!n.cure.empty()) out["cure"] = n.cure;
  if (!n.otherwise.empty()) out["otherwise"] = n.otherwise;
  if (std::count(about.begin(), about.end(), n.kind)) out["in_verdict"] = true;
  if (is_of_directions(n.kind)) out["of_directions"] = true;
  return out;
}

Json warning_list(const Notices& warnings, const std::vector<NoticeKind>& about = {}) {
  Json out = Json::array();
  for (const Notice& w : warnings) {
    out.push_back(notice_json(w, about));
    out.back()["names"] = names_of(w.where);
  }
  return out;
}

std::string noise_name(NoiseMode noise) {
  switch (noise) {
    case NoiseMode::latent:
      return "latent";
    case NoiseMode::marginal:
      return "marginal";
    case NoiseMode::point:
      return "point";
    default:
      return "none";
  }
}

Json loop_list(const std::vector<Loop>& loops) {
  const auto statistics_of = [](const LoopStatistics& s) -> Json {
    return {{"points", s.points}, {"rms_before", number(s.rms_before)}, {"rms", number(s.rms)}};
  };
  Json out = Json::array();
  for (const Loop& loop : loops) {
    Json one = {{"from", loop.from}, {"to", loop.to}, {"unit", loop.unit}};
    one.update(statistics_of(loop.train));
    if (loop.test.points) one["test"] = statistics_of(loop.test);
    out.push_back(std::move(one));
  }
  return out;
}

Json restarts_json(const Restarts& restarts) {
  Json out = {{"count", restarts.count},
              {"failed", restarts.failed},
              {"not_converged", restarts.not_converged},
              {"minima", Json::array()}};
  for (const Minimum& m : restarts.minima) {
    Json differs = Json::object();
    for (const auto& d : m.differs) differs[d.first] = number(d.second);
    out["minima"].push_back({{"cost", number(m.cost)},
                             {"chi2", number(m.chi2)},
                             {"count", m.count},
                             {"differs", differs}});
  }
  return out;
}

Json automatic_list(const std::vector<AutomaticGroup>& groups) {
  Json out = Json::array();
  for (const AutomaticGroup& g : groups) {
    Json members = Json::array(), unseen = Json::array(), largest = Json::array();
    std::vector<const AutomaticNumber*> order;
    for (const AutomaticNumber& n : g.numbers) {
      members.push_back(n.name);
      if (n.value != 0) order.push_back(&n);
    }
    for (const AutomaticNumber& n : g.unseen) unseen.push_back(n.name);
    std::stable_sort(order.begin(), order.end(),
                     [](const AutomaticNumber* a, const AutomaticNumber* b) {
                       return std::abs(a->value) / a->sigma > std::abs(b->value) / b->sigma;
                     });
    for (size_t i = 0; i < order.size() && i < 3; ++i)
      largest.push_back({{"parameter", order[i]->name},
                         {"value", number(order[i]->value)},
                         {"sigma", number(order[i]->sigma)}});
    const AutomaticNumber* first = !g.numbers.empty() ? &g.numbers[0] : &g.unseen[0];
    out.push_back({{"group", g.name},
                   {"members", members},
                   {"unseen", unseen},
                   {"n", g.numbers.size()},
                   {"gamma", number(g.gamma)},
                   {"unit", first->unit},
                   {"width", number(first->width)},
                   {"start", number(first->width / g.factor)},
                   {"gain", number(g.gain)},
                   {"held", g.held},
                   {"largest", largest}});
  }
  return out;
}

Json held_list(const std::vector<AutomaticGroup>& groups) {
  Json out = Json::array();
  for (const AutomaticGroup& g : groups) {
    for (const AutomaticNumber& n : g.numbers)
      if (n.held)
        out.push_back({{"parameter", n.name},
                       {"reason", n.undetermined() ? "undetermined" : "no_gain"},
                       {"sigma", number(n.sigma)},
                       {"text", held_text(n)}});
    for (const AutomaticNumber& n : g.unseen)
      out.push_back({{"parameter", n.name},
                     {"reason", "undetermined"},
                     {"sigma", number(n.sigma)},
                     {"text", held_text(n)}});
  }
  return out;
}

/// Does the number of a ripple's, coupling's or distortion's components leave their names open?
bool has_own_names(const Parameter& p, const ParameterEstimate& e) {
  if (p.kind == ParameterKind::coupling || p.kind == ParameterKind::ripple) return true;
  return !e.components.empty() &&
         (e.components[0] == "xi" || e.components.back() == "s4" || e.components.back() == "tau_y");
}

Json more_data_json(const MoreData& more) {
  return {{"error", number(more.now)},
          {"thrice", number(more.thrice)},
          {"readings", number(more.readings)},
          {"worth", more.worth},
          {"open", more.open}};
}

Json bending_json(const Report& report) {
  Json out = Json::object();
  for (const Deflection& d : report.deflections)
    out[d.frame] = {{"samples", d.samples},
                    {"mean", d.mean},
                    {"largest", d.largest},
                    {"sample", report.solution.samples()[d.largest_in].id}};
  return out;
}

Json curves_json(const Report& report) {
  Json out = Json::object();
  for (const JointCurve& c : report.curves) {
    const Joint& joint = report.solution.rig().tree.joints[c.joint];
    out[joint.name] = {{"unit", joint.type == JointType::prismatic ? "m" : "rad"},
                       {"rms", number(c.rms)},
                       {"reading", numbers(c.reading)},
                       {"error", numbers(c.error)},
                       {"sigma", numbers(c.sigma)}};
  }
  return out;
}

const char* outcome_name(TriedGroup::Outcome outcome) {
  switch (outcome) {
    case TriedGroup::Outcome::kept:
      return "kept";
    case TriedGroup::Outcome::no_evidence:
      return "no_evidence";
    case TriedGroup::Outcome::no_better_held_out:
      return "no_better_held_out";
    case TriedGroup::Outcome::too_few_samples:
      return "too_few_samples";
    default:
      return "lost";
  }
}

Json tried_list(const std::vector<TriedGroup>& tried) {
  Json out = Json::array();
  for (const TriedGroup& one : tried)
    out.push_back(
        {{"group", one.name}, {"gain", number(one.gain)}, {"outcome", outcome_name(one.outcome)}});
  return out;
}

Json rejected_list(const std::vector<Rejected>& rejected) {
  Json list = Json::array();
  for (const Rejected& r : rejected) {
    Json one = {{"sample", r.sample}};
    if (!r.sensor.empty()) one["sensor"] = r.sensor, one["target"] = r.target;
    if (!r.ids.empty()) one["ids"] = r.ids;
    one["reason"] = r.reason;
    list.push_back(one);
  }
  return list;
}

}  // namespace

std::string status_name(Status status) {
  switch (status) {
    case Status::converged:
      return "converged";
    case Status::unobservable:
      return "unobservable";
    case Status::unexplained:
      return "unexplained";
    default:
      return "not_converged";
  }
}

Json result_json(const Report& report) {
  const Solution& solution = report.solution;
  const Rig& rig = solution.rig();
  Json json;
  json["status"] = status_name(solution.status);
  json["noise"] = noise_name(solution.noise);
  json["chi2"] = number(solution.chi2);
  json["cost"] = number(solution.cost);
  json["dof"] = solution.dof;
  json["chi2_data"] = number(solution.chi2_data);
  json["dof_data"] = number(solution.dof_data);
  json["steps"] = Json::array();
  for (const StepResult& s : solution.steps) {
    Json history = Json::array();
    for (const auto& h : s.history) history.push_back(numbers({h.first, h.second}));
    json["steps"].push_back({{"step", s.name},
                             {"status", s.converged ? "converged" : "not_converged"},
                             {"iterations", s.iterations},
                             {"chi2_initial", number(s.chi2_initial)},
                             {"chi2", number(s.chi2)},
                             {"cost", number(s.cost)},
                             {"dof", s.dof},
                             {"chi2_data", number(s.chi2_data)},
                             {"dof_data", number(s.dof_data)},
                             {"seconds", s.seconds},
                             {"linear_solver", s.linear_solver},
                             {"history", std::move(history)},
                             {"unused", s.unused},
                             {"held_out", s.held_out},
                             {"unobservable", directions(s.unobservable)}});
  }
  json["parameters"] = Json::object();
  const std::vector<int> open = open_poses(rig, solution.table());
  for (const ParameterEstimate& e : solution.parameters) {
    Json one = {{"unit", e.units},
                {"initial", numbers(e.initial)},
                {"value", numbers(e.value)},
                {"sigma", numbers(e.sigma)},
                {"step", e.step}};
    if (e.pose) one["pose"] = pose(*e.pose);
    if (std::count(open.begin(), open.end(), e.parameter)) one["nominal"] = false;
    if (has_own_names(solution.table().all[e.parameter], e)) one["components"] = e.components;
    json["parameters"][e.name] = std::move(one);
  }
  // (Found by number: by name each would be looked for among all.)
  std::vector<std::pair<std::string, Json>> placed;
  std::vector<size_t> place(solution.samples().size(), 0);  // in it, from 1; 0: not there
  const auto sample = [&](int i) -> Json& {
    if (!place[i]) {
      placed.push_back({solution.samples()[i].id,
                        {{"targets", Json::object()}, {"joint_errors", Json::object()}}});
      place[i] = placed.size();
    }
    return placed[place[i] - 1].second;
  };
  const bool few = solution.samples().size() <= kMostSamples;  // else samples.csv alone has them
  for (const auto& t : few ? solution.values.targets : decltype(solution.values.targets)())
    sample(t.first.first)["targets"][rig.targets[t.first.second].name] = pose(t.second);
  for (const auto& e : few ? solution.values.errors : decltype(solution.values.errors)())
    sample(e.first.first)["joint_errors"][rig.tree.joints[e.first.second].name] = number(e.second);
  json["samples"] = Json::object();
  for (auto& [id, values] : placed)
    json["samples"].get_ref<Json::object_t&>().emplace_back(id, std::move(values));
  json["sensors"] = sensor_table(report.residuals.sensors, true);
  if (report.restarts) json["restarts"] = restarts_json(*report.restarts);
  json["noise_levels"] = noise_table(report.noise_levels);
  if (report.noise_estimated)
    json["noise_estimated"] = {{"rounds", report.noise_estimated->count},
                               {"converged", report.noise_estimated->converged},
                               {"stated", number(report.noise_estimated->stated)}};
  json["validation"] = validation_json(report.validation);
  if (!report.loops.empty()) json["loops"] = loop_list(report.loops);
  if (report.more) json["more_data"] = more_data_json(*report.more);
  json["unobservable"] = directions(solution.unobservable);
  add_explanation(json, report.explanation);
  json["findings"] = report.diagnosis
                         ? findings_json(report.diagnosis->findings, report.verdict.about)
                         : Json::array();
  if (!report.automatic.empty()) {
    json["automatic"] = automatic_list(report.automatic);
    json["held"] = held_list(report.automatic);
  }
  if (!report.tried.empty()) json["tried"] = tried_list(report.tried);
  if (!report.deflections.empty()) json["bending"] = bending_json(report);
  if (!report.curves.empty()) json["curves"] = curves_json(report);
  json["rejected"] = rejected_list(report.rejected);
  json["leverage"] = Json::array();
  for (const Leverage& l : report.leverage)
    json["leverage"].push_back({{"sample", l.sample},
                                {"parameter", l.parameter},
                                {"moved_sigmas", number(l.moved_sigmas)}});
  json["warnings"] = warning_list(report.warnings, report.verdict.about);
  return json;
}

Json evaluation_json(const Evaluation& evaluation, const Notices& warnings) {
  return {{"chi2", number(evaluation.chi2)},
          {"dof", evaluation.dof},
          {"sensors", sensor_table(evaluation.sensors, false)},
          {"warnings", warning_list(warnings)}};
}

Json findings_json(const Notices& findings, const std::vector<NoticeKind>& about) {
  Json out = Json::array();
  for (const Notice& f : findings) {
    out.push_back(notice_json(f, about));
    Json& one = out.back();
    one["where"] = names_of(f.where);
    one["chi2_as_is"] = f.chi2_as_is ? number(*f.chi2_as_is) : Json(nullptr);
    one["chi2_corrected"] = f.chi2_corrected ? number(*f.chi2_corrected) : Json(nullptr);
  }
  return out;
}

Json verdict_json(const Verdict& v) {
  Json see = Json::array();
  for (const NoticeKind kind : v.see) see.push_back(id(kind));
  return {{"use", v.use},         {"text", sentences(v)}, {"why", v.why}, {"next", v.next},
          {"reasons", v.reasons}, {"notes", notes(v)},    {"see", see}};
}

Json alternatives_json(std::vector<Alternative> alternatives) {
  std::stable_sort(
      alternatives.begin(), alternatives.end(),
      [](const Alternative& a, const Alternative& b) { return a.log_odds > b.log_odds; });
  Json out = Json::array();
  for (const Alternative& a : alternatives)
    out.push_back(
        {{"id", id(a.kind)}, {"where", names_of(a.where)}, {"log_odds", number(a.log_odds)}});
  return out;
}

Json diagnosis_json(const Diagnosis& d) {
  return {{"findings", findings_json(d.findings)},
          {"alternatives", alternatives_json(d.alternatives)},
          {"chi2", d.chi2 ? number(*d.chi2) : Json(nullptr)},
          {"dof", d.dof},
          {"verdict", d.verdict},
          {"tested", d.tested}};
}

}  // namespace kincal
