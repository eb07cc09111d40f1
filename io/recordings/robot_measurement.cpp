#include "robot_measurement.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <set>

#include "../../models/rig/numbers.h"
#include "../document/error.h"
#include "../document/json.h"
#include "../document/names.h"
#include "bytes.h"
#include "message.h"
#include "record_command.h"

namespace kincal {

namespace {

/// What stands in a rig for the ids of messages.
class RigIds {
 public:
  explicit RigIds(const RigFile& rig) : rig_(rig) {}

  /// The sensor that an id means: of this name, of this `topic`, or the only one of the type. -1:
  /// none, which is noted once.
  int sensor(const std::string& id, const std::string& type, std::set<std::string>& notes) const {
    int only = -1, of_type = 0;
    std::vector<std::string> valid;
    for (size_t s = 0; s < rig_.rig.sensors.size(); ++s) {
      const Sensor& one = rig_.rig.sensors[s];
      if (one.type != type) continue;
      if (one.name == id || given_topic(rig_, one.name) == id) return static_cast<int>(s);
      valid.push_back(one.name);
      only = static_cast<int>(s);
      ++of_type;
    }
    if (of_type == 1 && given_topic(rig_, rig_.rig.sensors[only].name).empty()) return only;
    if (!of_type) return -1;  // the rig wants nothing of this kind
    notes.insert(type + " '" + id + "' of the recording is not a sensor of the rig (" +
                 comma_separated(valid) + "): write `topic: " + id +
                 "` into the entry of the right one");
    return -1;
  }

  bool is_named(int sensor, const std::string& id) const {
    const std::string& name = rig_.rig.sensors[sensor].name;
    return name == id || given_topic(rig_, name) == id;
  }

  int target(const std::string& id, std::set<std::string>& notes) const {
    const std::vector<Target>& all = rig_.rig.targets;
    std::vector<std::string> valid;
    for (size_t t = 0; t < all.size(); ++t) {
      if (all[t].name == id) return static_cast<int>(t);
      valid.push_back(all[t].name);
    }
    if (all.size() == 1) return 0;
    notes.insert("target '" + id + "' of the recording is not in the rig (" +
                 comma_separated(valid) + "): give one of them this name");
    return -1;
  }

 private:
  const RigFile& rig_;
};

struct MeasurementReader {
  const RigFile& rig;
  RigIds ids;
  ImportedSamples out;
  std::set<std::string> notes;
  std::map<const Topic*, MessageTypes> types;

  std::string prefix;  // of joints

  explicit MeasurementReader(const RigFile& of)
      : rig(of), ids(of), prefix(given_joint_prefix(of)) {}

  /// Takes the readings of a sensor_msgs/JointState.
  void readings(const MessageValue& state, const std::string& of, Sample& sample) {
    const auto& names = list_of(field(state, "name"));
    const NumberArray positions = numbers_of(field(state, "position"));
    if (names.size() != positions.size())
      throw Damage(of + " has " + std::to_string(names.size()) + " names and " +
                   std::to_string(positions.size()) + " positions");
    for (size_t i = 0; i < names.size(); ++i) {
      const std::string name(text_of(names[i]));
      const bool ours = name.compare(0, prefix.size(), prefix) == 0;
      const int joint = ours ? rig.rig.tree.find_joint(name.substr(prefix.size())) : -1;
      if (joint < 0)
        notes.insert("joint '" + name + "' of the recording is not in the robot: left out");
      else if (!std::isfinite(positions[i]))
        notes.insert("sample '" + sample.id + "': the reading of joint '" + name +
                     "' is not finite: left out");
      else
        sample.readings[joint] = positions[i];
    }
  }

  /// A view of `count` points, all that the target has. Where it has another number, it is noted
  /// and left out.
  View* add_view(Sample& sample, int sensor, int target, size_t count) {
    const auto points = static_cast<size_t>(rig.rig.targets[target].count());
    if (count != points) {
      notes.insert("sample '" + sample.id + "': '" + rig.rig.sensors[sensor].name + "' has " +
                   std::to_string(count) + " points, target '" + rig.rig.targets[target].name +
                   "' has " + std::to_string(points) + ": left out");
      return nullptr;
    }
    View view;
    view.sensor = sensor;
    view.target = target;
    view.ids.own().resize(count);
    std::iota(view.ids.own().begin(), view.ids.own().end(), 0);
    view.sigma = rig.rig.sensors[sensor].sigma;
    sample.views.push_back(view);
    return &sample.views.back();
  }

  /// Takes the last view out again, with a note, where not all that it measured are finite numbers.
  void check_numbers(Sample& sample) {
    const View& view = sample.views.back();
    if (std::all_of(view.z.begin(), view.z.end(), [](double z) { return std::isfinite(z); }))
      return;
    notes.insert("sample '" + sample.id + "': '" + rig.rig.sensors[view.sensor].name +
                 "' has values that are not finite: left out");
    sample.views.pop_back();
  }

  void cameras(const MessageValue& message, int target, Sample& sample) {
    for (const MessageValue& one : list_of(field(message, "M_cam"))) {
      const std::int64_t stamp = nanoseconds_of(field(one, "header.stamp"));
      if (!sample.time && stamp != 0) sample.time = static_cast<double>(stamp) * 1e-9;
      const int sensor = ids.sensor(std::string(text_of(field(one, "camera_id"))), "camera", notes);
      const auto& points = list_of(field(one, "image_points"));
      if (sensor < 0 || points.empty()) continue;
      View* view = add_view(sample, sensor, target, points.size());
      if (!view) continue;
      for (const MessageValue& p : points) {
        view->z.push_back(number_of(field(p, "x")));
        view->z.push_back(number_of(field(p, "y")));
      }
      check_numbers(sample);
    }
  }

  void lasers(const MessageValue& message, int target, Sample& sample) {
    for (const MessageValue& one : list_of(field(message, "M_laser"))) {
      const int sensor =
          ids.sensor(std::string(text_of(field(one, "laser_id"))), "tilting_laser", notes);
      const auto& points = list_of(field(one, "joint_points"));
      if (sensor < 0 || points.empty()) continue;
      View* view = add_view(sample, sensor, target, points.size());
      if (!view) continue;
      for (const MessageValue& p : points) {  // tilt, bearing, range
        const NumberArray position = numbers_of(field(p, "position"));
        if (position.size() != 3) throw Damage("a laser's point does not have three components");
        for (size_t i = 0; i < 3; ++i) view->z.push_back(position[i]);
      }
      check_numbers(sample);
    }
  }

  void chain(int sensor, int target, Sample& sample) {
    View view;
    view.sensor = sensor;
    view.target = target;
    view.sigma = rig.rig.sensors[sensor].sigma;
    sample.views.push_back(view);
  }

  /// What an observation of CalibrationData has: points in the frame of a sensor (of a camera also
  /// through the lens that stands beside them), or those of the target, of an arm that holds it.
  void observation(const MessageValue& one, Sample& sample) {
    const std::string id(text_of(field(one, "sensor_name")));
    const auto& features = list_of(field(one, "features"));
    const int target = ids.target("", notes);
    if (features.empty() || target < 0) return;
    if (const int arm = ids.sensor(id, "chain", notes); arm >= 0 && ids.is_named(arm, id))
      return chain(arm, target, sample);
    const int point = ids.sensor(id, "point", notes);
    const int sensor =
        point >= 0 && ids.is_named(point, id) ? point : ids.sensor(id, "camera", notes);
    if (sensor < 0 || !ids.is_named(sensor, id)) return;
    View* view = add_view(sample, sensor, target, features.size());
    if (!view) return;
    NumberArray k;
    if (sensor != point) k = numbers_of(field(one, "ext_camera_info.camera_info.K"));
    if (sensor != point && k.size() != 9) throw Damage("camera_info.K has not nine numbers");
    for (const MessageValue& feature : features) {
      const double x = number_of(field(feature, "point.x")),
                   y = number_of(field(feature, "point.y")),
                   z = number_of(field(feature, "point.z"));
      if (sensor == point)
        view->z.insert(view->z.end(), {x, y, z});
      else
        view->z.insert(view->z.end(), {k[0] * x / z + k[2], k[4] * y / z + k[5]});
    }
    check_numbers(sample);
  }

  /// A robot_calibration_msgs/CalibrationData.
  void calibration_data(const MessageValue& value, std::int64_t received) {
    Sample sample;
    sample.id = "sample_" + std::to_string(out.samples.size() + 1);
    sample.readings.assign(rig.rig.tree.joints.size(), kNan);
    readings(field(value, "joint_states"), "joint_states", sample);
    const std::int64_t stamp = nanoseconds_of(field(value, "joint_states.header.stamp"));
    sample.time = static_cast<double>(stamp != 0 ? stamp : received) * 1e-9;
    for (const MessageValue& one : list_of(field(value, "observations"))) observation(one, sample);
    if (sample.views.empty())
      notes.insert("sample '" + sample.id + "': no observation is of a sensor of the rig");
    out.samples.push_back(std::move(sample));
  }

  void message(const BagMessage& raw) {
    if (!types.count(raw.topic))
      types[raw.topic] = read_definition(raw.topic->type, raw.topic->definition);
    const MessageValue value = decode_message(
        types[raw.topic], raw.topic->encoding == "cdr" ? Wire::cdr : Wire::ros1, raw.data);
    if (raw.topic->type == kCalibrationData) return calibration_data(value, raw.received);
    Sample sample;
    sample.id = std::string(text_of(field(value, "sample_id")));
    if (!is_utf8(sample.id)) {
      sample.id = "measurement_" + std::to_string(out.samples.size() + 1);
      notes.insert("a sample_id is no UTF-8, which a file of samples has to be: the sample is '" +
                   sample.id + "'");
    }
    sample.readings.assign(rig.rig.tree.joints.size(), kNan);
    const int target = ids.target(std::string(text_of(field(value, "target_id"))), notes);
    for (const MessageValue& one : list_of(field(value, "M_chain")))
      readings(field(one, "chain_state"),
               "chain '" + std::string(text_of(field(one, "chain_id"))) + "'", sample);
    if (target >= 0) {
      cameras(value, target, sample);
      lasers(value, target, sample);
      const std::string arm(text_of(field(value, "chain_id")));
      if (const int sensor = arm.empty() ? -1 : ids.sensor(arm, "chain", notes); sensor >= 0)
        chain(sensor, target, sample);
    }
    if (!sample.time) sample.time = static_cast<double>(raw.received) * 1e-9;
    out.samples.push_back(std::move(sample));
  }
};

}  // namespace

bool is_whole_posture(const std::string& type) {
  return type == kRobotMeasurement || type == kCalibrationData;
}

ImportedSamples read_robot_measurements(const std::vector<std::string>& bags, const RigFile& rig,
                                        std::vector<std::string>& losses,
                                        const Progress& progress) {
  MeasurementReader reader(rig);
  for (const std::string& bag : bags) {
    reader.types.clear();  // topics live as long as their bag is read
    constexpr int kTold = 20;
    int wrong = 0;  // messages
    const auto visit = [&](const BagMessage& raw) {
      if (is_whole_posture(raw.topic->type)) try {
          reader.message(raw);
        } catch (const Damage& damage) {
          if (++wrong <= kTold)
            losses.push_back(bag + ": a message of " + raw.topic->name + ": " + damage.what());
        }
      return true;
    };
    const BagContents contents = read_bag(bag, visit, progress);
    if (wrong > kTold)
      losses.push_back(bag + ": and " + std::to_string(wrong - kTold) + " more messages");
    losses.insert(losses.end(), contents.losses.begin(), contents.losses.end());
    if (contents.more_losses > 0)
      losses.push_back(bag + ": and " + std::to_string(contents.more_losses) + " more");
  }
  std::map<std::string, int> seen;
  for (Sample& sample : reader.out.samples)
    if (const int again = seen[sample.id]++) {
      reader.notes.insert("sample '" + sample.id +
                          "' occurs several times: later ones are named '" + sample.id +
                          "_2' and so on");
      sample.id += "_" + std::to_string(again + 1);
    }
  reader.out.notes.assign(reader.notes.begin(), reader.notes.end());
  return std::move(reader.out);
}

}  // namespace kincal
