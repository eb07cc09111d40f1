// Reads and writes files. It needs the component `io`, and kincal.h for the computations.
//
//   read_rig()         rig.yaml with its URDF: RigFile, whose `rig` is the Rig.
//   read_samples()     samples.jsonl.
//   read_urdf()        A URDF by itself: Urdf, whose `tree` is the Tree.
//   read_postures()    Postures and truths of simulations.
//   make_results()     All files of a Report, as texts (report_page(): report.html of these);
//                      write_results() puts them into a directory.
//   read_calibrated()  Reads this directory; compare() two of them, apply_result() to another
//                      copy of the robot.
//   Others             Texts of a rig and of samples (rig_text(), samples_text()); files of lenses,
//                      of local offsets and of fleets; export_calibrated() for other programs.
//
// A mistake in a file is an InputError that names the place.
#pragma once

#include "detail/io/document/error.h"
#include "detail/io/exchange/exports.h"
#include "detail/io/report/report_page.h"
#include "detail/io/results/apply.h"
#include "detail/io/results/comparison.h"
#include "detail/io/results/fleet_files.h"
#include "detail/io/results/intrinsics_file.h"
#include "detail/io/results/local_file.h"
#include "detail/io/results/read_calibrated.h"
#include "detail/io/results/results.h"
#include "detail/io/rig/rig_file.h"
#include "detail/io/rig/rig_text.h"
#include "detail/io/rig/samples_file.h"
#include "detail/io/rig/simulation_file.h"
#include "detail/io/urdf/urdf.h"
