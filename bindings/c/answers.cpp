// What is found without a calibration, in C: evaluations, checks, plans and verifications.
#include <algorithm>
#include <cmath>
#include <cstring>

#include "../../io/document/json.h"
#include "../../io/document/names.h"
#include "../../io/job/certificate.h"
#include "../../io/job/check.h"
#include "../../io/job/plan.h"
#include "../../io/job/plan_verify.h"
#include "../../io/job/settings.h"
#include "../../io/job/verify.h"
#include "../../io/report/certificate.h"
#include "../../io/results/result_json.h"
#include "../../models/rig/numbers.h"
#include "handles.h"

namespace kincal {

void residuals_to_buffer(const std::vector<kincal_residual>& from, kincal_residual* buffer,
                         size_t size, size_t count, size_t* needed) {
  if (needed) *needed = from.size();
  if (!buffer && count == 0) return;
  if (size < sizeof(kincal_residual))
    throw Refusal{KINCAL_USAGE, "residual_size: " + std::to_string(size) +
                                    " is not the size of a residual (" +
                                    std::to_string(sizeof(kincal_residual)) + ")"};
  if (count < from.size())
    throw Refusal{KINCAL_TOO_SMALL, "the buffer has room for " + std::to_string(count) +
                                        ", but there are " + std::to_string(from.size())};
  char* const to = reinterpret_cast<char*>(&given(buffer, "buffer"));
  for (size_t i = 0; i < from.size(); ++i) {
    kincal_residual one = from[i];
    one.size = size;
    std::memcpy(to + i * size, &one, sizeof one);
  }
}

namespace {

constexpr double kMostCorner = 1e6;  // m

/// Settings of a plan or a verification, read from a JSON mapping.
struct Options {
  std::string path = "settings";
  Node node;

  Options(const char* json, const std::vector<std::string>& names)
      : node(parse_json(json ? json : "{}", path)) {
    if (node.kind != Node::Kind::mapping)
      top(node, path).fail("a mapping of options to values is expected");
    for (const auto& [name, ignored] : node.members)
      if (std::find(names.begin(), names.end(), name) == names.end())
        throw InputError(name + ": there is no such option" +
                         nearest_or_all(name, names, "there are"));
  }

  /// Returns the value of an option; null: it is not given.
  const Node* find(const std::string& name) const { return node.find(name); }
  /// An option has no line: its name begins the message.
  [[noreturn]] static void fail(const std::string& name, const std::string& what) {
    throw InputError(name + ": " + what);
  }
  static bool plain(const Node& value) { return value.kind == Node::Kind::scalar && !value.quoted; }

  void read(const std::string& name, std::string& to) const {
    const Node* const value = find(name);
    if (!value) return;
    if (value->kind != Node::Kind::scalar || !value->quoted) fail(name, "a text is expected");
    to = value->text;
  }
  void read(const std::string& name, bool& to) const {
    const Node* const value = find(name);
    if (!value) return;
    if (!plain(*value) || (value->text != "true" && value->text != "false"))
      fail(name, "true or false is expected");
    to = value->text == "true";
  }
  template <class Integer>
  void read(const std::string& name, Integer& to, int low, int high) const {
    const Node* const value = find(name);
    if (!value) return;
    if (!plain(*value) || value->text.empty() ||
        value->text.find_first_not_of("+-0123456789") != std::string::npos ||
        value->text.size() > 10 || std::stoll(value->text) < low || std::stoll(value->text) > high)
      fail(name,
           "an integer in " + std::to_string(low) + " .. " + std::to_string(high) + " is expected");
    to = static_cast<Integer>(std::stoll(value->text));
  }
  /// m; null: below 0.
  void read_clearance(double& to) const {
    const Node* const value = find("clearance");
    if (!value) return;
    if (value->kind == Node::Kind::null) {
      to = -1;
      return;
    }
    double read = -1;
    if (plain(*value)) read = Field{value, &path, "clearance"}.number();
    if (!(read >= 0 && read <= 1)) fail("clearance", "a number in 0 .. 1 or null is expected");
    to = read;
  }
  void read_region(std::vector<double>& to) const {
    const Node* const value = find("region");
    if (!value) return;
    if (value->kind != Node::Kind::sequence || Field{value, &path, "region"}.size() != 6)
      fail("region", "6 numbers are expected, x y z of two corners");
    to = Field{value, &path, "region"}.vector(6);
    for (const double x : to)
      if (std::abs(x) > kMostCorner) fail("region", "a corner is too far away");
  }
};

constexpr int kMostSeed = 2'000'000'000;

const SampleSet& samples_of(const kincal_problem& problem) {
  if (problem.samples.samples->empty()) throw InputError("samples: the problem has none");
  return problem.samples;
}

/// Residuals of an evaluation, in its order.
std::vector<kincal_residual> residuals_of(const EvaluatedJob& job) {
  std::vector<kincal_residual> out;
  for (const ViewResiduals& of : job.evaluation.views) {
    const SensorModel& model = *job.recording->rig.sensors[of.view->sensor].model;
    const int rows = model.rows();
    const Eigen::Index blocks = of.raw.size() / rows,
                       white = blocks ? of.whitened.size() / blocks : 0;
    for (Eigen::Index b = 0; b < blocks; ++b) {
      kincal_residual one{};
      one.sample = of.sample;
      one.held_out = !job.recording->samples[static_cast<size_t>(of.sample)].train;
      one.sensor = of.view->sensor;
      one.target = of.view->target;
      one.point = model.measures_pose()  ? -1
                  : of.view->ids.empty() ? b
                                         : of.view->ids[static_cast<size_t>(b)];
      one.count = rows;
      std::copy_n(of.raw.data() + b * rows, rows, one.value);
      std::fill_n(one.before, 3, kNan);
      one.whitened = of.whitened.segment(b * white, white).norm();
      out.push_back(one);
    }
  }
  return out;
}

}  // namespace
}  // namespace kincal

using namespace kincal;

kincal_status kincal_evaluate(const kincal_problem* problem, const char* settings,
                              const kincal_progress* progress, kincal_answer** answer,
                              kincal_error* error) {
  return guarded(error, [&] {
    given(answer, "answer");
    const kincal_problem& of = given(problem, "problem");
    RigFile file = of.rig->file;
    const EvaluatedJob job = evaluate_samples(
        file, samples_of(of), parse_settings(settings ? settings : "{}", {"noise", "free"}),
        progress_of(progress));
    std::string json = json_text(evaluation_json(job.evaluation, job.warnings));
    std::vector<kincal_residual> residuals = residuals_of(job);
    *answer = new kincal_answer{std::move(json), {}, std::move(residuals)};
  });
}

kincal_status kincal_check(const kincal_problem* problem, const char* settings,
                           const kincal_progress* progress, kincal_answer** answer,
                           kincal_error* error) {
  return guarded(error, [&] {
    given(answer, "answer");
    const kincal_problem& of = given(problem, "problem");
    const CalibrateSettings read = parse_settings(settings ? settings : "{}", {"noise", "threads"});
    DoctorOptions options;
    options.noise = kNoiseModes.at(read.noise);
    options.threads = read.threads;
    options.progress = progress_of(progress);
    const CheckedJob job = check_samples(of.rig->file, samples_of(of), options, read.words);
    std::string json = json_text(check_json(job));
    *answer = new kincal_answer{std::move(json)};
  });
}

kincal_status kincal_plan(const kincal_problem* problem, const char* settings,
                          const kincal_progress* progress, kincal_answer** answer,
                          kincal_error* error) {
  return guarded(error, [&] {
    given(answer, "answer");
    const kincal_problem& of = given(problem, "problem");
    const Options options(settings,
                          {"next", "candidates", "seed", "goal", "postures", "clearance"});
    PlanSettings read;
    read.words = Words::keywords;
    options.read("next", read.next, 1, 1000);
    options.read("candidates", read.candidates, 10, 100'000);
    options.read("seed", read.seed, 0, kMostSeed);
    options.read("goal", read.goal);
    options.read_clearance(read.clearance);
    if (options.find("postures")) {
      read.postures = NamedText{"postures", ""};
      options.read("postures", read.postures->text);
    }
    const SampleSet* const known = of.samples.samples->empty() ? nullptr : &of.samples;
    const PosturePlan made = plan_postures(of.rig->file, known, read, progress_of(progress));
    std::string json = json_text(plan_json(made)),
                postures = postures_text(of.rig->file.rig, made.postures);
    *answer = new kincal_answer{std::move(json), {{"postures.jsonl", std::move(postures)}}};
  });
}

kincal_status kincal_plan_verification(const kincal_problem* problem, const char* settings,
                                       const kincal_progress* progress, kincal_answer** answer,
                                       kincal_error* error) {
  return guarded(error, [&] {
    given(answer, "answer");
    const kincal_problem& of = given(problem, "problem");
    const Options options(
        settings, {"sensor", "cycles", "approaches", "region", "candidates", "seed", "clearance"});
    TestPoseSettings read;
    read.words = Words::keywords;
    options.read("sensor", read.sensor);
    options.read("cycles", read.cycles, 1, 1000);
    options.read("approaches", read.approaches);
    options.read_region(read.region);
    options.read("candidates", read.candidates, 10, 100'000);
    options.read("seed", read.seed, 0, kMostSeed);
    options.read_clearance(read.clearance);
    const TestPosePlan made = plan_test_poses(of.rig->file, read, progress_of(progress));
    std::string json = json_text(test_poses_json(of.rig->file.rig, made)),
                postures = postures_text(of.rig->file.rig, made.postures);
    *answer = new kincal_answer{std::move(json), {{"postures.jsonl", std::move(postures)}}};
  });
}

kincal_status kincal_verify(const kincal_result* result, const kincal_text* samples,
                            const char* settings, kincal_answer** answer, kincal_error* error) {
  return guarded(error, [&] {
    given(answer, "answer");
    const kincal_result& of = given(result, "result");
    const std::string text = text_of(samples, "samples");
    const Options options(settings, {"tolerance", "standard", "sensor", "refit_base", "instrument",
                                     "environment", "serial", "measured"});
    VerifySettings read;
    read.words = Words::keywords;
    read.command = "kincal_verify()";
    options.read("tolerance", read.tolerance);
    options.read("standard", read.standard);
    options.read("sensor", read.sensor);
    options.read("refit_base", read.refit_base);
    options.read("instrument", read.instrument);
    options.read("environment", read.environment);
    options.read("serial", read.serial);
    options.read("measured", read.measured);
    const VerifiedResult verified{of.calibrated, of.files.result_json, of.files.samples_csv};
    const SampleSet set =
        parse_sample_set(text, name_of(*samples, "samples.jsonl"), of.rig->file.rig);
    const Verification found = verify(verified, set, read);
    std::string json = json_text(certificate_json(verified, set, found, read)),
                page = certificate_page(json);
    *answer = new kincal_answer{std::move(json), {{"certificate.html", std::move(page)}}};
  });
}

void kincal_answer_free(kincal_answer* answer) { delete answer; }

kincal_status kincal_answer_json(const kincal_answer* answer, char* buffer, size_t size,
                                 size_t* needed, kincal_error* error) {
  return guarded(error,
                 [&] { to_buffer(with_end(given(answer, "answer").json), buffer, size, needed); });
}

kincal_status kincal_answer_file(const kincal_answer* answer, const char* name, char* buffer,
                                 size_t size, size_t* needed, kincal_error* error) {
  return guarded(error, [&] {
    const kincal_answer& of = given(answer, "answer");
    const std::string wanted = &given(name, "name");
    std::vector<std::string> there;
    for (const auto& [known, text] : of.texts) {
      there.push_back(known);
      if (known != wanted) continue;
      to_buffer(with_end(text), buffer, size, needed);
      return;
    }
    throw InputError("name: the answer has no text '" + wanted + "'" +
                     (there.empty() ? "" : nearest_or_all(wanted, there, "there are")));
  });
}

kincal_status kincal_answer_residuals(const kincal_answer* answer, kincal_residual* buffer,
                                      size_t residual_size, size_t count, size_t* needed,
                                      kincal_error* error) {
  return guarded(error, [&] {
    const kincal_answer& of = given(answer, "answer");
    if (!of.residuals)
      throw InputError("answer: it has no residuals; those of kincal_evaluate() have them");
    residuals_to_buffer(*of.residuals, buffer, residual_size, count, needed);
  });
}
