// The module kincal._kincal: what the program does, as functions of texts and arrays. The package
// around it (kincal/) has the types that users see. No function changes what it is given.
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <cmath>
#include <functional>

#include "../../io/document/files.h"
#include "../../io/document/names.h"
#include "../../io/document/numbers.h"
#include "../../io/job/check.h"
#include "../../io/job/job.h"
#include "../../io/job/simulate.h"
#include "../../io/results/csv.h"
#include "../../io/results/input_files.h"
#include "../../io/results/result_json.h"
#include "../../io/rig/samples_file.h"
#include "../../io/rig/simulation_file.h"
#include "../../models/analysis/compensation.h"
#include "../../models/rig/configuration.h"
#include "text.h"
#include "watching.h"
#include "work.h"

namespace py = pybind11;

namespace kincal {
namespace {

using Array = py::array_t<double, py::array::c_style | py::array::forcecast>;
using Texts = std::map<std::string, Text>;

/// A PyRig is a rig as read, with its parameters.
struct PyRig {
  explicit PyRig(RigFile read) : file(std::move(read)), table(file.rig) {}
  RigFile file;
  ParameterTable table;
};
struct PySamples {
  std::shared_ptr<const PyRig> rig;
  SampleSet set;
};

/// Raises an exception of the package.
[[noreturn]] void raise(const char* type, const py::object& what) {
  const py::object made = py::module_::import("kincal._errors").attr(type)(*py::make_tuple(what));
  PyErr_SetObject(reinterpret_cast<PyObject*>(Py_TYPE(made.ptr())), made.ptr());
  throw py::error_already_set();
}

// ------------------------------------------------------------------------------------------------
// values
py::object python_of(const Node& node) {
  switch (node.kind) {
    case Node::Kind::mapping: {
      py::dict out;
      for (const auto& [key, value] : node.members) out[py::str(key)] = python_of(value);
      return std::move(out);
    }
    case Node::Kind::sequence: {
      py::list out;
      for (const Node& item : node.items) out.append(python_of(item));
      return std::move(out);
    }
    case Node::Kind::null:
      return py::none();
    default:
      break;
  }
  double number = 0;
  if (node.quoted) return py::str(node.text);
  if (node.text == "true" || node.text == "false") return py::bool_(node.text == "true");
  if (!read_number(node.text, number)) return py::str(node.text);
  const bool whole = node.text.find_first_not_of("+-0123456789") == std::string::npos;
  if (whole) return py::int_(py::str(node.text));
  return py::float_(number);
}

/// Returns an array of rows of so many columns.
template <class T>
py::array_t<T> table_of(const std::vector<T>& numbers, py::ssize_t columns) {
  const auto rows = columns ? static_cast<py::ssize_t>(numbers.size()) / columns : 0;
  return py::array_t<T>({rows, columns}, numbers.data());
}

Array array_of(const MatrixXd& m) {
  Array out(std::vector<py::ssize_t>{m.rows(), m.cols()});
  for (Eigen::Index i = 0; i < m.rows(); ++i)
    for (Eigen::Index j = 0; j < m.cols(); ++j) out.mutable_at(i, j) = m(i, j);
  return out;
}

/// Residuals of one sensor, a row a point (a view, where the sensor measures poses).
struct ResidualRows {
  std::vector<std::int64_t> sample, target, point;
  std::vector<double> raw, before, whitened;
  int columns = 0, white = 0;
};

py::dict residual_arrays(const Recording& recording, const std::vector<ViewResiduals>& after,
                         const std::vector<ViewResiduals>& before) {
  std::map<const View*, const ViewResiduals*> earlier;
  for (const ViewResiduals& r : before) earlier[r.view] = &r;
  std::map<int, ResidualRows> rows;
  for (const ViewResiduals& r : after) {
    const SensorModel& model = *recording.rig.sensors[r.view->sensor].model;
    ResidualRows& out = rows[r.view->sensor];
    out.columns = model.rows();
    const Eigen::Index blocks = r.raw.size() / out.columns;
    out.white = blocks ? static_cast<int>(r.whitened.size() / blocks) : 0;
    for (Eigen::Index b = 0; b < blocks; ++b) {
      out.sample.push_back(r.sample);
      out.target.push_back(r.view->target);
      out.point.push_back(model.measures_pose() ? -1
                          : r.view->ids.empty() ? b
                                                : r.view->ids[static_cast<size_t>(b)]);
    }
    const auto append = [](std::vector<double>& to, const VectorXd& from) {
      to.insert(to.end(), from.data(), from.data() + from.size());
    };
    append(out.raw, r.raw);
    append(out.whitened, r.whitened);
    const auto found = earlier.find(r.view);
    append(out.before,
           found == earlier.end() ? VectorXd::Constant(r.raw.size(), kNan) : found->second->raw);
  }
  py::dict out;
  for (const auto& [sensor, r] : rows) {
    const auto list = [](const std::vector<std::int64_t>& numbers) {
      return py::array_t<std::int64_t>(static_cast<py::ssize_t>(numbers.size()), numbers.data());
    };
    py::dict one;
    one["sample"] = list(r.sample);
    one["target"] = list(r.target);
    one["point"] = list(r.point);
    one["after"] = table_of(r.raw, r.columns);
    one["before"] = table_of(r.before, r.columns);
    one["whitened"] = table_of(r.whitened, r.white);
    one["unit"] = recording.rig.sensors[sensor].model->unit();
    out[py::str(recording.rig.sensors[sensor].name)] = one;
  }
  return out;
}

py::list sample_ids(const Recording& recording) {
  py::list out;
  for (const Sample& sample : recording.samples) out.append(sample.id);
  return out;
}

py::object decoded(const std::string& text) {
  return py::reinterpret_steal<py::object>(
      PyUnicode_DecodeUTF8(text.data(), static_cast<py::ssize_t>(text.size()), "surrogateescape"));
}

py::dict texts_of(const ResultFiles& files) {
  py::dict out;
  for (const auto& [name, text] : result_file_names())
    if (!(files.*text).empty()) out[name] = decoded(files.*text);
  return out;
}

ResultFiles files_of(const Texts& texts) {
  ResultFiles out;
  for (const auto& [name, text] : result_file_names())
    if (const auto found = texts.find(name); found != texts.end()) out.*text = found->second;
  return out;
}

// ------------------------------------------------------------------------------------------------
// settings
using Take = std::function<void(CalibrateSettings&, const py::handle&)>;

template <class T>
Take take(T CalibrateSettings::*field) {
  return [field](CalibrateSettings& settings, const py::handle& value) {
    if constexpr (std::is_same_v<T, std::vector<std::string>>) {
      if (py::isinstance<py::str>(value))  // else it would be a list of letters
        settings.*field = {value.cast<std::string>()};
      else
        settings.*field = value.cast<T>();
    } else {
      settings.*field = value.cast<T>();
    }
  };
}

struct Setting {
  const char* name;
  const char* expected;
  Take take;
};
const std::vector<Setting>& all_settings() {
  using S = CalibrateSettings;
  static const std::vector<Setting> settings = {
      {"noise", "a text", take(&S::noise)},
      {"step", "a text", take(&S::step)},
      {"linear_solver", "a text", take(&S::linear_solver)},
      {"free", "a list of names", take(&S::free)},
      {"fix", "a list of names", take(&S::fix)},
      {"group", "a list of names", take(&S::groups)},
      {"no_group", "a list of names", take(&S::no_groups)},
      {"report_frame", "a list of names", take(&S::report_frames)},
      {"require", "a list of texts", take(&S::require)},
      {"iterations", "an integer", take(&S::iterations)},
      {"threads", "an integer", take(&S::threads)},
      {"restarts", "an integer", take(&S::restarts)},
      {"holdout", "an integer", take(&S::holdout)},
      {"cross_validate", "an integer", take(&S::cross_validate)},
      {"reject", "True or False", take(&S::reject)},
      {"estimate_noise", "True or False", take(&S::estimate_noise)},
      {"no_report", "True or False", take(&S::no_report)},
      {"write_reduction", "True or False", take(&S::write_reduction)}};
  return settings;
}

CalibrateSettings settings_of(const py::dict& given, const std::string& command) {
  CalibrateSettings out;
  out.command = command;
  out.words = Words::keywords;
  for (const auto& [key, value] : given) {
    const auto name = py::str(key).cast<std::string>();
    std::vector<std::string> valid;
    const Setting* setting = nullptr;
    for (const Setting& one : all_settings()) {
      valid.emplace_back(one.name);
      if (name == one.name) setting = &one;
    }
    if (!setting)
      throw InputError(name + ": there is no such option" +
                       nearest_or_all(name, valid, "there are"));
    try {
      setting->take(out, value);
    } catch (const py::cast_error&) {
      throw InputError(name + ": " + setting->expected + " is expected, not " +
                       py::repr(value).cast<std::string>());
    }
  }
  check_settings(out);
  return out;
}

// ------------------------------------------------------------------------------------------------
// commands
std::shared_ptr<PyRig> read_rig_path(const Text& path) {
  return std::make_shared<PyRig>(read_rig(path));
}

std::shared_ptr<PyRig> parse_rig_texts(const Text& text, const Text& path,
                                       const std::optional<Text>& urdf, const Text& urdf_path) {
  if (!urdf) return std::make_shared<PyRig>(parse_rig(text, path));
  const Urdf robot = parse_urdf(*urdf, urdf_path);
  return std::make_shared<PyRig>(parse_rig(text, path, &robot));
}

std::shared_ptr<PySamples> parse_sample_text(const std::shared_ptr<PyRig>& rig, const Text& text,
                                             const Text& path, const py::object& progress) {
  return std::make_shared<PySamples>(PySamples{rig, released(progress, [=](const Progress& told) {
                                                 return parse_sample_set(text, path, rig->file.rig,
                                                                         told);
                                               })});
}

/// A finished calibration.
struct Done {
  Job job;
  Report report;
  ResultFiles files;
};

py::dict calibrate_rig(const std::shared_ptr<PyRig>& rig, const std::shared_ptr<PySamples>& samples,
                       const py::dict& given, const Text& command, const py::object& progress) {
  const CalibrateSettings settings = settings_of(given, command);
  const Done done = released(progress, [=](const Progress& told) {
    Job job = make_job(rig->file, samples->set, settings);
    check_validation(job, settings);
    check_groups(job.rig_file.rig, settings);
    Report report = run(job, settings, true, told);
    ResultFiles files;
    if (report.solution.status != Status::undefined_start)
      files = make_texts(job, report, settings);
    return Done{std::move(job), std::move(report), std::move(files)};
  });
  const Report& report = done.report;
  if (report.solution.status == Status::undefined_start) {
    const bool found = report.diagnosis && !report.diagnosis->findings.empty();
    const std::string why = found ? with_id(report.diagnosis->findings[0]) +
                                        "\nSo no calibration can start: " + report.solution.message
                                  : report.solution.message;
    raise("StartError", py::cast(Text(why)));
  }
  const ReportedCovariance covariance = reported_covariance(report.solution);
  py::list judgements;
  for (const Judgement& j : report.validation.requirements)
    judgements.append(py::make_tuple(j.requirement.text, j.met, judgement_text(j)));
  py::dict out;
  out["files"] = texts_of(done.files);
  py::dict names;
  for (const ParameterEstimate& e : report.solution.parameters) {
    py::list one;
    for (size_t c = 0; c < e.components.size(); ++c) one.append(e.component_name(c));
    names[py::str(e.name)] = one;
  }
  out["names"] = names;
  out["components"] = covariance.names;
  out["covariance"] = array_of(covariance.matrix);
  out["residuals"] =
      residual_arrays(*report.solution.recording, report.residuals.after, report.residuals.before);
  out["samples"] = sample_ids(*report.solution.recording);
  out["requirements"] = judgements;
  out["note"] = done.job.note;
  return out;
}

py::dict check_rig(const std::shared_ptr<PyRig>& rig, const std::shared_ptr<PySamples>& samples,
                   const py::dict& given, bool compare, const py::object& progress) {
  const CalibrateSettings settings = settings_of(given, {});
  struct Made {
    CheckedJob job;
    ResultFiles files;
  };
  const Made made = released(progress, [=](const Progress& told) {
    DoctorOptions options;
    options.noise = kNoiseModes.at(settings.noise);
    options.threads = settings.threads;
    options.compare = compare;
    options.progress = told;
    CheckedJob job = check_samples(rig->file, samples->set, options, settings.words);
    ResultFiles files =
        check_files(rig->file, job.recording, job.diagnosis, explained(job.diagnosis),
                    record_of("kincal.check()", samples->set.hash));
    return Made{std::move(job), std::move(files)};
  });
  py::dict out;
  out["json"] = json_text(check_json(made.job));
  out["files"] = texts_of(made.files);
  return out;
}

py::dict evaluate_rig(const std::shared_ptr<PyRig>& rig, const std::shared_ptr<PySamples>& samples,
                      const py::dict& given, const py::object& progress) {
  const CalibrateSettings settings = settings_of(given, {});
  struct Made {
    EvaluatedJob job;
    ResultFiles files;
  };
  const Made made = released(progress, [=](const Progress& told) {
    RigFile file = rig->file;
    EvaluatedJob job = evaluate_samples(file, samples->set, settings, told);
    ResultFiles files = evaluation_files(file, job.recording, job.evaluation, job.warnings,
                                         record_of("kincal.evaluate()", samples->set.hash));
    return Made{std::move(job), std::move(files)};
  });
  const EvaluatedJob& evaluated = made.job;
  py::dict out;
  out["json"] = json_text(evaluation_json(evaluated.evaluation, evaluated.warnings));
  out["files"] = texts_of(made.files);
  out["residuals"] = residual_arrays(*evaluated.recording, evaluated.evaluation.views, {});
  out["samples"] = sample_ids(*evaluated.recording);
  return out;
}

py::tuple simulate_rig(const std::shared_ptr<PyRig>& rig, int samples, std::uint64_t seed,
                       const std::vector<std::pair<std::string, double>>& spread,
                       const std::map<std::string, std::pair<Text, Text>>& files,
                       const py::object& progress) {
  SimulateSettings settings;
  settings.samples = samples;
  settings.seed = seed;
  settings.words = Words::keywords;
  for (const auto& [pattern, sigma] : spread) {
    if (!(sigma >= 0) || !std::isfinite(sigma))
      throw InputError("spread: '" + pattern + "': a number from 0 on is expected");
    settings.spread.push_back({pattern, sigma});
  }
  const auto file = [&](const char* name) -> std::optional<NamedText> {
    const auto found = files.find(name);
    if (found == files.end()) return std::nullopt;
    return NamedText{found->second.first, found->second.second};
  };
  settings.truth = file("truth");
  settings.postures = file("postures");
  const SimulatedJob job = released(
      progress, [=](const Progress& told) { return simulate_samples(rig->file, settings, told); });
  const Rig& of = rig->file.rig;
  return py::make_tuple(Text(samples_text(of, job.simulation.samples)),
                        Text(truth_text(of, job.table, job.simulation)), job.warnings);
}

// ------------------------------------------------------------------------------------------------
// the robot
Frame frame_of(const PyRig& rig, const std::string& name, const char* argument) {
  if (const std::optional<Frame> found = find_frame(rig.file.rig, rig.table, name)) return *found;
  std::vector<std::string> valid;
  for (const Frame& frame : all_frames(rig.file.rig, rig.table)) valid.push_back(frame.name);
  throw InputError(std::string(argument) + ": there is no frame '" + name + "'" +
                   nearest_or_all(name, valid, "there are"));
}

/// Postures as rows of `values`, a column a joint of `joints`: readings of all that move `frames`.
std::vector<Readings> readings_of(const PyRig& rig, const std::vector<std::string>& joints,
                                  const Array& values, const std::vector<Frame>& frames) {
  const Rig& of = rig.file.rig;
  std::vector<int> columns;
  for (const std::string& name : joints) {
    const int j = of.tree.find_joint(name);
    std::vector<std::string> valid;
    for (const Joint& joint : of.tree.joints)
      if (joint.has_reading()) valid.push_back(joint.name);
    if (j < 0 || !of.tree.joints[j].has_reading())
      throw InputError("joints: '" + name + "' is no joint with a reading" +
                       nearest_or_all(name, valid, "there are"));
    columns.push_back(j);
  }
  const auto rows = values.shape(0), count = static_cast<py::ssize_t>(columns.size());
  std::vector<Readings> out(static_cast<size_t>(rows), Readings(of.tree.joints.size(), kNan));
  for (py::ssize_t r = 0; r < rows; ++r)
    for (py::ssize_t c = 0; c < count; ++c) {
      if (!std::isfinite(values.at(r, c)))
        throw InputError("joints: the reading of '" + joints[static_cast<size_t>(c)] +
                         "' is not finite (posture " + std::to_string(r) + ")");
      out[static_cast<size_t>(r)][columns[static_cast<size_t>(c)]] = values.at(r, c);
    }
  for (const Frame& frame : frames)
    for (const int j : joints_between(of, of.base, frame.link))
      if (!out.empty() && std::isnan(out[0][j]))
        throw InputError("joints: there is no reading of joint '" + of.tree.joints[j].name +
                         "', which moves '" + frame.name + "'");
  for (Readings& one : out) one = completed(std::move(one));
  return out;
}

Array forward_poses(const std::shared_ptr<PyRig>& rig, const std::vector<std::string>& joints,
                    const Array& values, const std::string& frame, const std::string& base) {
  const Frame tip = frame_of(*rig, frame, "frame"), from = frame_of(*rig, base, "base");
  const std::vector<Readings> postures = readings_of(*rig, joints, values, {tip, from});
  const CalibratedRobot robot{&rig->file.rig, &rig->table, rig->table.initial, {}};
  const RobotTip path{robot, tip, from};
  Array out(std::vector<py::ssize_t>{static_cast<py::ssize_t>(postures.size()), 4, 4});
  double* at = out.mutable_data();
  for (const Readings& readings : postures) {
    const Pose pose = path.at(readings);
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < 4; ++j)
        *at++ = i == 3 ? double(j == 3) : j == 3 ? pose.translation(i) : pose.rotation(i, j);
  }
  return out;
}

py::tuple compensate_readings(const std::shared_ptr<PyRig>& real,
                              const std::shared_ptr<PyRig>& planned,
                              const std::pair<std::string, std::string>& tip_from,
                              const std::vector<std::string>& joints, const Array& values,
                              bool position_only) {
  const auto robot_tip = [&](const PyRig& rig) {
    return RobotTip{{&rig.file.rig, &rig.table, rig.table.initial, {}},
                    frame_of(rig, tip_from.first, "tip"),
                    frame_of(rig, tip_from.second, "base")};
  };
  const RobotTip to = robot_tip(*real), plan = robot_tip(*planned);
  const std::vector<Readings> postures = readings_of(*real, joints, values, {to.tip});
  Array out(std::vector<py::ssize_t>{values.shape(0), values.shape(1)}),
      left(std::vector<py::ssize_t>{values.shape(0), 2});
  for (size_t r = 0; r < postures.size(); ++r) {
    const Compensated found = compensate(to, plan, postures[r], position_only);
    const auto row = static_cast<py::ssize_t>(r);
    for (size_t c = 0; c < joints.size(); ++c)
      out.mutable_at(row, static_cast<py::ssize_t>(c)) =
          found.readings[real->file.rig.tree.find_joint(joints[c])];
    left.mutable_at(row, 0) = found.position;
    left.mutable_at(row, 1) = found.rotation;
  }
  return py::make_tuple(out, left);
}

// ------------------------------------------------------------------------------------------------
// what a rig has
py::dict describe(const PyRig& rig) {
  const Rig& of = rig.file.rig;
  py::list joints, parameters, frames, still;
  py::dict sensors, targets;
  for (const Joint& joint : of.tree.joints)
    if (joint.has_reading()) joints.append(Text(joint.name));
  for (const Sensor& sensor : of.sensors) sensors[py::str(sensor.name)] = sensor.type;
  for (const Target& target : of.targets) targets[py::str(target.name)] = target.type;
  for (const Parameter& p : rig.table.all)
    if (!p.hidden()) parameters.append(Text(p.name));
  for (const Frame& frame : all_frames(of, rig.table)) frames.append(Text(frame.name));
  for (const Frame& frame : still_frames(of, rig.table)) still.append(Text(frame.name));
  py::dict out;
  out["robot"] = Text(rig.file.urdf.robot);
  out["base"] = Text(of.tree.links[of.base]);
  out["links"] = std::vector<Text>(of.tree.links.begin(), of.tree.links.end());
  out["joints"] = joints;
  out["sensors"] = sensors;
  out["targets"] = targets;
  out["parameters"] = parameters;
  out["frames"] = frames;
  out["still"] = still;
  const std::vector<std::string>& warnings = rig.file.urdf.warnings;
  out["warnings"] = std::vector<Text>(warnings.begin(), warnings.end());
  return out;
}

// NOLINTNEXTLINE(performance-unnecessary-value-param): pybind11 calls it so
void translate(std::exception_ptr thrown) {
  try {
    if (thrown) std::rethrow_exception(thrown);
  } catch (const InputError& error) {
    try {
      raise("InputError", py::cast(Text(error.what())));
    } catch (py::error_already_set& set) {
      set.restore();
    }
  } catch (const std::invalid_argument& error) {
    try {
      raise("InputError", py::cast(Text(error.what())));
    } catch (py::error_already_set& set) {
      set.restore();
    }
  }
}

}  // namespace
}  // namespace kincal

PYBIND11_MODULE(_kincal, m) {
  using namespace kincal;
  m.doc() = "What the package kincal is made of; its functions are no interface.";
  m.attr("__version__") = KINCAL_VERSION;
  keep_memory();
  pthread_atfork(nullptr, nullptr, [] { at_work = 0; });
  py::register_local_exception_translator(translate);
  py::module_::import("atexit").attr("register")(py::cpp_function(wait_at_exit));
  py::class_<PyRig, std::shared_ptr<PyRig>>(m, "Rig")
      .def_property_readonly("path", [](const PyRig& rig) { return Text(rig.file.path); })
      .def_property_readonly("text", [](const PyRig& rig) { return Text(rig.file.text); })
      .def_property_readonly("urdf_path", [](const PyRig& rig) { return Text(rig.file.urdf.path); })
      .def_property_readonly("urdf", [](const PyRig& rig) { return Text(rig.file.urdf.text); })
      .def_property_readonly("flange_only", [](const PyRig& rig) { return rig.file.flange_only; })
      .def("to_dict", [](const PyRig& rig) { return python_of(rig.file.node); })
      .def("describe", describe);
  py::class_<PySamples, std::shared_ptr<PySamples>>(m, "Samples")
      .def("__len__", [](const PySamples& samples) { return samples.set.samples->size(); });
  add_watching(m);
  m.def("read_rig", read_rig_path, py::arg("path"));
  m.def("parse_rig", parse_rig_texts, py::arg("text"), py::arg("path"), py::arg("urdf"),
        py::arg("urdf_path"));
  m.def("parse_samples", parse_sample_text, py::arg("rig"), py::arg("text"), py::arg("path"),
        py::arg("progress"));
  m.def(
      "read_file", [](const Text& path) { return Text(read_file(path)); }, py::arg("path"));
  m.def("calibrate", calibrate_rig, py::arg("rig"), py::arg("samples"), py::arg("settings"),
        py::arg("command"), py::arg("progress"));
  m.def("check", check_rig, py::arg("rig"), py::arg("samples"), py::arg("settings"),
        py::arg("compare"), py::arg("progress"));
  m.def("evaluate", evaluate_rig, py::arg("rig"), py::arg("samples"), py::arg("settings"),
        py::arg("progress"));
  m.def("simulate", simulate_rig, py::arg("rig"), py::arg("samples"), py::arg("seed"),
        py::arg("spread"), py::arg("files"), py::arg("progress"));
  m.def("forward", forward_poses, py::arg("rig"), py::arg("joints"), py::arg("values"),
        py::arg("frame"), py::arg("base"));
  m.def("compensate", compensate_readings, py::arg("real"), py::arg("planned"), py::arg("tip_from"),
        py::arg("joints"), py::arg("values"), py::arg("position_only"));
  m.def(
      "report_page", [](const Texts& files) { return Text(make_page(files_of(files))); },
      py::arg("files"));
  m.def(
      "write_file",
      [](const Text& path, const Text& text, bool force) {
        check_output_file(path, force);
        write_file(path, text, force);
      },
      py::arg("path"), py::arg("text"), py::arg("force"));
  m.def(
      "write_results",
      [](const Text& directory, const Texts& files, bool force) {
        check_output(directory, force);
        write_results(directory, files_of(files), force, nullptr);
      },
      py::arg("directory"), py::arg("files"), py::arg("force"));
}
