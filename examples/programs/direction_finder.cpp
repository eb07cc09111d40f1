// A program with a sensor of its own: see docs/adding-a-sensor.md.
#include <kincal/kincal.h>

#include <cstdio>

#include "bearing.h"

using namespace kincal;

int main() {
  // A mast that pans and tilts; kincal/files.h reads URDFs.
  Rig rig;
  rig.tree.links = {"base", "mast", "head"};
  rig.tree.joints.resize(2);
  for (int i : {0, 1}) {
    Joint& joint = rig.tree.joints[i];
    joint.name = i == 0 ? "pan" : "tilt";
    joint.type = JointType::revolute;
    joint.parent = i;
    joint.child = i + 1;
    joint.parent_T_joint.translation.z() = i == 0 ? 1.0 : 0.2;
    joint.axis = i == 0 ? Vector3d::UnitZ() : Vector3d::UnitY();
    joint.lower = -0.5;
    joint.upper = 0.5;
  }
  finish_tree(rig.tree);
  rig.joints.resize(2);
  rig.joints[0].sigma = rig.joints[1].sigma = 0.0005;  // rad

  Sensor finder;
  finder.name = "finder";
  finder.type = "bearing";
  finder.model = std::make_shared<PointwiseSensor<Bearing>>(Bearing(), "rad");
  finder.parameters = {{"gain", {""}, {""}, {1.0}}};
  finder.sigma = {0.0002, 0.0002};
  finder.link = rig.tree.find_link("head");
  finder.link_T_sensor.rotation =
      rotation_from_rpy(Vector3d(-kPi / 2, 0, -kPi / 2));  // z ahead, x right, y down
  finder.pose_given = true;
  rig.sensors = {finder};

  // Four beacons at known places.
  Target beacons;
  beacons.name = "beacons";
  beacons.type = "points";
  beacons.grid = false;
  beacons.points.resize(3, 4);
  beacons.points << 6, 7, 5, 8, 1, -1, -0.5, 0.5, 0, 0.5, 2, 1.5;
  beacons.link = rig.tree.find_link("base");
  beacons.pose_given = true;
  rig.targets = {beacons};

  Step step;
  step.name = "mast";
  step.sensors = {0};
  step.free = {"joint/*/offset", "sensor/finder/gain"};
  rig.steps = {step};

  // Simulated samples; a real robot fills kincal::Sample.
  const ParameterTable table(rig);
  SimulationOptions options;
  options.samples = 30;
  const Simulation robot = simulate(
      rig, table, draw_truth(table, {{"joint/*/offset", 0.02}, {"sensor/finder/gain", 0.01}}, 7),
      options);

  Calibration calibration(make_recording(rig, robot.samples));
  const Solution& solution = calibration.solve();
  if (!solution.usable()) return std::printf("%s\n", solution.message.c_str()), 1;
  std::printf("chi2/dof %.2f\n", solution.chi2 / solution.dof);
  for (const ParameterEstimate& e : solution.parameters)
    std::printf("%-20s %9.5f +- %.5f, truly %9.5f\n", e.name.c_str(), e.value[0], e.sigma[0],
                robot.truth(table.all[e.parameter].start));
  return solution.status == Status::converged ? 0 : 1;
}
