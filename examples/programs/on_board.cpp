// A robot that watches itself: see docs/on-a-robot.md.
#include <kincal/core.h>

#include <cmath>
#include <cstdio>
#include <random>

using namespace kincal;

// What the robot logs: readings of its joints, and where the tracker sees three marks on its hand.
struct Log {
  double joints[2];
  Vector3d marks[3];
};

static Vector3d mark(const Pose& base_T_tracker, double pan, double tilt, int i) {
  const Pose hand = {Matrix3d(Eigen::AngleAxisd(pan, Vector3d::UnitZ()) *
                              Eigen::AngleAxisd(tilt, Vector3d::UnitY())),
                     Vector3d(0, 0, 0.5)};
  return inverse(base_T_tracker) *
         (hand * Vector3d(0.4 + 0.05 * i, 0.1 * (i - 1), i == 1 ? 0.08 : 0));
}

static Sample sample_of(const Log& log) {
  Sample out;
  out.readings = {log.joints[0], log.joints[1]};
  View view;
  view.sensor = view.target = 0;
  view.ids = {0, 1, 2};
  for (const Vector3d& p : log.marks) view.z.insert(view.z.end(), p.data(), p.data() + 3);
  view.sigma = {0.0002, 0.0002, 0.0002};
  out.views = {view};
  return out;
}

int main() {
  Rig rig;
  rig.tree.links = {"base", "mast", "hand"};
  rig.tree.joints.resize(2);
  for (int i : {0, 1}) {
    Joint& joint = rig.tree.joints[i];
    joint.name = i == 0 ? "pan" : "tilt";
    joint.type = JointType::revolute;
    joint.parent = i;
    joint.child = i + 1;
    joint.parent_T_joint.translation.z() = i == 0 ? 0.5 : 0;
    joint.axis = i == 0 ? Vector3d::UnitZ() : Vector3d::UnitY();
  }
  finish_tree(rig.tree);
  rig.joints.resize(2);
  rig.joints[0].sigma = rig.joints[1].sigma = 0.0005;
  Sensor tracker;
  tracker.name = "tracker";
  tracker.type = "point";
  tracker.model = make_point();
  tracker.sigma = {0.0002, 0.0002, 0.0002};
  tracker.link = 0;
  tracker.link_T_sensor.translation = {2, 0, 1};
  tracker.pose_given = true;
  rig.sensors = {tracker};
  Target marks;
  marks.name = "marks";
  marks.type = "points";
  marks.grid = false;
  marks.points.resize(3, 3);
  marks.points << 0.4, 0.45, 0.5, -0.1, 0, 0.1, 0, 0.08, 0;
  marks.link = 2;
  marks.pose_given = true;
  rig.targets = {marks};
  Step step;
  step.name = "all";
  step.sensors = {0};
  step.free = {"sensor/tracker/pose", "joint/tilt/offset"};
  rig.steps = {step};

  // A simulated robot, its tracker 4 mm off; yours fills in Log from its messages.
  std::mt19937_64 random(7);
  std::normal_distribution<double> normal;
  Pose tracker_is = tracker.link_T_sensor;
  tracker_is.translation.x() += 0.004;
  const auto next = [&] {
    Log log;
    const double pan = 0.8 * normal(random), tilt = 0.5 * normal(random);
    log.joints[0] = pan + 0.0005 * normal(random);
    log.joints[1] = tilt + 0.0005 * normal(random);
    for (int i = 0; i < 3; ++i) {
      const double z = normal(random), y = normal(random), x = normal(random);
      log.marks[i] = mark(tracker_is, pan, tilt, i) + 0.0002 * Vector3d(x, y, z);
    }
    return sample_of(log);
  };
  std::vector<Sample> samples;
  for (int i = 0; i < 40; ++i) samples.push_back(next());
  Calibration calibration(make_recording(rig, samples));
  const Solution& found = calibration.solve();
  if (!found.usable()) return std::printf("%s\n", found.message.c_str()), 1;

  MonitorOptions options;
  options.samples_between_alarms = 864000;  // at 10 Hz one false alarm a day
  Monitor monitor({found.rig(), found.values.shared, found.columns, found.covariance, {}, {}},
                  options);
  for (int i = 0; i < 10000; ++i) {
    if (i == 6000)
      tracker_is.rotation =
          tracker_is.rotation * Eigen::AngleAxisd(0.001, Vector3d::UnitY());  // somebody hits it
    if (!monitor.add(next()).alarm) continue;
    for (int more = 0; more < 20; ++more) monitor.add(next());  // one sample is often not enough
    if (monitor.moved().empty()) continue;                      // no change explained them
    const Moved what = monitor.moved().front();
    std::printf("%s has moved since sample %ld:", monitor.groups()[what.group].name.c_str(),
                what.since);
    for (const double change : what.change) std::printf(" %.1f", 1e3 * change);  // mm, then mrad
    std::printf("\n");
    return i >= 6000 && i < 6020 ? 0 : 1;
  }
  return 1;
}
