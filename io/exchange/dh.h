// A chain of joints in the numbers of Denavit and Hartenberg: four a joint. In the standard ones
// joint i turns about z of frame i - 1,
//     T_i = Rz(theta + q) Tz(d) Tx(a) Rx(alpha),
// in the modified ones (Craig) about z of its own frame,
//     T_i = Rx(alpha) Tx(a) Rz(theta + q) Tz(d);
// a joint that slides has q beside d. Consecutive axes determine a table. It begins and ends with
// frames on axes, so base and tip of a robot are off them by a constant pose each; and where two
// axes are nearly parallel, it makes them so: their common perpendicular, if there is one, is far
// away.
#pragma once

#include <string>
#include <vector>

#include "../../kinematics/tree.h"

namespace kincal {

struct DhRow {
  std::string joint;
  double a = 0, alpha = 0, d = 0, theta = 0;  // m, rad
  bool slides = false;
};

struct DhTable {
  bool modified = false;
  std::vector<DhRow> rows;
  Pose base_T_first, last_T_tip;  // before the first row and behind the last one
};

/// DhMisfit is what a table cannot express of a robot: the largest differences of the tip.
struct DhMisfit {
  double metres = 0, radians = 0;
};

/// Returns the table of a chain. @throws InputError: no chain, or one with followers
DhTable dh_table(const Tree& tree, const std::vector<Pose>& origins, int base, int tip,
                 bool modified);

/// Returns base_T_tip of a table at readings, one a row.
Pose dh_pose(const DhTable& table, const std::vector<double>& readings);

/// Compares a table with its robot at 100 random postures.
DhMisfit dh_misfit(const DhTable& table, const Tree& tree, const std::vector<Pose>& origins,
                   int base, int tip);

/// Returns the table as CSV, with comments (#) that say what else there is.
std::string dh_text(const DhTable& table, const DhMisfit& misfit, const std::string& base,
                    const std::string& tip);

/// Reads a table (CSV): columns a, alpha, d, theta_offset and, if there are any, type (revolute,
/// prismatic) and joint (a name). @throws InputError
DhTable read_dh(const std::string& path, bool modified);

/// Returns the URDF of a table: links base, link_1, ..., tip.
std::string dh_urdf(const DhTable& table, const std::string& robot);

}  // namespace kincal
