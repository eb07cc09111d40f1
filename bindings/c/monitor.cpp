// The monitor of the C interface.
#include <algorithm>
#include <cmath>
#include <limits>

#include "../../io/document/names.h"
#include "../../io/rig/samples_file.h"
#include "../../models/monitor/monitor.h"
#include "../../models/monitor/static_view.h"
#include "../../models/rig/numbers.h"
#include "../../models/sensors/surface.h"
#include "handles.h"

using namespace kincal;

struct kincal_monitor {
  Monitor monitor;
  NamesByKind names;
  Innovation last = {};
  std::vector<Moved> moved = {};
  std::vector<kincal_recalibrated> recalibrated = {};
  // Samples as they come, in the same memory.
  Sample sample = {};
  std::vector<View> spare = {};  // of samples with more views
  std::vector<char> seen = {};   // by point of a target
};

namespace kincal {
namespace {

/// Copies an array of the caller. @throws Refusal
template <class T>
std::vector<T> array_of(const T* from, size_t count, const std::string& where) {
  if (count == 0) return {};
  if (count > static_cast<size_t>(std::numeric_limits<int>::max()))
    throw Refusal{KINCAL_USAGE, where + ": " + std::to_string(count) + " are too many"};
  given(from, where.c_str());
  return std::vector<T>(from, from + count);
}

/// The same into `to`.
template <class T, class To>
void copy_array(const T* from, size_t count, const std::string& where, std::vector<To>& to) {
  to.clear();
  if (count == 0) return;
  if (count > static_cast<size_t>(std::numeric_limits<int>::max()))
    throw Refusal{KINCAL_USAGE, where + ": " + std::to_string(count) + " are too many"};
  given(from, where.c_str());
  to.assign(from, from + count);
}

/// What a reader of samples.jsonl checks, and Monitor::add() does not. `seen` is scratch.
void check_view(const Rig& rig, const View& view, const std::string& where,
                std::vector<char>& seen) {
  const Sensor& sensor = rig.sensors[view.sensor];
  const Target& target = rig.targets[view.target];
  const bool plane = target.type == "plane";
  if (sees_surfaces(*sensor.model) != plane)
    throw InputError(where + "target: only sensors of type surface see planes; '" + sensor.name +
                     "' is a " + sensor.type + ", '" + target.name + "' a " + target.type);
  if (sensor.model->measures_pose()) {
    if (!view.ids.empty())
      throw InputError(where + "ids: a " + sensor.type + " view has no points");
    if (view.z.size() == 7) {
      const double length = Eigen::Map<const Eigen::Vector4d>(view.z.data() + 3).norm();
      if (!(std::abs(length - 1) <= 1e-3))
        throw InputError(where + "z: a unit quaternion is expected behind x y z");
    }
    return;
  }
  if (view.ids.empty()) throw InputError(where + "ids: at least one point is expected");
  seen.assign(static_cast<size_t>(target.count()), 0);
  for (const int id : view.ids) {
    if (id < 0 || id >= target.count())
      throw InputError(where + "ids: '" + target.name + "' has no point " + std::to_string(id));
    if (!plane && seen[static_cast<size_t>(id)])
      throw InputError(where + "ids: point " + std::to_string(id) + " occurs twice");
    seen[static_cast<size_t>(id)] = 1;
  }
}

void read_view(const kincal_view& from, const Rig& rig, const std::string& where, View& out,
               std::vector<char>& seen) {
  const auto index = [&](int32_t at, size_t count, const char* what) {
    if (at < 0 || static_cast<size_t>(at) >= count)
      throw InputError(where + what + ": the rig has no " + what + " " + std::to_string(at));
    return static_cast<int>(at);
  };
  out.sensor = index(from.sensor, rig.sensors.size(), "sensor");
  out.target = index(from.target, rig.targets.size(), "target");
  copy_array(from.ids, from.ids_count, where + "ids", out.ids.own());
  copy_array(from.z, from.z_count, where + "z", out.z);
  if (from.sigma)
    copy_array(from.sigma, from.sigma_count, where + "sigma", out.sigma.own());
  else if (out.sigma != rig.sensors[out.sensor].sigma)
    out.sigma = rig.sensors[out.sensor].sigma;
  check_view(rig, out, where, seen);
  if (out.z.size() == 7 && rig.sensors[out.sensor].model->measures_pose())
    Eigen::Map<Eigen::Vector4d>(out.z.data() + 3).normalize();
}

/// Reads a sample into `monitor.sample`. `where` begins the places in messages.
/// @throws Refusal, InputError
void read_sample(const kincal_sample& from, kincal_monitor& monitor,
                 const std::string& where = "") {
  const Rig& rig = monitor.monitor.rig();
  const std::vector<std::string>& joints = monitor.names[KINCAL_JOINTS];
  if (from.view_size < sizeof(kincal_view))
    throw Refusal{KINCAL_USAGE, where + "view_size: " + std::to_string(from.view_size) +
                                    " is not the size of a view (" +
                                    std::to_string(sizeof(kincal_view)) + ")"};
  Sample& out = monitor.sample;
  out.id = from.id ? from.id : "";
  if (from.readings_count != joints.size())
    throw InputError(where + "readings: " + std::to_string(joints.size()) +
                     " are expected, one a joint, not " + std::to_string(from.readings_count));
  if (!joints.empty()) given(from.readings, (where + "readings").c_str());
  out.readings.assign(rig.tree.joints.size(), kNan);
  for (size_t i = 0; i < joints.size(); ++i) {
    if (std::isinf(from.readings[i]))
      throw InputError(where + "readings[" + std::to_string(i) + "]: that of '" + joints[i] +
                       "' is infinite");
    out.readings[static_cast<size_t>(rig.tree.find_joint(joints[i]))] = from.readings[i];
  }
  if (from.views_count > 0) given(from.views, (where + "views").c_str());
  while (out.views.size() > from.views_count) {
    monitor.spare.push_back(std::move(out.views.back()));
    out.views.pop_back();
  }
  const char* const first = reinterpret_cast<const char*>(from.views);
  for (size_t v = 0; v < from.views_count; ++v) {
    kincal_view view;
    std::memcpy(&view, first + v * from.view_size, sizeof view);
    if (v == out.views.size()) {
      if (monitor.spare.empty()) monitor.spare.emplace_back();
      out.views.push_back(std::move(monitor.spare.back()));
      monitor.spare.pop_back();
    }
    read_view(view, rig, where + "views[" + std::to_string(v) + "].", out.views[v], monitor.seen);
  }
}

/// The samples of a window. @throws Refusal, InputError
std::vector<Sample> samples_of(const kincal_window& window, kincal_monitor& monitor) {
  const Rig& rig = monitor.monitor.rig();
  if (window.lines) {
    if (window.samples)
      throw Refusal{KINCAL_USAGE, "samples: there are lines, too; one of both is expected"};
    return parse_samples(text_of(window.lines, "lines"), name_of(*window.lines, "lines"), rig);
  }
  if (window.samples_count == 0) return {};
  if (window.sample_size < sizeof(kincal_sample))
    throw Refusal{KINCAL_USAGE, "sample_size: " + std::to_string(window.sample_size) +
                                    " is not the size of a sample (" +
                                    std::to_string(sizeof(kincal_sample)) + ")"};
  const char* const first = reinterpret_cast<const char*>(&given(window.samples, "samples"));
  std::vector<Sample> out;
  for (size_t i = 0; i < window.samples_count; ++i) {
    const std::string where = "samples[" + std::to_string(i) + "]";
    kincal_sample one;
    std::memcpy(&one, first + i * window.sample_size, sizeof one);
    read_sample(sized(&one, where.c_str()), monitor, where + ".");
    out.push_back(monitor.sample);
    for (View& view : out.back().views) view.ids.own();
  }
  return out;
}

/// The groups of these names. @throws Refusal, InputError
std::vector<int> groups_of(const kincal_names& names, const std::vector<std::string>& all) {
  std::vector<int> out;
  const std::vector<std::string> wanted = list_of(names, "groups");
  for (size_t i = 0; i < wanted.size(); ++i) {
    const auto found = std::find(all.begin(), all.end(), wanted[i]);
    if (found == all.end())
      throw InputError("groups[" + std::to_string(i) + "]: there is no group '" + wanted[i] + "'" +
                       nearest_or_all(wanted[i], all, "there are"));
    out.push_back(static_cast<int>(found - all.begin()));
  }
  if (out.empty()) throw InputError("groups: at least one is expected");
  return out;
}

std::vector<kincal_recalibrated> components_of(const Recalibration& done, const Monitor& monitor) {
  std::vector<kincal_recalibrated> out;
  const ParameterTable& table = monitor.table();
  for (size_t i = 0; i < monitor.columns().size(); ++i) {
    const Component& component = monitor.columns()[i];
    const Parameter& parameter = table.all[static_cast<size_t>(component.parameter)];
    const auto k = static_cast<Eigen::Index>(i);
    kincal_recalibrated one{};
    one.change = done.change(k);
    one.value = parameter.pose ? one.change : done.state.values(parameter.start + component.index);
    one.sigma = std::sqrt(std::max(0.0, done.state.covariance(k, k)));
    one.determined = done.undetermined[i] == 0;
    copy_text(one.name, sizeof one.name, table.name(component));
    copy_text(one.unit, sizeof one.unit, table.unit(component));
    out.push_back(one);
  }
  return out;
}

int32_t state_number(SampleState state) {
  switch (state) {
    case SampleState::fits:
      return KINCAL_FITS;
    case SampleState::outlier:
      return KINCAL_OUTLIER;
    case SampleState::tells_nothing:
      return KINCAL_TELLS_NOTHING;
    case SampleState::undefined:
      return KINCAL_UNDEFINED;
  }
  return KINCAL_UNDEFINED;
}

void show(kincal_monitor& monitor, const Sample& sample, kincal_innovation* innovation) {
  monitor.monitor.add(sample, monitor.last);
  monitor.moved.clear();
  const Innovation& last = monitor.last;
  kincal_innovation out{};
  out.state = state_number(last.state);
  out.alarm = last.alarm;
  out.unexplained = last.unexplained;
  out.chi2 = last.chi2;
  out.dof = last.dof;
  out.probability = last.probability;
  out.log_odds = last.log_odds;
  out.sensors = last.sensors.size();
  copy_text(out.why, sizeof out.why, last.why);
  write_struct(innovation, out);
}

}  // namespace
}  // namespace kincal

kincal_status kincal_monitor_memory(const kincal_result* result, size_t* bytes,
                                    kincal_error* error) {
  return guarded(error, [&] {
    given(bytes, "bytes");
    *bytes = monitor_memory(state_of(given(result, "result").calibrated));
  });
}

kincal_status kincal_monitor_new(const kincal_result* result, const kincal_monitor_options* options,
                                 kincal_monitor** monitor, kincal_error* error) {
  return guarded(error, [&] {
    given(monitor, "monitor");
    MonitorOptions read;
    if (options) read.samples_between_alarms = sized(options, "options").samples_between_alarms;
    if (!(read.samples_between_alarms >= 10) || std::isinf(read.samples_between_alarms))
      throw InputError("samples_between_alarms: a number from 10 on is expected");
    const kincal_result& of = given(result, "result");
    Monitor made(state_of(of.calibrated), read);
    NamesByKind names = of.names;
    for (const DriftGroup& group : made.groups()) names[KINCAL_GROUPS].push_back(group.name);
    *monitor = new kincal_monitor{std::move(made), std::move(names)};
  });
}

void kincal_monitor_free(kincal_monitor* monitor) { delete monitor; }

const char* kincal_monitor_name(const kincal_monitor* monitor, int32_t kind, size_t index) {
  return monitor ? name_at(monitor->names, kind, index) : nullptr;
}

kincal_status kincal_monitor_add(kincal_monitor* monitor, const kincal_sample* sample,
                                 kincal_innovation* innovation, kincal_error* error) {
  return guarded(error, [&] {
    kincal_monitor& of = given(monitor, "monitor");
    sized(innovation, "innovation");
    read_sample(sized(sample, "sample"), of);
    show(of, of.sample, innovation);
  });
}

kincal_status kincal_monitor_prepare(kincal_monitor* monitor, const kincal_sample* like,
                                     kincal_error* error) {
  return guarded(error, [&] {
    kincal_monitor& of = given(monitor, "monitor");
    read_sample(sized(like, "like"), of);
    of.monitor.prepare(of.sample);
  });
}

kincal_status kincal_monitor_add_json(kincal_monitor* monitor, const kincal_text* sample,
                                      kincal_innovation* innovation, kincal_error* error) {
  return guarded(error, [&] {
    kincal_monitor& of = given(monitor, "monitor");
    sized(innovation, "innovation");
    const std::string text = text_of(sample, "sample"), name = name_of(*sample, "sample");
    const std::vector<Sample> samples = parse_samples(text, name, of.monitor.rig());
    if (samples.size() != 1)
      throw InputError(name + ": one sample is expected, not " + std::to_string(samples.size()));
    show(of, samples[0], innovation);
  });
}

kincal_status kincal_monitor_sensor(const kincal_monitor* monitor, size_t index,
                                    kincal_sensor_innovation* sensor, kincal_error* error) {
  return guarded(error, [&] {
    sized(sensor, "sensor");
    const SensorInnovation& of = element(given(monitor, "monitor").last.sensors, index, "index");
    write_struct(sensor, kincal_sensor_innovation{0, static_cast<size_t>(of.sensor), of.chi2,
                                                  of.dof, of.probability});
  });
}

kincal_status kincal_monitor_find(kincal_monitor* monitor, size_t* count, kincal_error* error) {
  return guarded(error, [&] {
    given(count, "count");
    kincal_monitor& of = given(monitor, "monitor");
    of.moved = of.monitor.moved();
    *count = of.moved.size();
  });
}

kincal_status kincal_monitor_moved(const kincal_monitor* monitor, size_t index, kincal_moved* moved,
                                   kincal_error* error) {
  return guarded(error, [&] {
    sized(moved, "moved");
    const Moved& of = element(given(monitor, "monitor").moved, index, "index");
    write_struct(
        moved, kincal_moved{0, static_cast<size_t>(of.group), static_cast<size_t>(of.change.size()),
                            of.since, of.probability});
  });
}

kincal_status kincal_monitor_change(const kincal_monitor* monitor, size_t moved, size_t index,
                                    kincal_change* change, kincal_error* error) {
  return guarded(error, [&] {
    sized(change, "change");
    const kincal_monitor& of = given(monitor, "monitor");
    const Moved& found = element(of.moved, moved, "moved");
    const DriftGroup& group = of.monitor.groups()[static_cast<size_t>(found.group)];
    const Component& component =
        of.monitor.columns()[static_cast<size_t>(element(group.columns, index, "index"))];
    kincal_change out{};
    out.change = found.change(static_cast<Eigen::Index>(index));
    out.sigma = found.sigma(static_cast<Eigen::Index>(index));
    copy_text(out.name, sizeof out.name, of.monitor.table().name(component));
    copy_text(out.unit, sizeof out.unit, of.monitor.table().unit(component));
    write_struct(change, out);
  });
}

kincal_status kincal_monitor_restart(kincal_monitor* monitor, int32_t accept, kincal_error* error) {
  return guarded(error, [&] {
    kincal_monitor& of = given(monitor, "monitor");
    of.monitor.restart(accept != 0);
    of.moved.clear();
  });
}

kincal_status kincal_monitor_recalibrate(kincal_monitor* monitor, const kincal_window* window,
                                         kincal_recalibration* recalibration, kincal_error* error) {
  return guarded(error, [&] {
    kincal_monitor& of = given(monitor, "monitor");
    const kincal_window& wish = sized(window, "window");
    sized(recalibration, "recalibration");
    const std::vector<int> groups = groups_of(wish.groups, of.names[KINCAL_GROUPS]);
    constexpr int kMost = 1000, kUsual = 5;
    if (wish.iterations < 0 || wish.iterations > kMost)
      throw InputError("iterations: " + std::to_string(wish.iterations) + " is not in 0 .. " +
                       std::to_string(kMost));
    const std::vector<Sample> samples = samples_of(wish, of);
    if (samples.empty()) throw InputError("samples: at least one is expected");
    const Recalibration done =
        of.monitor.recalibrated(samples, groups, wish.iterations > 0 ? wish.iterations : kUsual);
    of.recalibrated = components_of(done, of.monitor);
    write_struct(recalibration, kincal_recalibration{0, static_cast<size_t>(done.samples),
                                                     of.recalibrated.size()});
  });
}

kincal_status kincal_monitor_recalibrated(const kincal_monitor* monitor, size_t index,
                                          kincal_recalibrated* recalibrated, kincal_error* error) {
  return guarded(error, [&] {
    sized(recalibrated, "recalibrated");
    write_struct(recalibrated, element(given(monitor, "monitor").recalibrated, index, "index"));
  });
}

kincal_status kincal_monitor_noise(const kincal_monitor* monitor, size_t index, kincal_noise* noise,
                                   kincal_error* error) {
  return guarded(error, [&] {
    sized(noise, "noise");
    const Monitor& of = given(monitor, "monitor").monitor;
    const NoiseSeen seen = element(of.noise(), index, "index");
    kincal_noise out{};
    out.sensor = seen.sensor;
    out.factor = seen.factor;
    out.residuals = seen.residuals;
    const auto part = static_cast<size_t>(seen.part);
    if (seen.sensor < 0)
      copy_text(out.joint, sizeof out.joint, of.rig().tree.joints[part].name);
    else
      copy_text(out.part, sizeof out.part,
                of.rig().sensors[static_cast<size_t>(seen.sensor)].model->noise_parts()[part].name);
    write_struct(noise, out);
  });
}

kincal_status kincal_monitor_counts(const kincal_monitor* monitor, kincal_counts* counts,
                                    kincal_error* error) {
  return guarded(error, [&] {
    sized(counts, "counts");
    const Monitor& of = given(monitor, "monitor").monitor;
    write_struct(counts, kincal_counts{0, of.samples(), of.outliers(), of.noise().size()});
  });
}

kincal_status kincal_monitor_save(const kincal_monitor* monitor, char* buffer, size_t size,
                                  size_t* needed, kincal_error* error) {
  return guarded(error, [&] {
    const std::string bytes = given(monitor, "monitor").monitor.save();
    to_buffer(std::vector<char>(bytes.begin(), bytes.end()), buffer, size, needed);
  });
}

kincal_status kincal_monitor_load(kincal_monitor* monitor, const char* bytes, size_t count,
                                  kincal_error* error) {
  return guarded(error, [&] {
    kincal_monitor& of = given(monitor, "monitor");
    of.monitor.load({&given(bytes, "bytes"), count});
    of.last = {};
    of.moved.clear();
  });
}

struct kincal_static_view {
  StaticView view;
};

kincal_status kincal_static_view_new(size_t points, const kincal_static_options* options,
                                     kincal_static_view** view, kincal_error* error) {
  return guarded(error, [&] {
    given(view, "view");
    StaticViewOptions read;
    if (options) {
      read.samples_between_alarms = sized(options, "options").samples_between_alarms;
      read.learning = options->learning;
    }
    if (!(read.samples_between_alarms >= 10) || std::isinf(read.samples_between_alarms))
      throw InputError("samples_between_alarms: a number from 10 on is expected");
    constexpr size_t kMost = 10000;  // memory grows with the square
    if (points > kMost)
      throw InputError("points: at most " + std::to_string(kMost) + " are expected");
    *view = new kincal_static_view{StaticView(static_cast<int>(points), read)};
  });
}

void kincal_static_view_free(kincal_static_view* view) { delete view; }

kincal_status kincal_static_view_add(kincal_static_view* view, const int32_t* points,
                                     const double* pixels, size_t count,
                                     kincal_static_innovation* innovation, kincal_error* error) {
  return guarded(error, [&] {
    kincal_static_view& of = given(view, "view");
    sized(innovation, "innovation");
    const std::vector<int32_t> read = array_of(points, count, "points");
    const std::vector<double> numbers = array_of(pixels, 2 * count, "pixels");
    const ViewInnovation seen = of.view.add(
        {read.begin(), read.end()},
        Eigen::Map<const Eigen::Matrix2Xd>(numbers.data(), 2, static_cast<Eigen::Index>(count)));
    kincal_static_innovation out{};
    out.learning = seen.learning;
    out.alarm = seen.alarm;
    out.chi2 = seen.chi2;
    out.dof = seen.dof;
    out.probability = seen.probability;
    out.largest = seen.largest;
    out.log_odds = seen.log_odds;
    out.left_out = seen.left_out.size();
    write_struct(innovation, out);
  });
}

kincal_status kincal_static_view_moved(const kincal_static_view* view, size_t index,
                                       kincal_static_moved* moved, kincal_error* error) {
  return guarded(error, [&] {
    sized(moved, "moved");
    const std::vector<ViewMoved> all = given(view, "view").view.moved();
    const ViewMoved& of = element(all, index, "index");
    write_struct(moved, kincal_static_moved{0,
                                            of.point,
                                            of.since,
                                            of.probability,
                                            {of.shift.x(), of.shift.y()},
                                            {of.sigma.x(), of.sigma.y()},
                                            of.largest});
  });
}

kincal_status kincal_static_view_restart(kincal_static_view* view, kincal_error* error) {
  return guarded(error, [&] { given(view, "view").view.restart(); });
}
