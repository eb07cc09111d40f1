// Calibration problems of fixed size and fixed seed, made in memory: the same numbers on every
// machine.
#pragma once

#include <string>
#include <vector>

#include "../models/estimation/estimation.h"
#include "../tests/fixtures/open_recording.h"

namespace kincal::benchmarks {

/// A recording and all else that one estimation needs. `start` is where it starts; `truth` made the
/// data.
struct RobotProblem : fixture::OpenRecording {
  std::string name;
  EstimationSetup setup;
  Values start, truth;

  RobotProblem(std::string n, Rig r) : OpenRecording(std::move(r)), name(std::move(n)) {}
};

struct Counts {
  long rows = 0, shared = 0, private_unknowns = 0;
};
Counts count(const Estimation& estimation);

/// A robot like the PR2: a head of 2 joints with 4 cameras, two arms of 7 joints with a camera on
/// each forearm and a sensor of 3-D points in each hand. In each sample one free board of 6 x 8
/// corners is seen by the head's cameras, by the camera of one forearm and by the hand of the other
/// arm; the arms alternate. 116 shared parameters, 624 residuals a board.
/// @throws std::logic_error if the counts are not boards * 624 + 116, 116 and boards * 6.
RobotProblem pr2_like(int boards);

/// Four arms of 7 joints that carry five cameras, each camera sees the board of every sample: 116
/// shared parameters, 32 columns and 96 residuals a view, five views a sample. For measurements of
/// one iteration.
RobotProblem four_arms(int samples);

/// A cell of `arms` stations in a ring, each an arm of 7 joints with a camera in its hand and a
/// fixed camera. A sample is one free board between two neighbouring stations, seen by their four
/// cameras, so that what is shared by all samples is sparse: 86 parameters a station (offset, scale
/// and origin of each joint, poses and all numbers of both cameras), coupled to those of two
/// others.
/// @throws std::logic_error if the counts are not boards * 384 + arms * 86, arms * 86, boards * 6.
RobotProblem cell(int arms, int boards);

}  // namespace kincal::benchmarks
