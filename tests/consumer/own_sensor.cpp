// A sensor type that kincal does not know: it sees the direction of a point (azimuth, elevation),
// not its distance. Two of them on the base look at six lamps in the hand of a small arm; the
// samples are made here, without noise, with kinematics written out by hand. Mounts, joint offsets
// and a gear must come out as planted, to 1e-6: from rough poses, and from none at all.
#include <kincal/extend.h>
#include <kincal/kincal.h>

#include <cmath>
#include <cstdio>
#include <random>

using namespace kincal;

namespace {

struct Bearing {
  static constexpr int kRows = 2, kMeasurementSize = 2;
  int parameter_count() const { return 0; }

  bool residual(const double*, const Vector3d& p, const double* z, double* r, double* d_p,
                double*) const {
    const double h2 = p.x() * p.x() + p.z() * p.z(), h = std::sqrt(h2), n2 = h2 + p.y() * p.y();
    if (!(p.z() > 0)) return false;  // sees only what is ahead, +z
    r[0] = std::atan2(p.x(), p.z()) - z[0];
    r[1] = std::atan2(p.y(), h) - z[1];
    if (d_p) {
      const double d[6] = {
          p.z() / h2, 0, -p.x() / h2, -p.x() * p.y() / (h * n2), h / n2, -p.z() * p.y() / (h * n2)};
      std::copy(d, d + 6, d_p);
    }
    return true;
  }
};

struct Truth {
  Pose base_T_sensor[2];
  double lift_offset = 0.02, lift_scale = 1.015, bend_offset = -0.03;
};

Matrix3d about(const Vector3d& axis, double angle) {
  return Eigen::AngleAxisd(angle, axis).toRotationMatrix();
}

/// The arm: turn about z at height 0.3, lift about y at 0.2 above, bend about y 0.5 further on,
/// hand 0.4 beyond.
Pose hand(double turn, double lift, double bend) {
  Pose t{about(Vector3d::UnitZ(), turn), Vector3d(0, 0, 0.3)};
  t = t * Pose{about(Vector3d::UnitY(), lift), Vector3d(0, 0, 0.2)};
  t = t * Pose{about(Vector3d::UnitY(), bend), Vector3d(0.5, 0, 0)};
  return t * Pose{Matrix3d::Identity(), Vector3d(0.4, 0, 0)};
}

Pose looking(const Vector3d& from, const Vector3d& to) {
  Pose t;
  t.translation = from;
  t.rotation.col(2) = (to - from).normalized();
  t.rotation.col(0) = t.rotation.col(2).cross(Vector3d::UnitZ()).normalized();
  t.rotation.col(1) = t.rotation.col(2).cross(t.rotation.col(0));
  return t;
}

Rig make_rig() {
  Rig rig;
  rig.tree.links = {"base", "turret", "upper", "fore", "hand"};
  const char* names[] = {"turn", "lift", "bend", "wrist"};
  const Vector3d at[] = {{0, 0, 0.3}, {0, 0, 0.2}, {0.5, 0, 0}, {0.4, 0, 0}};
  for (int i = 0; i < 4; ++i) {
    Joint joint;
    joint.name = names[i];
    joint.type = i == 3 ? JointType::fixed : JointType::revolute;
    joint.parent = i;
    joint.child = i + 1;
    joint.parent_T_joint.translation = at[i];
    joint.axis = i == 0 ? Vector3d::UnitZ() : Vector3d::UnitY();
    rig.tree.joints.push_back(joint);
  }
  finish_tree(rig.tree);
  rig.joints.resize(4);
  for (int i = 0; i < 3; ++i) rig.joints[i].sigma = 0.0005;

  Target lamps;
  lamps.name = "lamps";
  lamps.type = "points";
  lamps.grid = false;
  lamps.points.resize(3, 6);
  lamps.points << 0, 0.1, 0.02, -0.1, 0.05, 0.08, 0, 0.03, -0.12, 0.05, 0.1, -0.06, 0, 0, 0.09,
      0.03, -0.08, 0.12;
  lamps.link = rig.tree.find_link("hand");
  lamps.pose_given = true;
  rig.targets = {lamps};

  for (const char* name : {"left", "right"}) {
    Sensor sensor;
    sensor.name = name;
    sensor.type = "bearing";
    sensor.model = std::make_shared<PointwiseSensor<Bearing>>(Bearing(), "rad");
    sensor.link = rig.tree.find_link("base");
    sensor.sigma = {0.0002, 0.0002};
    rig.sensors.push_back(sensor);
  }
  Step step;
  step.name = "all";
  step.sensors = {0, 1};
  step.free = {"sensor/*/pose", "joint/lift/offset", "joint/lift/scale", "joint/bend/offset"};
  rig.steps = {step};
  return rig;
}

std::vector<Sample> make_samples(const Rig& rig, const Truth& truth) {
  std::mt19937 random(3);
  auto uniform = [&](double low, double high) {
    return low + (high - low) * (random() / 4294967296.0);
  };
  std::vector<Sample> samples;
  for (int k = 0; k < 30; ++k) {
    Sample sample;
    sample.id = "posture_" + std::to_string(k);
    sample.readings = {uniform(-0.9, 0.9), uniform(-0.8, 0.6), uniform(-0.9, 0.9), std::nan("")};
    const Pose base_T_hand =
        hand(sample.readings[0], truth.lift_scale * sample.readings[1] + truth.lift_offset,
             sample.readings[2] + truth.bend_offset);
    for (int s = 0; s < 2; ++s) {
      View view;
      view.sensor = s;
      view.target = 0;
      view.ids = {0, 1, 2, 3, 4, 5};
      view.sigma = rig.sensors[s].sigma;
      for (int i = 0; i < 6; ++i) {
        const Vector3d p = inverse(truth.base_T_sensor[s]) *
                           (base_T_hand * Vector3d(rig.targets[0].points.col(i)));
        view.z.push_back(std::atan2(p.x(), p.z()));
        view.z.push_back(std::atan2(p.y(), std::hypot(p.x(), p.z())));
      }
      sample.views.push_back(view);
    }
    sample.train = k % 5 != 4;
    samples.push_back(sample);
  }
  return samples;
}

bool recovers(const char* title, const Rig& rig, const Truth& truth) {
  const std::optional<Report> report =
      study(make_recording(rig, make_samples(rig, truth)), StudyOptions());
  const Solution& solution = report->solution;
  double worst = 0;
  for (const ParameterEstimate& p : solution.parameters) {
    if (p.pose) {
      const Pose e = inverse(truth.base_T_sensor[p.name == "sensor/right/pose"]) * *p.pose;
      worst = std::max({worst, e.translation.norm(), log_so3(e.rotation).norm()});
    } else {
      const double t = p.name == "joint/lift/scale"    ? truth.lift_scale
                       : p.name == "joint/lift/offset" ? truth.lift_offset
                                                       : truth.bend_offset;
      worst = std::max(worst, std::abs(p.value[0] - t));
    }
  }
  const SensorResult& left = report->residuals.sensors[0];
  std::printf(
      "%s: %zu parameters, worst error %.2g, chi2 %.2g, dof %ld, held out %.2g %s in %ld points\n",
      title, solution.parameters.size(), worst, solution.chi2, solution.dof, left.test.rms,
      left.unit.c_str(), left.test.points);
  return solution.status == Status::converged && solution.parameters.size() == 5 && worst < 1e-6 &&
         solution.chi2 < 1e-6 && left.unit == "rad" && left.test.points == 36 &&
         left.test.rms < 1e-6;
}

}  // namespace

int main() {
  Truth truth;
  truth.base_T_sensor[0] = looking({2.5, 1.5, 1.2}, {0.5, 0, 0.5});
  truth.base_T_sensor[1] = looking({2.2, -1.8, 0.9}, {0.5, 0, 0.5});
  bool good = true;

  Rig rig = make_rig();
  for (int s = 0; s < 2; ++s) {
    Vector6d off;
    off << 0.05, -0.04, 0.08, 0.03, -0.05, 0.04;
    rig.sensors[s].link_T_sensor = truth.base_T_sensor[s] * exp_se3(s ? off : Vector6d(-off));
    rig.sensors[s].pose_given = true;
  }
  good = recovers("rough poses", rig, truth) && good;

  Rig unknown = make_rig();
  good = recovers("unknown poses", unknown, truth) && good;
  return good ? 0 : 1;
}
