// Problems and results of the C interface: texts in, texts and numbers out, over io/job.
#include "kincal.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <new>
#include <optional>
#include <stdexcept>

#include "../../io/document/files.h"
#include "../../io/document/json.h"
#include "../../io/document/names.h"
#include "../../io/job/settings.h"
#include "../../io/results/csv.h"
#include "../../models/rig/numbers.h"
#include "handles.h"

namespace kincal {

// ------------------------------------------------------------------------------------------------
// errors
void copy_text(char* to, size_t size, const std::string& from) {
  size_t end = std::min(from.size(), size - 1);
  if (end < from.size())
    while (end > 0 && (static_cast<unsigned char>(from[end]) & 0xC0) == 0x80) --end;
  from.copy(to, end);
  std::fill(to + end, to + size, '\0');
}

namespace {

kincal_status tell(kincal_error* error, kincal_status status, const std::string& message) {
  if (!error || error->size < sizeof(kincal_error)) return status;
  kincal_error out = KINCAL_ERROR_INIT;
  const Place place = place_of(message);
  out.status = status;
  out.line = place.line;
  copy_text(out.message, sizeof out.message, message);
  copy_text(out.file, sizeof out.file, place.file);
  copy_text(out.name, sizeof out.name, place.name);
  write_struct(error, out);
  return status;
}

}  // namespace

kincal_status tell_thrown(kincal_error* error) noexcept {
  try {
    throw;
  } catch (const std::bad_alloc&) {
    // Without more memory: no text is taken apart.
  } catch (...) {
    try {
      try {
        throw;
      } catch (const Refusal& refusal) {
        return tell(error, refusal.status, refusal.what);
      } catch (const Cancelled&) {
        return tell(error, KINCAL_CANCELLED, "the listener ended the work");
      } catch (const InputError& wrong) {
        return tell(error, KINCAL_INPUT, wrong.what());
      } catch (const std::invalid_argument& wrong) {
        return tell(error, KINCAL_INPUT, wrong.what());
      } catch (const std::runtime_error& failed) {
        return tell(error, KINCAL_NUMERICAL, failed.what());
      } catch (const std::exception& failed) {
        return tell(error, KINCAL_INTERNAL, failed.what());
      } catch (...) {
        return tell(error, KINCAL_INTERNAL, "an unknown exception");
      }
    } catch (...) {
      // No memory to tell it.
    }
  }
  if (error && error->size >= sizeof(kincal_error)) {
    const size_t size = error->size;
    std::memset(error, 0, sizeof(kincal_error));
    error->size = size;
    error->status = KINCAL_MEMORY;
    std::memcpy(error->message, "no memory is left", 18);
  }
  return KINCAL_MEMORY;
}

// ------------------------------------------------------------------------------------------------
// arguments
std::string text_of(const kincal_text* text, const char* argument) {
  const kincal_text& of = given(text, argument);
  if (of.size == 0) return "";
  return std::string(&given(of.data, argument), of.size);
}

std::string name_of(const kincal_text& text, const char* usual) {
  return text.name && *text.name ? text.name : usual;
}

std::vector<std::string> list_of(const kincal_names& names, const char* argument) {
  std::vector<std::string> out;
  if (names.count > 0) given(names.names, argument);
  for (size_t i = 0; i < names.count; ++i) {
    const std::string where = std::string(argument) + "[" + std::to_string(i) + "]";
    out.emplace_back(&given(names.names[i], where.c_str()));
  }
  return out;
}

NamesByKind names_of(const Rig& rig, const ParameterTable& table) {
  NamesByKind out;
  out[KINCAL_JOINTS] = joint_names(rig);
  for (const Sensor& sensor : rig.sensors) out[KINCAL_SENSORS].push_back(sensor.name);
  for (const Target& target : rig.targets) out[KINCAL_TARGETS].push_back(target.name);
  for (const Frame& frame : all_frames(rig, table)) out[KINCAL_FRAMES].push_back(frame.name);
  return out;
}

const char* name_at(const NamesByKind& names, int32_t kind, size_t index) {
  if (kind < 0 || static_cast<size_t>(kind) >= names.size()) return nullptr;
  const std::vector<std::string>& of = names[static_cast<size_t>(kind)];
  return index < of.size() ? of[index].c_str() : nullptr;
}

std::vector<char> with_end(const std::string& text) {
  return std::vector<char>(text.c_str(), text.c_str() + text.size() + 1);
}

Progress progress_of(const kincal_progress* progress) {
  if (!progress) return {};
  const kincal_progress listened = sized(progress, "progress");
  if (!listened.listener) return {};
  return Progress([listened](const Progress::News& told) {
    const kincal_news news = {sizeof(kincal_news), told.what.c_str(), told.share,
                              told.chi2,           told.iteration,    0};
    return listened.listener(&news, listened.user) == 0;
  });
}

namespace {

std::shared_ptr<const KnownRig> read_known(const std::string& rig, const std::string& rig_path,
                                           const std::string& urdf, const std::string& urdf_path) {
  const Urdf robot = urdf.empty() ? Urdf() : parse_urdf(urdf, urdf_path);
  return std::make_shared<const KnownRig>(parse_rig(rig, rig_path, &robot));
}

std::unique_ptr<kincal_problem> make_problem(std::shared_ptr<const KnownRig> rig,
                                             const kincal_text* samples) {
  SampleSet set{"", "", std::make_shared<const std::vector<Sample>>()};
  if (samples)
    set = parse_sample_set(text_of(samples, "samples"), name_of(*samples, "samples.jsonl"),
                           rig->file.rig);
  NamesByKind names = names_of(rig->file.rig, rig->table);
  for (const Sample& sample : *set.samples) names[KINCAL_SAMPLES].push_back(sample.id);
  return std::unique_ptr<kincal_problem>(
      new kincal_problem{std::move(rig), std::move(set), std::move(names)});
}

// ------------------------------------------------------------------------------------------------
// results
/// A list of as many numbers, or nulls.
std::vector<double> numbers_of(const Field& field, int count) {
  std::vector<double> out;
  if (field.node->kind != Node::Kind::sequence || static_cast<int>(field.size()) != count)
    field.fail("a list of a number a component is expected");
  for (int i = 0; i < count; ++i) {
    const Field item = field.item(static_cast<size_t>(i));
    out.push_back(item.node->kind == Node::Kind::null ? kNan : item.number());
  }
  return out;
}

std::vector<kincal_component> components_of(const Field& parameters, const CalibratedFiles& files) {
  std::vector<kincal_component> out;
  for (const auto& [name, ignored] : parameters.members()) {
    const Field one = parameters[name];
    const int p = find_parameter(files.table, name);
    const Parameter& parameter = files.table.all[p];
    const std::vector<double> initial = numbers_of(one["initial"], parameter.size()),
                              value = numbers_of(one["value"], parameter.size());
    const std::vector<double>& sigma = files.sigma.at(name);
    for (int c = 0; c < parameter.size(); ++c) {
      kincal_component component{};
      const auto i = static_cast<size_t>(c);
      component.size = sizeof component;
      component.initial = initial[i];
      component.value = value[i];
      component.sigma = sigma[i];
      component.row = -1;
      if (files.unknowns) {
        const std::vector<Component>& columns = files.unknowns->columns;
        const auto found = std::find(columns.begin(), columns.end(), Component{p, c});
        if (found != columns.end()) component.row = found - columns.begin();
      }
      copy_text(component.name, sizeof component.name, parameter.component_name(c));
      copy_text(component.unit, sizeof component.unit, parameter.units[i]);
      out.push_back(component);
    }
  }
  return out;
}

std::unique_ptr<kincal_result> make_result(ResultFiles files) {
  CalibratedFiles calibrated = parse_calibrated(files, "result");
  const std::string path = "result/result.json";
  const Node node = parse_json(files.result_json, path);
  const Field all = top(node, path);
  std::vector<kincal_component> components = components_of(all["parameters"], calibrated);
  kincal_summary summary{};
  summary.size = sizeof summary;
  summary.chi2 = all["chi2"].node->kind == Node::Kind::null ? kNan : all["chi2"].number();
  summary.dof = static_cast<int64_t>(all["dof"].number_at_least(0));
  summary.components = components.size();
  summary.rows = calibrated.unknowns ? calibrated.unknowns->columns.size() : 0;
  copy_text(summary.status, sizeof summary.status, calibrated.status);
  copy_text(summary.use, sizeof summary.use, all["verdict"]["use"].string());
  auto rig = std::make_shared<const KnownRig>(calibrated.rig_file);
  std::shared_ptr<const KnownRig> planned;
  if (!files.rig_rigid.empty())
    planned =
        read_known(files.rig_rigid, "result/rig_rigid.yaml", files.robot_urdf, "result/robot.urdf");
  NamesByKind names = names_of(rig->file.rig, rig->table);
  for_each_csv_row(files.samples_csv, [&](const std::vector<std::string>& row) {
    names[KINCAL_SAMPLES].push_back(row[0]);
  });
  if (!names[KINCAL_SAMPLES].empty())  // its header
    names[KINCAL_SAMPLES].erase(names[KINCAL_SAMPLES].begin());
  return std::unique_ptr<kincal_result>(
      new kincal_result{std::move(files), std::move(calibrated), std::move(rig), std::move(planned),
                        std::move(components), summary, std::move(names)});
}

/// The texts that there are, and the page, which is made when it is asked for.
std::vector<const char*> file_names(const ResultFiles& files) {
  std::vector<const char*> out;
  for (const auto& [name, text] : result_file_names())
    if (!(files.*text).empty() || text == &ResultFiles::report_html) out.push_back(name);
  return out;
}

constexpr int kFixed = -1, kOpen = -2;  // instead of a row: of a component that has none

/// The part of the covariance in these rows, row by row; NaN: not determined.
std::vector<double> covariance_of(const Unknowns& unknowns, const std::vector<int>& rows) {
  const MatrixXd& c = unknowns.covariance;
  const Eigen::VectorXd open =
      unknowns.undetermined.cols() > 0
          ? Eigen::VectorXd(unknowns.undetermined.cwiseAbs().rowwise().sum())
          : Eigen::VectorXd::Zero(c.rows());
  const auto is_open = [&](int row) { return row == kOpen || (row >= 0 && open(row) > 0); };
  std::vector<double> out;
  out.reserve(rows.size() * rows.size());
  for (const int i : rows)
    for (const int j : rows)
      out.push_back(is_open(i) || is_open(j) ? kNan : i == kFixed || j == kFixed ? 0 : c(i, j));
  return out;
}

/// The rows of a component, or of all those of a parameter. @throws InputError
std::vector<int> rows_of(const kincal_result& result, const std::string& name,
                         const std::string& where) {
  const ParameterTable& table = result.calibrated.table;
  const std::vector<Component>& columns = result.calibrated.unknowns->columns;
  std::vector<int> out;
  std::vector<std::string> all;
  for (size_t p = 0; p < table.all.size(); ++p)
    for (int c = 0; c < table.all[p].size(); ++c) {
      const Component component{static_cast<int>(p), c};
      all.push_back(table.name(component));
      if (table.all[p].name != name && all.back() != name) continue;
      const auto column = std::find(columns.begin(), columns.end(), component);
      const auto sigma = result.calibrated.sigma.find(table.all[p].name);
      if (column != columns.end())
        out.push_back(static_cast<int>(column - columns.begin()));
      else if (sigma == result.calibrated.sigma.end())
        throw InputError(where + ": '" + name + "' was not estimated");
      else
        out.push_back(sigma->second[static_cast<size_t>(c)] == 0 ? kFixed : kOpen);
    }
  if (out.empty())
    throw InputError(where + ": there is no parameter '" + name + "'" + nearest_names(name, all));
  return out;
}

/// What stands in residuals.csv. @throws InputError
std::vector<kincal_residual> read_residuals(const kincal_result& result) {
  constexpr size_t kFields = 16;
  std::map<std::string, int64_t> samples;
  for (const std::string& id : result.names[KINCAL_SAMPLES])
    samples.emplace(id, static_cast<int64_t>(samples.size()));
  const Rig& rig = result.rig->file.rig;
  std::vector<kincal_residual> out;
  size_t line = 0;
  for_each_csv_row(result.files.residuals_csv, [&](const std::vector<std::string>& row) {
    const std::string where = "result/residuals.csv:" + std::to_string(++line);
    if (row.size() < kFields) throw InputError(where + ": 16 fields are expected");
    if (line == 1) return;
    const auto index = [&](const auto& of, const std::string& name) {
      const auto found =
          std::find_if(of.begin(), of.end(), [&](const auto& one) { return one.name == name; });
      if (found == of.end())
        throw InputError(where + ": '" + name + "' is not in the rig beside it");
      return static_cast<int32_t>(found - of.begin());
    };
    const auto number = [&](size_t field, double otherwise) {
      return row[field].empty() ? otherwise : csv_number(row[field], where);
    };
    const auto sample = samples.find(row[0]);
    if (sample == samples.end())
      throw InputError(where + ": sample '" + row[0] + "' is not in samples.csv");
    kincal_residual one{};
    one.sample = sample->second;
    one.held_out = row[1] == "test";
    one.sensor = index(rig.sensors, row[2]);
    one.target = index(rig.targets, row[3]);
    one.count = rig.sensors[static_cast<size_t>(one.sensor)].model->rows();
    const double point = number(4, -1);
    if (std::abs(point) > 1e9) throw InputError(where + ": id: there is no such point");
    one.point = static_cast<int64_t>(point);
    for (size_t i = 0; i < 6; ++i) one.value[i] = number(6 + i, 0);
    for (size_t i = 0; i < 3; ++i) one.before[i] = number(12 + i, kNan);
    one.whitened = number(15, kNan);
    out.push_back(one);
  });
  return out;
}

/// Readings of the joints that have one in `values`.
Postures one_posture(const kincal_result& result, const double* values, size_t count,
                     std::vector<double>& known) {
  const std::vector<std::string>& joints = result.names[KINCAL_JOINTS];
  if (count != joints.size())
    throw InputError("readings: " + std::to_string(joints.size()) +
                     " are expected, one a joint, not " + std::to_string(count));
  Postures out;
  for (size_t i = 0; i < count; ++i)
    if (const double value = (&given(values, "readings"))[i]; !std::isnan(value)) {
      out.joints.push_back(joints[i]);
      known.push_back(value);
    }
  out.values = known.data();
  out.rows = 1;
  return out;
}

/// Readings that compensate at one posture.
kincal_status compensate_at(const kincal_result* result, std::optional<double> temperature,
                            kincal_compensation* compensation, kincal_error* error) {
  return guarded(error, [&] {
    kincal_compensation wish = sized(compensation, "compensation");
    const kincal_result& of = given(result, "result");
    if (!of.planned)
      throw InputError("compensate: there is nothing to compensate: robot.urdf has all of it");
    if (temperature && !std::isfinite(*temperature))
      throw InputError("temperature: must be finite, degrees Celsius");
    const CompensationWish how = {&given(wish.tip, "tip"), wish.base ? wish.base : "",
                                  wish.position_only != 0, temperature};
    std::vector<double> known;
    const Postures posture = one_posture(of, wish.planned, wish.count, known);
    given(wish.readings, "readings");
    const Compensated found = compensate_postures(*of.rig, *of.planned, posture, how).front();
    const Tree& tree = of.rig->file.rig.tree;
    for (size_t i = 0; i < wish.count; ++i)
      wish.readings[i] = std::isnan(wish.planned[i])
                             ? kNan
                             : found.readings[tree.find_joint(of.names[KINCAL_JOINTS][i])];
    wish.position = found.position;
    wish.rotation = found.rotation;
    write_struct(compensation, wish);
  });
}

}  // namespace
}  // namespace kincal

// ------------------------------------------------------------------------------------------------
// the interface
using namespace kincal;

const char* kincal_version(void) { return KINCAL_VERSION; }

kincal_status kincal_problem_new(const kincal_text* rig, const kincal_text* urdf,
                                 const kincal_text* samples, kincal_problem** problem,
                                 kincal_error* error) {
  return guarded(error, [&] {
    given(problem, "problem");
    const std::string rig_text = text_of(rig, "rig"), robot = urdf ? text_of(urdf, "urdf") : "";
    const std::string robot_path = urdf ? name_of(*urdf, "robot.urdf") : "";
    if (urdf && robot.empty()) throw InputError(robot_path + ": is empty");
    *problem =
        make_problem(read_known(rig_text, name_of(*rig, "rig.yaml"), robot, robot_path), samples)
            .release();
  });
}

void kincal_problem_free(kincal_problem* problem) { delete problem; }

size_t kincal_problem_samples(const kincal_problem* problem) {
  return problem ? problem->samples.samples->size() : 0;
}

const char* kincal_problem_name(const kincal_problem* problem, int32_t kind, size_t index) {
  return problem ? name_at(problem->names, kind, index) : nullptr;
}

kincal_status kincal_calibrate(const kincal_problem* problem, const char* settings,
                               const kincal_progress* progress, kincal_result** result,
                               kincal_error* error) {
  return guarded(error, [&] {
    given(result, "result");
    const kincal_problem& of = given(problem, "problem");
    if (of.samples.samples->empty()) throw InputError("samples: the problem has none");
    CalibrateSettings read = parse_settings(settings ? settings : "{}");
    read.command = "kincal_calibrate(" + of.rig->file.path + ", " + of.samples.path + ", " +
                   (settings ? settings : "NULL") + ")";
    FinishedJob done = calibrate_job(of.rig->file, of.samples, read, progress_of(progress));
    if (const std::string why = why_no_start(done.report); !why.empty())
      throw Refusal{KINCAL_NUMERICAL, why};
    *result = make_result(std::move(done.files)).release();
  });
}

kincal_status kincal_result_read(const kincal_text* files, size_t count, kincal_result** result,
                                 kincal_error* error) {
  return guarded(error, [&] {
    given(result, "result");
    ResultFiles texts;
    std::vector<std::string> valid;
    for (const auto& [name, text] : result_file_names()) valid.emplace_back(name);
    for (size_t i = 0; i < count; ++i) {
      const kincal_text& file = (&given(files, "files"))[i];
      const std::string where = "files[" + std::to_string(i) + "]", name = name_of(file, "");
      const auto found = std::find(valid.begin(), valid.end(), name);
      if (found == valid.end())
        throw InputError(where + ": '" + name + "' is no file of a result" +
                         nearest_or_all(name, valid, "there are"));
      texts.*result_file_names()[static_cast<size_t>(found - valid.begin())].second =
          text_of(&file, where.c_str());
    }
    *result = make_result(std::move(texts)).release();
  });
}

void kincal_result_free(kincal_result* result) { delete result; }

kincal_status kincal_result_summary(const kincal_result* result, kincal_summary* summary,
                                    kincal_error* error) {
  return guarded(error, [&] {
    sized(summary, "summary");
    write_struct(summary, given(result, "result").summary);
  });
}

const char* kincal_result_file_name(const kincal_result* result, size_t index) {
  if (!result) return nullptr;
  size_t at = 0;
  for (const auto& [name, text] : result_file_names())
    if ((!(result->files.*text).empty() || text == &ResultFiles::report_html) && at++ == index)
      return name;
  return nullptr;
}

kincal_status kincal_result_file(const kincal_result* result, const char* name, char* buffer,
                                 size_t size, size_t* needed, kincal_error* error) {
  return guarded(error, [&] {
    const ResultFiles& files = given(result, "result").files;
    const std::string wanted = &given(name, "name");
    const std::vector<const char*> there = file_names(files);
    if (std::find(there.begin(), there.end(), wanted) == there.end())
      throw InputError("name: the result has no file '" + wanted + "'" +
                       nearest_or_all(wanted, {there.begin(), there.end()}, "there are"));
    for (const auto& [known, text] : result_file_names())
      if (wanted == known)
        to_buffer(
            with_end(text == &ResultFiles::report_html && (files.*text).empty() ? make_page(files)
                                                                                : files.*text),
            buffer, size, needed);
  });
}

kincal_status kincal_result_component(const kincal_result* result, size_t index,
                                      kincal_component* component, kincal_error* error) {
  return guarded(error, [&] {
    sized(component, "component");
    write_struct(component, element(given(result, "result").components, index, "index"));
  });
}

kincal_status kincal_result_covariance(const kincal_result* result, double* buffer, size_t count,
                                       size_t* needed, kincal_error* error) {
  return guarded(error, [&] {
    const std::optional<Unknowns>& unknowns = given(result, "result").calibrated.unknowns;
    std::vector<int> rows;
    for (size_t i = 0; unknowns && i < unknowns->columns.size(); ++i)
      rows.push_back(static_cast<int>(i));
    to_buffer(unknowns ? covariance_of(*unknowns, rows) : std::vector<double>(), buffer, count,
              needed);
  });
}

kincal_status kincal_result_covariance_of(const kincal_result* result, const kincal_names* names,
                                          double* buffer, size_t count, size_t* needed,
                                          kincal_error* error) {
  return guarded(error, [&] {
    const kincal_result& of = given(result, "result");
    const std::vector<std::string> wanted = list_of(given(names, "names"), "names");
    if (!of.calibrated.unknowns)
      throw InputError("names: the result has no covariance (covariance.csv)");
    std::vector<int> rows;
    for (size_t i = 0; i < wanted.size(); ++i)
      for (const int row : rows_of(of, wanted[i], "names[" + std::to_string(i) + "]"))
        rows.push_back(row);
    to_buffer(covariance_of(*of.calibrated.unknowns, rows), buffer, count, needed);
  });
}

kincal_status kincal_result_residuals(const kincal_result* result, kincal_residual* buffer,
                                      size_t residual_size, size_t count, size_t* needed,
                                      kincal_error* error) {
  return guarded(error, [&] {
    const kincal_result& of = given(result, "result");
    for (const auto& [text, name] : {std::pair(&of.files.residuals_csv, "residuals.csv"),
                                     std::pair(&of.files.samples_csv, "samples.csv")})
      if (text->empty()) throw InputError(std::string("residuals: the result has no ") + name);
    residuals_to_buffer(read_residuals(of), buffer, residual_size, count, needed);
  });
}

const char* kincal_result_name(const kincal_result* result, int32_t kind, size_t index) {
  return result ? name_at(result->names, kind, index) : nullptr;
}

kincal_status kincal_result_forward(const kincal_result* result, const double* readings,
                                    size_t count, const char* frame, const char* base,
                                    double pose[16], kincal_error* error) {
  return guarded(error, [&] {
    const kincal_result& of = given(result, "result");
    const Rig& rig = of.rig->file.rig;
    const std::string tip = &given(frame, "frame"),
                      from = base ? base : rig.tree.links[rig.base].c_str();
    given(pose, "pose");
    std::vector<double> known;
    const Postures posture = one_posture(of, readings, count, known);
    double out[16];
    forward_poses(*of.rig, posture, tip, from, out);
    std::memcpy(pose, out, sizeof out);
  });
}

kincal_status kincal_result_compensate(const kincal_result* result,
                                       kincal_compensation* compensation, kincal_error* error) {
  return compensate_at(result, std::nullopt, compensation, error);
}

kincal_status kincal_result_compensate_at(const kincal_result* result, double temperature,
                                          kincal_compensation* compensation, kincal_error* error) {
  return compensate_at(result, temperature, compensation, error);
}

kincal_status kincal_result_problem(const kincal_result* result, const kincal_text* samples,
                                    kincal_problem** problem, kincal_error* error) {
  return guarded(error, [&] {
    given(problem, "problem");
    given(samples, "samples");
    *problem = make_problem(given(result, "result").rig, samples).release();
  });
}
