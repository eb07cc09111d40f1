// The module kincal._kincal: what the program does, as functions of texts and arrays. The package
// around it (kincal/) has the types that users see. No function changes what it is given.
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <cmath>
#include <optional>

#include "../../io/document/files.h"
#include "../../io/document/numbers.h"
#include "../../io/job/certificate.h"
#include "../../io/job/check.h"
#include "../../io/job/plan.h"
#include "../../io/job/plan_verify.h"
#include "../../io/job/robot.h"
#include "../../io/job/settings.h"
#include "../../io/job/simulate.h"
#include "../../io/job/verify.h"
#include "../../io/report/certificate.h"
#include "../../io/results/csv.h"
#include "../../io/results/input_files.h"
#include "../../io/results/result_json.h"
#include "../../io/rig/samples_file.h"
#include "../../io/rig/simulation_file.h"
#include "text.h"
#include "watching.h"
#include "work.h"

namespace py = pybind11;

namespace kincal {
namespace {

using Array = py::array_t<double, py::array::c_style | py::array::forcecast>;
using Texts = std::map<std::string, Text>;

using PyRig = KnownRig;
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
/// Sets a field from what Python gives.
struct TakePython {
  CalibrateSettings& to;
  const py::handle& value;

  template <class T>
  void operator()(T CalibrateSettings::*field) const {
    if constexpr (std::is_same_v<T, std::vector<std::string>>) {
      if (py::isinstance<py::str>(value)) {  // else it would be a list of letters
        to.*field = {value.cast<std::string>()};
        return;
      }
    }
    to.*field = value.cast<T>();
  }
};

CalibrateSettings settings_of(const py::dict& given, const std::string& command) {
  CalibrateSettings out;
  out.command = command;
  out.words = Words::keywords;
  for (const auto& [key, value] : given) {
    const auto name = py::str(key).cast<std::string>();
    const Setting& setting = find_setting(name);
    try {
      std::visit(TakePython{out, value}, setting.field);
    } catch (const py::cast_error&) {
      const bool truth = std::holds_alternative<bool CalibrateSettings::*>(setting.field);
      throw InputError(name + ": " + (truth ? "True or False" : setting.expected) +
                       " is expected, not " + py::repr(value).cast<std::string>());
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

py::dict calibrate_rig(const std::shared_ptr<PyRig>& rig, const std::shared_ptr<PySamples>& samples,
                       const py::dict& given, const Text& command, const py::object& progress) {
  const CalibrateSettings settings = settings_of(given, command);
  const FinishedJob done = released(progress, [=](const Progress& told) {
    return calibrate_job(rig->file, samples->set, settings, told);
  });
  const Report& report = done.report;
  if (const std::string why = why_no_start(report); !why.empty())
    raise("StartError", py::cast(Text(why)));
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

py::tuple plan_rig(const std::shared_ptr<PyRig>& rig,
                   const std::optional<std::shared_ptr<PySamples>>& samples,
                   const PlanSettings& settings, const py::object& progress) {
  const PosturePlan made = released(progress, [=](const Progress& told) {
    return plan_postures(rig->file, samples ? &(*samples)->set : nullptr, settings, told);
  });
  return py::make_tuple(Text(postures_text(rig->file.rig, made.postures)),
                        Text(plan_json(made).dump()), Text(plan_text(made)));
}

py::tuple plan_verification(const std::shared_ptr<PyRig>& rig, const TestPoseSettings& settings,
                            const py::object& progress) {
  const TestPosePlan made = released(
      progress, [=](const Progress& told) { return plan_test_poses(rig->file, settings, told); });
  return py::make_tuple(Text(postures_text(rig->file.rig, made.postures)),
                        Text(test_poses_json(rig->file.rig, made).dump()),
                        Text(test_poses_text(made)));
}

/// Verifies the result in a folder: certificate.json, what the program prints, certificate.html.
/// `words`: the texts among the settings, by name.
py::tuple verify_folder(const Text& folder, const std::pair<Text, Text>& samples,
                        const std::map<std::string, Text>& words, bool refit_base,
                        const py::object& progress) {
  VerifySettings settings;
  settings.words = Words::keywords;
  settings.refit_base = refit_base;
  const std::map<std::string, std::string VerifySettings::*> fields = {
      {"tolerance", &VerifySettings::tolerance},     {"standard", &VerifySettings::standard},
      {"sensor", &VerifySettings::sensor},           {"instrument", &VerifySettings::instrument},
      {"environment", &VerifySettings::environment}, {"serial", &VerifySettings::serial},
      {"measured", &VerifySettings::measured},       {"command", &VerifySettings::command}};
  for (const auto& [name, value] : words) settings.*fields.at(name) = value;
  struct Made {
    std::string json, text, page;
  };
  const Made made = released(progress, [=](const Progress& told) {
    const VerifiedResult result = read_verified_result(folder);
    const SampleSet set =
        parse_sample_set(samples.first, samples.second, result.files.rig_file.rig, told);
    const Verification found = verify(result, set, settings);
    Made out;
    out.json = json_text(certificate_json(result, set, found, settings));
    out.text = verification_text(found);
    out.page = certificate_page(out.json);
    return out;
  });
  return py::make_tuple(Text(made.json), Text(made.text), Text(made.page));
}

// ------------------------------------------------------------------------------------------------
// the robot
Postures postures_of(const std::vector<std::string>& joints, const Array& values) {
  return {joints, values.data(), static_cast<size_t>(values.shape(0))};
}

Array forward(const std::shared_ptr<PyRig>& rig, const std::vector<std::string>& joints,
              const Array& values, const std::string& frame, const std::string& base) {
  Array out(std::vector<py::ssize_t>{values.shape(0), 4, 4});
  forward_poses(*rig, postures_of(joints, values), frame, base, out.mutable_data());
  return out;
}

py::tuple compensate_readings(const std::shared_ptr<PyRig>& real,
                              const std::shared_ptr<PyRig>& planned,
                              const std::pair<std::string, std::string>& tip_base,
                              const std::vector<std::string>& joints, const Array& values,
                              const std::pair<bool, std::optional<double>>& how) {
  const std::vector<Compensated> found =
      compensate_postures(*real, *planned, postures_of(joints, values),
                          {tip_base.first, tip_base.second, how.first, how.second});
  Array out(std::vector<py::ssize_t>{values.shape(0), values.shape(1)}),
      left(std::vector<py::ssize_t>{values.shape(0), 2});
  for (size_t r = 0; r < found.size(); ++r) {
    const auto row = static_cast<py::ssize_t>(r);
    for (size_t c = 0; c < joints.size(); ++c)
      out.mutable_at(row, static_cast<py::ssize_t>(c)) =
          found[r].readings[real->file.rig.tree.find_joint(joints[c])];
    left.mutable_at(row, 0) = found[r].position;
    left.mutable_at(row, 1) = found[r].rotation;
  }
  return py::make_tuple(out, left);
}

// ------------------------------------------------------------------------------------------------
// what a rig has
py::dict describe(const PyRig& rig) {
  const Rig& of = rig.file.rig;
  py::list parameters, frames;
  py::dict sensors, targets;
  const std::vector<std::string> joints = joint_names(of);
  for (const Sensor& sensor : of.sensors) sensors[py::str(sensor.name)] = sensor.type;
  for (const Target& target : of.targets) targets[py::str(target.name)] = target.type;
  for (const Parameter& p : rig.table.all)
    if (!p.hidden()) parameters.append(Text(p.name));
  for (const Frame& frame : all_frames(of, rig.table)) frames.append(Text(frame.name));
  py::dict out;
  out["robot"] = Text(rig.file.urdf.robot);
  out["base"] = Text(of.tree.links[of.base]);
  out["links"] = std::vector<Text>(of.tree.links.begin(), of.tree.links.end());
  out["joints"] = std::vector<Text>(joints.begin(), joints.end());
  out["sensors"] = sensors;
  out["targets"] = targets;
  out["parameters"] = parameters;
  out["frames"] = frames;
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
      "place",
      [](const Text& message) {
        const Place at = place_of(message);
        return py::make_tuple(Text(at.file), at.line, Text(at.name));
      },
      py::arg("message"));
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
  py::class_<PlanSettings>(m, "PlanSettings")
      .def(py::init([](int next, int candidates, std::uint64_t seed, const Text& goal,
                       const std::optional<std::pair<Text, Text>>& postures, double clearance) {
        PlanSettings out{next, candidates, seed, goal, std::nullopt, clearance, Words::keywords};
        if (postures) out.postures = NamedText{postures->first, postures->second};
        return out;
      }));
  m.def("plan", plan_rig, py::arg("rig"), py::arg("samples"), py::arg("settings"),
        py::arg("progress"));
  py::class_<TestPoseSettings>(m, "TestPoseSettings")
      .def(py::init([](const Text& sensor, int cycles, bool approaches,
                       const std::vector<double>& region,
                       const std::pair<int, std::uint64_t>& draws, double clearance) {
        return TestPoseSettings{sensor,      cycles,       approaches, region,
                                draws.first, draws.second, clearance,  Words::keywords};
      }));
  m.def("plan_verification", plan_verification, py::arg("rig"), py::arg("settings"),
        py::arg("progress"));
  m.def("verify", verify_folder, py::arg("folder"), py::arg("samples"), py::arg("words"),
        py::arg("refit_base"), py::arg("progress"));
  m.def("forward", forward, py::arg("rig"), py::arg("joints"), py::arg("values"), py::arg("frame"),
        py::arg("base"));
  m.def("compensate", compensate_readings, py::arg("real"), py::arg("planned"), py::arg("tip_base"),
        py::arg("joints"), py::arg("values"), py::arg("position_only_temperature"));
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
      "write_directory",
      [](const Text& directory, const Texts& files, bool force) {
        check_output(directory, force);
        std::vector<std::pair<std::string, std::string>> all;
        for (const auto& [name, text] : files) all.emplace_back(name, text);
        write_directory(directory, all, force, [] { return true; });
      },
      py::arg("directory"), py::arg("files"), py::arg("force"));
  m.def(
      "write_results",
      [](const Text& directory, const Texts& files, bool force) {
        check_output(directory, force);
        write_results(directory, files_of(files), force, nullptr);
      },
      py::arg("directory"), py::arg("files"), py::arg("force"));
}
