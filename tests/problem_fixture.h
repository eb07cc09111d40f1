// Whole problems for tests that solve them: the nasty robot of rig_fixture.h with data that fit it.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "rig_fixture.h"

namespace kincal::fixture {

/// A problem with what it refers to.
struct Setting {
  Rig rig;  // the rig: T0, and where it starts
  std::vector<Sample> samples;
  std::vector<std::map<int, Isometry3d>> boards;  // true
  std::unique_ptr<ParameterTable> table;
  std::unique_ptr<Estimation> problem;
  Values values;

  void make(const std::vector<std::string>& sensors, const std::vector<std::string>& free, NoiseMode mode = NoiseMode::latent,
            const Loss& loss = {}) {
    table = std::make_unique<ParameterTable>(rig);
    EstimationSetup setup;
    setup.noise = mode;
    setup.loss = loss;
    for (const std::string& s : sensors) setup.sensors.push_back(sensor_index(rig, s));
    setup.free = freed(*table, free);
    problem = std::make_unique<Estimation>(rig, *table, samples, all_of(samples), setup);
    values = {};
    values.shared = table->initial;
    for (size_t s = 0; s < boards.size(); ++s)
      for (const auto& [target, board] : boards[s]) values.targets[{static_cast<int>(s), target}] = to_pose(board);
  }
  VectorXd start() const { return problem->pack(values); }
};

/// The nasty robot with a consistent set of data: boards in the hand and in front of cameras, the mounted targets, all with noise.
/// `free` is moved away from the truth by up to `off` (m, rad) in the rig.
inline Setting nasty(int count, unsigned long seed, bool noise, const std::vector<std::string>& free, double off, Rig* true_rig = nullptr) {
  Setting s;
  const Rig truth = nasty_robot();
  if (true_rig) *true_rig = truth;
  Random random(seed);
  const int board = target_index(truth, "board"), probe = target_index(truth, "probe"), grip = sensor_index(truth, "grip");
  const std::vector<std::string> cameras = {"pin", "bc5", "bc8", "kb"};
  Random* r = noise ? &random : nullptr;
  for (int k = 0; k < count; ++k) {
    TruePosture p = random_posture(truth, random, 1.2, noise);
    // In turn: the board in the hand, before the tracker and the depth camera; or before a camera, and then not in the hand.
    if (k % 2)
      p.boards[board] = in_hand(truth, grip, p, r);
    else
      p.boards[board] = in_front(truth, sensor_index(truth, cameras[k / 2 % 4]), board, p, 0.7, 0.8, random);
    p.boards[probe] = in_front(truth, sensor_index(truth, cameras[(k + 1) % 4]), probe, p, 0.8, 1, random);
    Sample sample = make_sample(truth, p, "n" + std::to_string(k));
    for (const int target : {board, target_index(truth, "wall"), target_index(truth, "marks"), probe})
      for (const int sensor : all_sensors(truth)) {
        if (sensor == grip ? target != board || k % 2 == 0 : !pair_allowed(truth, sensor, target)) continue;
        add_view(sample, truth, sensor, target, p, r);
      }
    s.samples.push_back(sample);
    s.boards.push_back(p.boards);
  }
  Random start(seed + 1);
  s.rig = moved(truth, free, start, off, off, 10 * off, off);
  std::vector<std::string> sensors;
  for (const Sensor& sensor : s.rig.sensors) sensors.push_back(sensor.name);
  s.make(sensors, free);
  for (auto& [key, pose] : s.values.targets) pose = to_pose(isometry(pose) * exponential(start.twist(off, off)));
  return s;
}

/// Determined by these samples: offsets and sensors of every kind, origins in part, intrinsics, sizes, points.
inline const std::vector<std::string> kDetermined = {
    "joint/pan/offset",       "joint/elbow/offset", "joint/elbow/scale",   "joint/slide/offset",    "joint/scan/scale",
    "joint/turn/scale",       "joint/eye/origin.x", "joint/eye/origin.rz", "joint/finger/origin.y", "joint/nail/origin.rx",
    "sensor/bc5/intrinsics",  "sensor/kb/pose",     "sensor/pin/pose.z",   "sensor/pin/pose.ry",    "sensor/laser/pose.rx",
    "sensor/laser/pose.z",    "sensor/grip/pose",   "target/wall/pose",    "target/wall/square",    "target/board/square",
    "target/marks/points.2.x"};

/// The nasty robot again, ready in a noise mode and with a loss: every sensor, kDetermined free.
inline Setting nasty_in(NoiseMode mode, const Loss& loss, int count, unsigned long seed, double off) {
  Setting s = nasty(count, seed, true, kDetermined, off);
  std::vector<std::string> sensors;
  for (const Sensor& sensor : s.rig.sensors) sensors.push_back(sensor.name);
  const Values values = s.values;
  s.make(sensors, kDetermined, mode, loss);
  s.values = values;
  return s;
}

}  // namespace kincal::fixture
